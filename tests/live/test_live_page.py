"""The live page is for those who know its address, and what they send ends nothing."""

import contextlib
import functools
import http.client
import json
import os
import random
import socket
import threading
import time
import urllib.parse
import urllib.request
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest
from browser import BROWSER, Browser

from drake_pregrasp import load_resolved
from drake_pregrasp.live.live_controls import LiveControls
from drake_pregrasp.live.live_page import served_page
from drake_pregrasp.live.live_run import LiveRun
from drake_pregrasp.simulation.recording import start_meshcat

BUTTON, SLIDER = "stop", "linear velocity [mm/s]"
PRESS = json.dumps({"type": "button", "name": BUTTON}).encode()
ANCHOR, TARGET = [0.1, 0, -0.2], [0.3, 0.25, 1]
SOCKETS = []


@pytest.fixture(autouse=True)
def _closed_sockets():
    yield
    while SOCKETS:
        SOCKETS.pop().close()


class Controls:
    """Counts what is refused, notes what is dragged, and shows nothing."""

    refused, can_drag = 0, True

    def __init__(self):
        self.drags = []

    def refuse(self, count):
        self.refused += count

    def drag(self, p_WA, p_WT):
        self.drags.append([*p_WA, *p_WT])

    def let_go(self):
        self.drags.append(None)

    def timeline(self):
        return {"title": "mine"}


@pytest.fixture
def meshcat():
    meshcat = start_meshcat(live=True)
    meshcat.AddButton(BUTTON)
    meshcat.AddSlider(SLIDER, -1.0, 1.0, 0.1, 0.0)
    return meshcat


@pytest.fixture
def controls():
    return Controls()


@pytest.fixture
def address(meshcat, controls):
    with served_page(meshcat, controls) as address:
        yield urllib.parse.urlsplit(address)


def frame(content, kind=0x81, mask=b"\1\2\3\4"):
    """Returns a websocket message as a browser sends it."""
    size = (
        bytes([0x80 | len(content)]) if len(content) < 126 else b"\xfe" + len(content).to_bytes(2)
    )
    return bytes([kind]) + size + mask + bytes(b ^ mask[k % 4] for k, b in enumerate(content))


def drag(anchor, target):
    """Returns the text of a page whose mouse drags the object, or lets it go."""
    # The page sends the path of what the mouse has hit, too.
    said = {"type": "mouse_drag", "name": "/drake", "drag_anchor": anchor, "drag_target": target}
    return json.dumps(said).encode()


DRAG, LET_GO = drag(ANCHOR, TARGET), drag([], [])


def open_socket(address, path=None, host=None, origin=None):
    """Returns a websocket, or the first line of the answer if it is refused."""
    opened = socket.create_connection((address.hostname, address.port), 20)
    SOCKETS.append(opened)
    lines = [f"GET {path or address.path} HTTP/1.1", f"Host: {host or address.netloc}"]
    lines += ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"]
    lines += ["Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="]
    lines += [f"Origin: {origin}"] if origin else []
    opened.sendall("\r\n".join([*lines, "", ""]).encode())
    answer = opened.recv(12).decode()
    if answer == "HTTP/1.1 101":
        return opened
    return answer


def get(address, path, **headers):
    connection = http.client.HTTPConnection(address.hostname, address.port, timeout=20)
    connection.request("GET", path, headers=headers)
    with connection.getresponse() as answer:
        return answer.status


def eventually(condition):
    end = time.monotonic() + 20
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


def test_only_pages_at_the_address_are_answered(address, controls):
    own, path = f"http://{address.netloc}", address.path
    strange = [
        {"path": "/"},
        {"path": path[:-1]},
        {"path": "/" + "A" * (len(path) - 2) + "/"},
        {"host": f"evil.example:{address.port}"},
        {"host": f"evil.example:{address.port}", "origin": f"http://evil.example:{address.port}"},
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": f"http://127.0.0.1:{address.port + 1}"},
    ]
    for number, change in enumerate(strange, start=1):
        assert open_socket(address, **change) == "HTTP/1.0 403"
        headers = {name.title(): text for name, text in change.items() if name != "path"}
        for part in ("", "timeline", "index.html"):
            assert get(address, change.get("path", path) + part, **headers) == 403
        assert controls.refused == number
    assert get(address, path) == get(address, f"{path}timeline", Origin=own) == 200
    assert isinstance(open_socket(address, origin=own), socket.socket)


