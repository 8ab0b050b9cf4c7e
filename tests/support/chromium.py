"""A headless Chromium that a test opens a page in, spoken to over its debugging pipe.

One browser serves all tests of a process, each with a tab that shares nothing with another's; it is started again where
it does not answer, and after a test that failed.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SWITCHES = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --disable-extensions --hide-scrollbars --disable-dev-shm-usage "
    "--remote-debugging-pipe"
)
PATIENCE = 120.0  # s, for one answer: a first start beside other tests takes long
STARTS = 3  # times a browser is started that does not answer at all
# The browser reads commands from descriptor 3 and answers on 4.
START = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]
for place, end in zip((3, 4), ends):
    os.dup2(end, place)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Browser:
    """A browser with an empty profile of its own, gone with it."""

    def __init__(self) -> None:
        assert PROGRAM is not None
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._pending = b""
        self._count = 0
        to_read, self._to = os.pipe()
        self._from, from_write = os.pipe()
        switches = [*SWITCHES.split(), f"--user-data-dir={self._profile.name}", "about:blank"]
        self._process = subprocess.Popen(
            [sys.executable, "-c", START, str(to_read), str(from_write), PROGRAM, *switches],
            pass_fds=(to_read, from_write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(from_write)

    def send(self, method: str, params: dict[str, Any], session: str | None = None) -> int:
        """Send a command; its answer will have the number."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        return self._count

    def read(self) -> dict[str, Any]:
        """The next message of the browser."""
        deadline = time.monotonic() + PATIENCE
        while b"\0" not in self._pending:
            if not select.select([self._from], [], [], max(0.0, deadline - time.monotonic()))[0]:
                raise TimeoutError(f"the browser did not answer within {PATIENCE:g} s")
            part = os.read(self._from, 1 << 20)
            if not part:
                raise RuntimeError("the browser ended")
            self._pending += part
        text, self._pending = self._pending.split(b"\0", 1)
        message: dict[str, Any] = json.loads(text)
        return message

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Send a command that is no tab's and return its result."""
        number = self.send(method, params)
        while (answer := self.read()).get("id") != number:
            continue
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        return dict(answer["result"])

    def close(self) -> None:
        """End the browser, if need be by force."""
        with suppress(OSError):
            self.send("Browser.close", {})
        os.close(self._to)
        os.close(self._from)
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._profile.cleanup()


class Page:
    """One tab. ``messages`` holds what it wrote to its console and every exception, ``requests`` what it asked for."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._events: list[dict[str, Any]] = []
        self.messages: list[str] = []
        self.requests: list[str] = []
        self._context = browser.call("Target.createBrowserContext")["browserContextId"]
        target = browser.call("Target.createTarget", url="about:blank", browserContextId=self._context)["targetId"]
        self._session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Send a command and return its result; what happens meanwhile is noted."""
        number = self._browser.send(method, params, self._session)
        while True:
            answer = self._read()
            if answer.get("id") == number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return dict(answer["result"])

    def open(self, address: str) -> None:
        self._events.clear()
        self.call("Page.navigate", url=address)
        while not any(event["method"] == "Page.loadEventFired" for event in self._events):
            self._read()

    def run(self, script: str) -> Any:
        """The value of an expression in the page, awaited."""
        answer = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(json.dumps(answer["exceptionDetails"])[:600])
        return answer["result"].get("value")

    def mouse(self, kind: str, x: float, y: float, *, held: bool = False, clicks: int = 0) -> None:
        button = "left" if held or kind != "mouseMoved" else "none"
        where = {"type": kind, "x": x, "y": y, "button": button, "buttons": int(held), "clickCount": clicks}
        self.call("Input.dispatchMouseEvent", **where)

    def close(self) -> None:
        """Close the tab, and forget all that it kept."""
        self._browser.call("Target.disposeBrowserContext", browserContextId=self._context)

    def _read(self) -> dict[str, Any]:
        message = self._browser.read()
        if message.get("sessionId") == self._session:
            self._note(message)
        return message

    def _note(self, message: dict[str, Any]) -> None:
        params = message.get("params", {})
        match message.get("method"):
            case "Runtime.consoleAPICalled":
                words = " ".join(str(part.get("value", part)) for part in params["args"])
                self.messages.append(f"{params['type']}: {words}")
            case "Runtime.exceptionThrown":
                self.messages.append("exception: " + json.dumps(params["exceptionDetails"])[:600])
            case "Log.entryAdded":
                self.messages.append(f"{params['entry']['level']}: {params['entry']['text']}")
            case "Network.requestWillBeSent":
                self.requests.append(params["request"]["url"])
            case str():
                self._events.append(message)


_kept: list[Browser] = []  # the one that runs, if any


@contextmanager
def browser() -> Iterator[Page]:
    """A tab of its own, closed afterwards."""
    page = _open_page()
    try:
        yield page
    except BaseException:
        close_browser()
        raise
    try:
        page.close()
    except (TimeoutError, RuntimeError, OSError):
        close_browser()


def close_browser() -> None:
    """End the browser, if one runs."""
    while _kept:
        _kept.pop().close()


def _open_page() -> Page:
    """A tab in the browser that runs, or in a new one where none answers."""
    for start in range(1, STARTS + 1):
        try:
            if not _kept:
                _kept.append(Browser())
            return Page(_kept[0])
        except (TimeoutError, RuntimeError, OSError):
            close_browser()
            if start == STARTS:
                raise
    raise AssertionError("the last start returns or raises")
