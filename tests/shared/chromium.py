"""A headless Chromium on a pipe: the DevTools protocol without any package (JSON texts, ended by a zero byte)."""

from __future__ import annotations

import base64
import contextlib
import fcntl
import json
import os
import select
import shutil
import signal
import tempfile
import time as clock
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-dev-shm-usage"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-extensions"),
    *("--remote-debugging-pipe", "--hide-scrollbars", "about:blank"),
)
PATIENCE = 60.0  # [s] for one answer; a busy machine takes ten to start the browser


def find() -> str | None:
    """Return the path of an installed Chromium or Chrome."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


MARKS = [
    pytest.mark.browser,
    pytest.mark.skipif(find() is None, reason="no Chromium or Chrome on this machine"),
]


@dataclass
class Browser:
    """One page of a running browser; events: what it reported, in order."""

    write: int
    read: int
    events: list[dict[str, Any]] = field(default_factory=list)
    session: str = ""
    count: int = 0
    rest: bytes = b""

    def call(self, method: str, **params: Any) -> Any:
        """Send a command and return its result."""
        self.count += 1
        message = {"id": self.count, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.write, json.dumps(message).encode() + b"\0")
        end = clock.monotonic() + PATIENCE
        while True:
            answer = self.receive(end)
            if answer.get("id") == self.count:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']['message']}")
                return answer["result"]
            self.events.append(answer)

    def receive(self, end: float) -> dict[str, Any]:
        """Return the next message, at the latest at ``end``."""
        while b"\0" not in self.rest:
            if not select.select([self.read], [], [], max(0.0, end - clock.monotonic()))[0]:
                raise TimeoutError("the browser does not answer")
            part = os.read(self.read, 1 << 20)
            if not part:
                raise EOFError("the browser has gone")
            self.rest += part
        text, self.rest = self.rest.split(b"\0", 1)
        answer: dict[str, Any] = json.loads(text)
        return answer

    def evaluate(self, script: str) -> Any:
        """Return the value of an expression in the page; a promise is awaited."""
        options = {"returnByValue": True, "awaitPromise": True, "userGesture": True}
        result = self.call("Runtime.evaluate", expression=script, **options)
        if "exceptionDetails" in result:
            raise RuntimeError(json.dumps(result["exceptionDetails"])[:500])
        return result["result"].get("value")

    def wait(self, script: str, seconds: float = PATIENCE) -> Any:
        """Wait until an expression in the page is true, and return its value."""
        end = clock.monotonic() + seconds
        while clock.monotonic() < end:
            # A click may have led to another page, which takes the question with it: it is put again.
            with contextlib.suppress(RuntimeError) if clock.monotonic() < end - 1.0 else contextlib.nullcontext():
                if value := self.evaluate(script):
                    return value
            clock.sleep(0.05)
        raise TimeoutError(f"never true: {script}")

    def open(self, address: str, width: int = 1400, height: int = 900, dark: bool = False) -> None:
        """Open a page in a window of that size [px]."""
        self.events.clear()
        self.resize(width, height)
        feature = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[feature])
        self.call("Page.navigate", url=address)
        self.wait(f"location.href === {json.dumps(address)} && document.readyState === 'complete'")

    def resize(self, width: int, height: int = 900) -> None:
        """Give the window another size [px]."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
        self.call("Emulation.setDeviceMetricsOverride", **size)

    def press(self, key: str, code: int) -> None:
        """Press and release a key."""
        text = {"text": "\r"} if key == "Enter" else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, windowsVirtualKeyCode=code, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=code)

    def screenshot(self, file: Path) -> None:
        """Write a picture of the whole page."""
        data = self.call("Page.captureScreenshot", captureBeyondViewport=True)["data"]
        file.write_bytes(base64.b64decode(data))

    def requests(self) -> list[str]:
        """Return the addresses that the page asked for since it was opened."""
        return [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]

    def complaints(self) -> list[str]:
        """Return exceptions, console errors and warnings since the page was opened."""
        result = []
        for event in self.events:
            params = event.get("params", {})
            if event["method"] == "Runtime.exceptionThrown":
                result.append(json.dumps(params["exceptionDetails"])[:500])
            elif event["method"] == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
                result.append(json.dumps(params["args"])[:500])
            elif event["method"] == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
                result.append(params["entry"]["text"])
        return result


@contextlib.contextmanager
def browser(program: str) -> Iterator[Browser]:
    """Start a browser with an empty profile and end it with everything it started."""
    with tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True) as profile:
        process, write, read = _start(program, [*FLAGS, f"--user-data-dir={profile}"])
        try:
            page = Browser(write, read)
            target = page.call("Target.createTarget", url="about:blank")["targetId"]
            page.session = page.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
            for domain in ("Page", "Runtime", "Network", "Log"):
                page.call(f"{domain}.enable")
            yield page
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process, signal.SIGKILL)
            os.waitpid(process, 0)
            os.close(write)
            os.close(read)


def lend_page() -> Iterator[Browser]:
    """Yield a page of a browser of its own: what a module's fixture ``page`` is.  Skips where there is no browser."""
    program = find()
    if program is None:
        pytest.skip("no Chromium or Chrome on this machine")
    with browser(program) as page:
        yield page


def _start(program: str, flags: list[str]) -> tuple[int, int, int]:
    """Start the browser, which reads commands from descriptor 3 and answers on 4."""
    theirs_read, ours_write = os.pipe()
    ours_read, theirs_write = os.pipe()
    # Copies far up, so that putting them to 3 and 4 overwrites none of them.
    inner = [fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 100) for fd in (theirs_read, theirs_write)]
    null = os.open(os.devnull, os.O_RDWR)
    actions = [
        (os.POSIX_SPAWN_DUP2, fd, place) for fd, place in zip((*inner, null, null, null), (3, 4, 0, 1, 2), strict=True)
    ]
    process = os.posix_spawn(program, [program, *flags], os.environ, file_actions=actions, setpgroup=0)
    for fd in (theirs_read, theirs_write, *inner, null):
        os.close(fd)
    return process, ours_write, ours_read