def test_what_a_page_says_reaches_meshcat(address, meshcat):
    page = open_socket(address)
    page.sendall(frame(PRESS) + frame(b"", 0x8A))
    page.sendall(frame(json.dumps({"type": "slider", "name": SLIDER, "value": -0.5}).encode()))
    assert eventually(lambda: meshcat.GetSliderValue(SLIDER) == -0.5)
    assert meshcat.GetButtonClicks(BUTTON) == 1


def test_a_drag_reaches_the_controls_until_the_page_lets_go_or_is_closed(address, controls):
    page = open_socket(address)
    page.sendall(frame(DRAG) + frame(LET_GO) + frame(DRAG))
    assert eventually(lambda: len(controls.drags) == 3)
    page.close()
    assert eventually(lambda: len(controls.drags) == 4)
    assert controls.drags == [[*ANCHOR, *TARGET], None] * 2
    assert controls.refused == 0


@pytest.mark.slow
@pytest.mark.parametrize("can_drag", [True, False])
def test_a_page_offers_only_what_the_run_can_do(meshcat, controls, can_drag):
    controls.can_drag = can_drag
    with served_page(meshcat, controls) as address, urllib.request.urlopen(address) as page:
        assert (b"drag the object" in page.read()) == can_drag


def test_an_object_that_cannot_be_dragged_is_not(address, controls):
    controls.can_drag = False
    page = open_socket(address)
    page.sendall(frame(DRAG))
    assert eventually(lambda: controls.refused == 1)
    assert controls.drags == []


MALFORMED = [
    b"\xc1",
    b"",
    b"\x82\xa4type",
    b"[" * 500,
    b"{}",
    b"null",
    b'{"type": "button"}',
    b'{"type": "button", "name": 5}',
    b'{"type": "gamepad", "name": "", "gamepad": {"index": 1}}',
    json.dumps({"type": "slider", "name": SLIDER}).encode(),
    json.dumps({"type": "slider", "name": SLIDER, "value": "1"}).encode(),
    drag(ANCHOR, []),
    drag([], TARGET),
    drag(ANCHOR, TARGET[:2]),
    drag([*ANCHOR, 0], TARGET),
    drag(ANCHOR, "0 0"),
    drag(ANCHOR, None),
    drag(ANCHOR, {"x": 0, "y": 0, "z": 0}),
    *(drag(ANCHOR, [0, 0, x]) for x in ("1", None, [1], True, 1e4, -(10**400))),
    *(DRAG.replace(b"0.25", value) for value in (b"NaN", b"Infinity", b"-1e309")),
    json.dumps({"type": "mouse_drag", "drag_anchor": ANCHOR}).encode(),
    *(
        f'{{"type": "slider", "name": "{SLIDER}", "value": {value}}}'.encode()
        for value in ("NaN", "Infinity", "-1e309", "1" + 309 * "0", "[1]")
    ),
]


def test_malformed_messages_are_refused_and_counted(address, controls, meshcat):
    page = open_socket(address)
    for number, message in enumerate(MALFORMED, start=1):
        page.sendall(frame(message))
        assert eventually(lambda number=number: controls.refused == number), message
    page.sendall(frame(PRESS))
    assert eventually(lambda: meshcat.GetButtonClicks(BUTTON) == 1)
    assert meshcat.GetSliderValue(SLIDER) == 0
    assert controls.drags == []


@pytest.mark.parametrize(
    "sent",
    [
        b"\xff" * 14,
        frame(b"\xc1", 0x82),
        frame(PRESS, 0x01),
        frame(b"", 0x80),
        b"\x81" + bytes([len(PRESS)]) + PRESS,  # Without a mask.
        b"\x81\xfe\xff\xff" + bytes(70_000),
        b"\x81\xff" + bytes(8),
        frame(PRESS)[:-3],
    ],
)
def test_broken_websockets_are_closed(address, controls, meshcat, sent):
    page = open_socket(address)
    page.sendall(sent)
    page.shutdown(socket.SHUT_WR)
    while page.recv(1 << 16):  # What Meshcat has sent until it is closed.
        pass
    assert controls.refused == (sent != frame(PRESS)[:-3])  # That may be a lost connection.
    other = open_socket(address)
    other.sendall(frame(PRESS))
    assert eventually(lambda: meshcat.GetButtonClicks(BUTTON) == 1)


