"""Page of a live run: Meshcat with the run's timeline over the scene."""

import contextlib
import json
import re
import secrets
import socket
import struct
import threading
import time
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from http.client import HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedIOBase
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat

from drake_pregrasp.errors import OutputError
from drake_pregrasp.live.live_controls import LiveControls
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.recording import start_meshcat
from drake_pregrasp.simulation.resolved_scenario import ResolvedScenario
from drake_pregrasp.visualization.run_timeline import OVERLAY

# Meshcat's server is on this machine: a proxy of the environment does not reach it.
_open = urllib.request.build_opener(urllib.request.ProxyHandler({})).open

# What Meshcat's page sends is checked here, so it must be in a form that Python reads.
_SEND = """<head><script>
window.WebSocket = class extends WebSocket {
  send(data) {
    const {type, name, value, drag_anchor, drag_target} = MeshCat.msgpack.decode(data);
    if (["button", "slider", "mouse_drag"].includes(type))
      super.send(JSON.stringify({type, name, value, drag_anchor, drag_target}));
  }
};
</script>"""
_START = (
    "<script>followRun(); viewer.gui.__folders.Scene.close(); viewer.gui.open();</script></body>"
)

# The page of Drake 1.57 and later lets the mouse drag what it draws: here, the object and what is
# drawn on it only.
_DRAG = """<script>
if (typeof mouseDrag !== "undefined") {
  const raycast = mouseDrag.raycast;
  mouseDrag.raycast = function (event) {
    const hit = raycast.call(this, event), path = hit && this.objectPath(hit.object);
    return hit && /^.drake.(pregrasp|bodies.object)./.test(path) ? hit : null;
  };
  element("div", "Ctrl and left button: drag the object.", document.getElementById("timeline-key"));
}
</script>"""
_NO_DRAG = """<script>
if (typeof mouseDrag !== "undefined") mouseDrag.raycast = () => null;
</script>"""

_HOSTS = ("127.0.0.1", "localhost")  # Another name may be a stranger's.
_SILENCE = 150.0  # Seconds without an answer to Meshcat after which a page is given up.
_PAUSE = 0.002  # Seconds between two messages of a page.

_TEXT, _BINARY, _CLOSE, _PING, _PONG = (
    0x81,
    0x82,
    0x88,
    0x89,
    0x8A,
)  # Kinds of whole websocket messages.
_LONGEST = 500  # Largest size of a message of a page, in bytes.


@contextlib.contextmanager
def served_page(meshcat: Meshcat, controls: LiveControls) -> Iterator[str]:
    """Serves the page to this machine until the end of the block, and yields its address.

    Nobody can guess the address, pages of other origins are refused, and Meshcat gets only what
    `_checked` returns.

    Args:
        meshcat: Viewer of the run.
        controls: Controls of the run, which count what is refused.

    Raises:
        OutputError: If no port can be opened.
    """
    viewer = meshcat.web_url()
    with _open(viewer) as answer:
        page = answer.read().decode().replace("<head>", _SEND, 1)
    page = page.replace("</body>", OVERLAY.read_text(encoding="utf-8") + _START)
    page = page.replace("</body>", (_DRAG if controls.can_drag else _NO_DRAG) + "</body>")
    try:
        server = _Server(viewer, page, controls)
    except OSError as error:
        raise OutputError(f"the live page cannot be served: {error.strerror}") from error
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://{_HOSTS[0]}:{server.server_port}{server.prefix}"
    finally:
        server.shutdown()
        server.server_close()


class _Server(ThreadingHTTPServer):
    """Server of the page of a live run, on a free port of this machine.

    Args:
        viewer: Address of Meshcat.
        page: The page.
        controls: Controls of the run, which count what is refused.

    Attributes:
        prefix: Start of the path of all that it serves.
    """

    def __init__(self, viewer: str, page: str, controls: LiveControls) -> None:
        super().__init__((_HOSTS[0], 0), _Handler)
        self.viewer, self.page, self.controls = viewer, page, controls
        self.prefix = f"/{secrets.token_urlsafe()}/"


