"""Page of a live run: Meshcat with the run's story over the scene."""

import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from pydrake.geometry import Meshcat

from drake_pregrasp.errors import OutputError
from drake_pregrasp.live.live_controls import LiveControls
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.recording import start_meshcat
from drake_pregrasp.simulation.scenario import Scenario
from drake_pregrasp.systems.run_story import OVERLAY

_PAGE = """<!DOCTYPE html>
<html><head><meta charset="utf-8"><title>drake-pregrasp</title></head>
<body style="margin: 0">
<iframe src="{meshcat}" style="border: 0; width: 100vw; height: 100vh; display: block"></iframe>
{overlay}<script>followRun();</script></body></html>
"""


@contextlib.contextmanager
def served_page(meshcat: Meshcat, story: Callable[[], dict[str, Any]]) -> Iterator[str]:
    """Serves the page to this machine until the end of the block, and yields its address.

    Args:
        meshcat: Viewer of the run.
        story: Function that returns the story as the page reads it.

    Raises:
        OutputError: If no port can be opened.
    """
    overlay = OVERLAY.read_text(encoding="utf-8")
    page = _PAGE.replace("{meshcat}", meshcat.web_url()).replace("{overlay}", overlay)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            kind, text = "text/html", page
            if self.path == "/story":
                kind, text = "application/json", json.dumps(story())
            self.send_response(200 if self.path in ("/", "/story") else 404)
            self.send_header("Content-Type", f"{kind}; charset=utf-8")
            self.end_headers()
            self.wfile.write(text.encode())

        def log_message(self, *_: object) -> None:
            """Prints nothing."""

    try:
        server = ThreadingHTTPServer(("localhost", 0), Handler)
    except OSError as error:
        raise OutputError(f"the live page cannot be served: {error.strerror}") from error
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://localhost:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def run_live(
    scenario: Scenario,
    *,
    name: str,
    out: str | Path = "runs",
    announce: Callable[[str], object] = print,
    should_stop: Callable[[], bool] = lambda: False,
) -> None:
    """Runs a scenario in real time in a page with controls, until somebody stops it.

    Args:
        scenario: Checked scenario to simulate.
        name: Name of the run, for the title and for saved recordings.
        out: Folder for saved recordings.
        announce: Function that is called with the page's address, once it can be opened.
        should_stop: Function that is called after each tick; if it returns true, the run ends.

    Raises:
        OutputError: If no port can be opened, or a recording cannot be written.
    """
    meshcat = start_meshcat(live=True)
    run = LiveRun(scenario, name=name, meshcat=meshcat)
    controls = LiveControls(run, meshcat, out=Path(out))
    story = lambda: run.story.now() | {"note": controls.note()}  # noqa: E731
    with served_page(meshcat, story) as address:
        announce(address)
        controls.serve(should_stop)