def test_random_messages_end_nothing(address, meshcat):
    """Bytes of good messages are changed, cut and repeated."""
    chance = random.Random(1)
    good = [
        frame(PRESS),
        frame(DRAG),
        frame(LET_GO),
        frame(b"", 0x89),
        frame(PRESS[:-1]),
        *map(frame, MALFORMED),
    ]
    for _ in range(int(os.environ.get("FUZZED_MESSAGES", "300")) // 10):
        page = open_socket(address)
        for _ in range(10):
            sent = bytearray(chance.choice(good) * chance.randint(1, 2))
            for _ in range(chance.randint(0, 3)):
                sent[chance.randrange(len(sent))] = chance.randrange(256)
            with contextlib.suppress(OSError):  # It may be closed.
                page.sendall(sent[: chance.randint(1, len(sent))])
        page.close()
    before = meshcat.GetButtonClicks(BUTTON)
    page = open_socket(address)
    page.sendall(frame(PRESS))
    assert eventually(lambda: meshcat.GetButtonClicks(BUTTON) > before)


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="needs Chromium (Debian: chromium)")
def test_a_page_of_another_origin_reads_and_presses_nothing(address, controls, meshcat, tmp_path):
    """Even if it knows the address."""
    (tmp_path / "evil.html").write_text("<p>evil</p>")
    handler = functools.partial(SimpleHTTPRequestHandler, directory=tmp_path)
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    browser = Browser(tmp_path / "profile", f"http://127.0.0.1:{server.server_port}/evil.html")
    try:
        browser.until('document.body?.innerText === "evil"')
        url = address.geturl()
        for mode in ("cors", "no-cors"):
            read = f'fetch("{url}timeline", {{mode: "{mode}"}}).then(a => a.text(), () => "")'
            assert browser.value(read) == ""
        told = f"""new Promise(resolve => {{
            const opened = new WebSocket("{url.replace("http", "ws")}");
            opened.onopen = () => {{
                opened.send({json.dumps(PRESS.decode())});
                opened.send({json.dumps(DRAG.decode())});
            }};
            opened.onmessage = () => resolve("read");
            opened.onclose = () => resolve("closed");
        }})"""
        assert browser.value(told) == "closed"
        framed = f"""new Promise(resolve => {{
            const inside = document.body.appendChild(document.createElement("iframe"));
            inside.onload = () => resolve(String(inside.contentDocument));
            inside.src = "{url}";
        }})"""
        assert browser.value(framed) == "null"
    finally:
        browser.close()
        server.shutdown()
        server.server_close()
    assert controls.refused == 1
    assert meshcat.GetButtonClicks(BUTTON) == 0
    assert not any(controls.drags)


@pytest.mark.slow
def test_a_flood_of_clicks_does_not_hold_up_the_run(tmp_path):
    meshcat = start_meshcat(live=True)
    run = LiveRun(load_resolved("a_base"), name="a_base", meshcat=meshcat)
    controls = LiveControls(run, meshcat, out=tmp_path)
    names = ("reset", "next strategy", "object: hide / show", "finger 1: lose / give back")
    with served_page(meshcat, controls) as url:
        page = open_socket(urllib.parse.urlsplit(url))
        for name in names:
            page.sendall(frame(json.dumps({"type": "button", "name": name}).encode()) * 100)
        assert eventually(lambda: meshcat.GetButtonClicks(names[-1]) == 100)
        loops = iter([False] * 12)
        start = time.monotonic()
        controls.serve(lambda: next(loops, True))
        assert time.monotonic() - start < 10
        assert controls.refused == 99 * len(names)
        assert f"{controls.refused} messages refused" in controls.timeline()["note"]
        page.sendall(frame(json.dumps({"type": "button", "name": "reset"}).encode()) * 100)
        page.sendall(frame(PRESS))
        assert eventually(lambda: meshcat.GetButtonClicks(BUTTON) == 1)
        controls.apply()
        assert controls.is_stopped