class _Handler(BaseHTTPRequestHandler):
    """Answers one request for the page, or relays the messages of one page."""

    server: _Server
    timeout = _SILENCE

    def do_GET(self) -> None:
        """Answers a request."""
        server = self.server
        # The page may be closed while it is sent, and others may ask for what is no address.
        with contextlib.suppress(OSError, ValueError, HTTPException):
            is_socket, part = "Upgrade" in self.headers, self.path.removeprefix(server.prefix)
            if not (self.path.startswith(server.prefix) and self._comes_from_here()):
                server.controls.refuse(int(is_socket))
                self.send_error(403)
            elif is_socket:
                self._relay()
            elif not part:
                self._answer("text/html", server.page.encode())
            elif part == "timeline":
                timeline = json.dumps(server.controls.timeline())
                self._answer("application/json", timeline.encode())
            else:
                with _open(f"{server.viewer}/{part}") as file:
                    self._answer(file.headers.get_content_type(), file.read())

    def log_message(self, *_: object) -> None:
        """Prints nothing."""

    def _comes_from_here(self) -> bool:
        host = self.headers.get("Host", "")
        origin = self.headers.get("Origin", f"http://{host}")
        return host.partition(":")[0] in _HOSTS and origin == f"http://{host}"

    def _answer(self, kind: str, content: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.end_headers()
        self.wfile.write(content)

    def _relay(self) -> None:
        """Connects the page with Meshcat until one of them ends."""
        key = self.headers.get("Sec-WebSocket-Key", "")
        if not re.fullmatch("[A-Za-z0-9+/]{22}==", key):
            raise ValueError
        there = urllib.parse.urlsplit(self.server.viewer)
        with socket.create_connection((there.hostname, there.port), _SILENCE) as drake:
            drake.sendall(_HANDSHAKE.format(there.netloc, key).encode())
            copy = threading.Thread(target=self._copy_from, args=[drake], daemon=True)
            copy.start()
            try:
                for kind, content in _messages(self.rfile):
                    self._pass_on(kind, content, drake)
                    time.sleep(_PAUSE)
            finally:  # A page that is closed drags no more.
                self.server.controls.let_go()
            drake.shutdown(socket.SHUT_RDWR)
            copy.join()

    def _pass_on(self, kind: int, content: bytes, drake: socket.socket) -> None:
        """Passes on a message of the page, unless it is refused: a drag to the controls."""
        controls, message = self.server.controls, None
        if kind == _TEXT:
            with contextlib.suppress(ValueError, RecursionError):
                message = json.loads(content)
        match message:
            case {"type": "mouse_drag", "drag_anchor": [], "drag_target": []}:
                controls.let_go()
            case {"type": "mouse_drag", "drag_anchor": list(p_WA), "drag_target": list(p_WT)} if (
                controls.can_drag and _is_place(p_WA) and _is_place(p_WT)
            ):
                controls.drag(np.array(p_WA), np.array(p_WT))
            case _:
                if (checked := _checked(kind, content, message)) is None:
                    controls.refuse(1)
                else:
                    drake.sendall(checked)

    def _copy_from(self, drake: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while part := drake.recv(1 << 16):
                self.connection.sendall(part)
            self.connection.shutdown(socket.SHUT_RDWR)


_HANDSHAKE = (
    "GET / HTTP/1.1\r\nHost: {}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {}\r\n\r\n"
)


def _messages(file: BufferedIOBase) -> Iterator[tuple[int, bytes]]:
    """Yields kind and content of a page's websocket messages, which are short, masked and whole.

    The first that is not so, as in section 5.2 of RFC 6455, has the kind 0 and is the last.
    """
    while len(head := file.read(2)) == 2 and (kind := head[0]) != _CLOSE:
        size = head[1] - 0x80
        if size == 126:  # The size follows.
            size = int.from_bytes(file.read(2))
        longest = _LONGEST if kind == _TEXT else 125
        if kind not in (_TEXT, _PING, _PONG) or not 0 <= size <= longest or head[1] == 0xFF:
            yield 0, b""
            return
        mask, content = file.read(4), file.read(size)
        if len(mask + content) == 4 + size:
            yield kind, bytes(byte ^ mask[k % 4] for k, byte in enumerate(content))


def _is_place(place: list[Any]) -> bool:
    """Returns whether a list consists of three coordinates in metres, in a world of 2 km."""
    return len(place) == 3 and all(type(x) in (int, float) and abs(x) <= 1e3 for x in place)


def _checked(kind: int, content: bytes, message: object) -> bytes | None:
    """Returns the message for Meshcat that says the same as a page's, or None if it is refused.

    Args:
        kind: Kind of the page's message.
        content: Its content.
        message: Value of a text in JSON, or None.
    """
    if kind == 0:
        return None
    if kind == _TEXT:
        match message:
            case {"type": "button" as type_, "name": str(name)}:
                value = 0.0
            case {"type": "slider" as type_, "name": str(name), "value": int() | float() as value}:
                pass
            case _:
                return None
        text = name.encode(errors="replace")
        if not abs(value) < 1e300 or len(text) > 0xFF:  # Of a number, not infinite or NaN.
            return None
        # MessagePack: a map of three entries, whose values are two strings and a number.
        kind = _BINARY
        content = b"\x83\xa4type\xa6" + type_.encode()
        content += b"\xa4name\xd9" + bytes([len(text)]) + text
        content += b"\xa5value\xcb" + struct.pack(">d", value)
    size = len(content)
    length = bytes([0x80 + size]) if size < 126 else b"\xfe" + size.to_bytes(2)
    return bytes([kind]) + length + bytes(4) + content  # The mask of zeros changes nothing.


def serve_live_run(
    resolved: ResolvedScenario,
    *,
    name: str,
    out: str | Path = "runs",
    announce: Callable[[str], object] = print,
    should_stop: Callable[[], bool] = lambda: False,
) -> None:
    """Runs a scenario in real time in a page with controls, until the user stops it.

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
    with served_page(meshcat, controls) as address:
        announce(address)
        controls.serve(should_stop)
