"""A page in Debian's Chromium, by the wire protocol of chromedriver: nothing but JSON over HTTP."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.conftest import need_program

__all__ = ["Browser", "running"]

ARGUMENTS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
)


class Browser:
    """A window of the browser. What `log` gives is not given again."""

    def __init__(self, port: int, folder: Path) -> None:
        self._base = f"http://127.0.0.1:{port}"
        capabilities = {
            "browserName": "chrome",
            "goog:chromeOptions": {"args": [*ARGUMENTS, f"--user-data-dir={folder}"]},
            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
        }
        made = self._call("POST", "/session", {"capabilities": {"alwaysMatch": capabilities}})
        self._session = f"/session/{made['sessionId']}"

    def open(self, path: Path | str, state: str | None = "drawn") -> None:
        """Open a page, and wait until it says that it is in this state."""
        url = path.as_uri() if isinstance(path, Path) else path
        self._call("POST", f"{self._session}/url", {"url": url})
        if state is not None:
            self.wait(f"document.documentElement.dataset.state === {json.dumps(state)}")

    def run(self, script: str, *arguments: Any) -> Any:
        """What a script of the page returns."""
        body = {"script": script, "args": list(arguments)}
        return self._call("POST", f"{self._session}/execute/sync", body)

    def ask(self, promise: str, *arguments: Any) -> Any:
        """What a promise of the page is fulfilled with; the script is an expression."""
        script = (
            "const done = arguments[arguments.length - 1];"
            f"Promise.resolve({promise}).then(done, (error) => done('error: ' + error.message));"
        )
        body = {"script": script, "args": list(arguments)}
        return self._call("POST", f"{self._session}/execute/async", body)

    def wait(self, condition: str, seconds: float = 20) -> None:
        """Wait until an expression is true; `AssertionError` where it never is."""
        end = time.monotonic() + seconds
        while not self.run(f"return Boolean({condition})"):
            assert time.monotonic() < end, f"{condition}: {self.log('browser')}"
            time.sleep(0.02)

    def command(self, name: str, **parameters: Any) -> Any:
        """A command of the browser's own protocol."""
        body = {"cmd": name, "params": parameters}
        return self._call("POST", f"{self._session}/goog/cdp/execute", body)

    def shape(
        self, width: int, height: int = 900, *, scheme: str = "light", media: str = ""
    ) -> None:
        """The size of the window, dark or light, on a screen or on paper."""
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.command("Emulation.setEmulatedMedia", media=media, features=features)

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Write a picture of the window, or of the whole page."""
        found = self.command("Page.captureScreenshot", captureBeyondViewport=whole, format="png")
        path.write_bytes(base64.b64decode(found["data"]))

    def send_file(self, selector: str, path: Path) -> None:
        """Choose a file in an input of the page."""
        found = self._call(
            "POST", f"{self._session}/element", {"using": "css selector", "value": selector}
        )
        element = next(iter(found.values()))
        self._call("POST", f"{self._session}/element/{element}/value", {"text": str(path)})

    def press(self, actions: Sequence[Mapping[str, Any]]) -> None:
        """Carry out a sequence of pointer actions."""
        pointer = {"type": "pointer", "id": "mouse", "actions": list(actions)}
        self._call("POST", f"{self._session}/actions", {"actions": [pointer]})

    def log(self, kind: str) -> list[dict[str, Any]]:
        """The entries of a log: browser (the console) or performance (requests)."""
        found: list[dict[str, Any]] = self._call("POST", f"{self._session}/se/log", {"type": kind})
        return found

    def requests(self) -> list[str]:
        """The addresses that were asked for since the last time."""
        events = [json.loads(entry["message"])["message"] for entry in self.log("performance")]
        sent = [one for one in events if one["method"] == "Network.requestWillBeSent"]
        addresses = [one["params"]["request"]["url"] for one in sent]
        # What the browser shows before the first page, and what is inside a page.
        return [one for one in addresses if not one.startswith(("chrome:", "data:", "blob:"))]

    def close(self) -> None:
        """End the browser."""
        self._call("DELETE", self._session)

    def _call(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        head = {"Content-Type": "application/json"}
        request = urllib.request.Request(self._base + path, data, head, method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(f"{path}: {error.read().decode()[:2000]}") from error


@contextmanager
def running(folder: Path) -> Iterator[Browser]:
    """A browser that leaves its files in this folder, until the block ends.

    The test is skipped where it is not installed.
    """
    need_program("chromium")
    log = folder / "driver.log"
    with log.open("w") as output:
        environment = {**os.environ, "HOME": str(folder)}
        command = [need_program("chromedriver"), "--port=0"]
        driver = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
        try:
            browser = Browser(_port_in(log), folder / "profile")
            try:
                yield browser
            finally:
                browser.close()
        finally:
            driver.terminate()
            driver.wait()


def _port_in(log: Path) -> int:
    """The port that the driver has chosen, when it says so."""
    end = time.monotonic() + 20
    while time.monotonic() < end:
        _, said, rest = log.read_text("utf-8").partition("successfully on port ")
        if said and "." in rest:
            return int(rest.partition(".")[0])
        time.sleep(0.05)
    raise AssertionError(f"chromedriver does not begin: {log.read_text('utf-8')}")
