"""Page of a live run: Meshcat with the run's timeline over the scene."""

import contextlib
import json
import threading
import urllib.request
from collections.abc import Callable, Iterator
from http.client import HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from pydrake.geometry import Meshcat

from drake_pregrasp.errors import OutputError
from drake_pregrasp.live.live_controls import LiveControls
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.recording import start_meshcat
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.systems.run_timeline import OVERLAY

# Meshcat's server is on this machine: a proxy of the environment does not reach it.
_open = urllib.request.build_opener(urllib.request.ProxyHandler({})).open

# Meshcat's page connects to the server that it comes from, which must be Meshcat's own.
_SOCKET = """<head><script>
window.WebSocket = class extends WebSocket {{ constructor() {{ super("{}"); }} }};
</script>"""
_START = (
    "<script>followRun(); viewer.gui.__folders.Scene.close(); viewer.gui.open();</script></body>"
)


@contextlib.contextmanager
def served_page(meshcat: Meshcat, timeline: Callable[[], dict[str, Any]]) -> Iterator[str]:
    """Serves the page to this machine until the end of the block, and yields its address.

    Args:
        meshcat: Viewer of the run.
        timeline: Function that returns the timeline as the page reads it.

    Raises:
        OutputError: If no port can be opened.
    """
    viewer = meshcat.web_url()
    with _open(viewer) as answer:
        page = answer.read().decode().replace("<head>", _SOCKET.format(meshcat.ws_url()), 1)
    page = page.replace("</body>", OVERLAY.read_text(encoding="utf-8") + _START)

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            # The page may be closed while it is sent, and others may ask for what is no address.
            with contextlib.suppress(OSError, ValueError, HTTPException):
                if self.path == "/":
                    self.answer("text/html", page.encode())
                elif self.path == "/timeline":
                    self.answer("application/json", json.dumps(timeline()).encode())
                elif self.path.startswith("/"):
                    with _open(viewer + self.path) as part:
                        self.answer(part.headers.get_content_type(), part.read())

        def answer(self, kind: str, content: bytes) -> None:
            self.send_response(200)
            self.send_header("Content-Type", f"{kind}; charset=utf-8")
            self.end_headers()
            self.wfile.write(content)

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


def serve_live_run(
    resolved: ResolvedScenario,
    *,
    name: str,
    out: str | Path = "runs",
    announce: Callable[[str], object] = print,
    should_stop: Callable[[], bool] = lambda: False,
) -> None:
    """Runs a scenario in real time in a page with controls, until somebody stops it.

    Args:
        resolved: Scenario to simulate.
        name: Name of the run, for the title and for saved recordings.
        out: Folder for saved recordings.
        announce: Function that is called with the page's address, once it can be opened.
        should_stop: Function that is called after each tick; if it returns true, the run ends.

    Raises:
        OutputError: If no port can be opened.
    """
    meshcat = start_meshcat(live=True)
    run = LiveRun(resolved, name=name, meshcat=meshcat)
    controls = LiveControls(run, meshcat, out=Path(out))
    with served_page(meshcat, controls.timeline) as address:
        announce(address)
        controls.serve(should_stop)
