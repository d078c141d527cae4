"""A real Chromium without a window, driven through its debugging pipe."""

import base64
import contextlib
import fcntl
import itertools
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--hide-scrollbars",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-unsafe-swiftshader",
    "--window-size=900,700",
]
PATIENCE = 60.0
"""Seconds after which a test gives up to wait for the browser."""


class Browser:
    """One page of a browser.

    Args:
        profile: Folder of the browser's profile.
        address: Address to open.
    """

    def __init__(self, profile: Path, address: str) -> None:
        self._numbers, self._read = itertools.count(1), b""
        theirs, self._out = os.pipe()
        self._in, answers = os.pipe()
        # The browser reads commands from file 3, and writes answers to file 4.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (theirs, answers)]
        flags = [*FLAGS, "--remote-debugging-pipe", f"--user-data-dir={profile}"]
        self._process = subprocess.Popen(
            [str(BROWSER), *flags, "about:blank"],
            pass_fds=(3, 4),
            preexec_fn=lambda: [os.dup2(end, place) for place, end in enumerate(ends, 3)],
            stderr=subprocess.DEVNULL,
        )
        for end in ends:
            os.close(end)
        os.close(theirs)
        os.close(answers)
        self._session = None
        target = self.ask("Target.createTarget", url=address)["targetId"]
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]

    def close(self) -> None:
        with contextlib.suppress(OSError, TimeoutError):
            self._session = None
            self.ask("Browser.close")
        self._process.terminate()
        self._process.wait(timeout=PATIENCE)

    def ask(self, method: str, **parameters: object) -> dict:
        """Returns the browser's answer to a command of its debugging protocol."""
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._read:
                if not select.select([self._in], [], [], PATIENCE)[0]:
                    raise TimeoutError(method)
                if not (part := os.read(self._in, 1 << 20)):
                    raise OSError("the browser has ended")
                self._read += part
            text, _, self._read = self._read.partition(b"\0")
            answer = json.loads(text)
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]

    def value(self, expression: str) -> object:
        """Returns the value of a JavaScript expression in the page, or of its promise."""
        options = {"returnByValue": True, "awaitPromise": True}
        answer = self.ask("Runtime.evaluate", expression=expression, **options)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def until(self, expression: str) -> object:
        """Returns the first true value of a JavaScript expression."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if value := self.value(expression):
                return value
            time.sleep(0.05)
        raise TimeoutError(expression)

    def picture(self) -> bytes:
        """Returns a PNG picture of the page."""
        return base64.b64decode(self.ask("Page.captureScreenshot")["data"])
