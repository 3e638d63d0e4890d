"""A page in Firefox, by its own protocol Marionette: JSON over a connection, nothing else."""

from __future__ import annotations

import json
import socket
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tests.conftest import need_program

__all__ = ["Firefox", "running"]

PREFERENCES: Mapping[str, bool | int | str] = {
    "marionette.port": 0,
    "browser.shell.checkDefaultBrowser": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "toolkit.telemetry.reportingpolicy.firstRun": False,
    "app.update.enabled": False,
    "network.captive-portal-service.enabled": False,
    "network.connectivity-service.enabled": False,
}


class Firefox:
    """A window of the browser."""

    def __init__(self, port: int) -> None:
        self._connection = socket.create_connection(("127.0.0.1", port), timeout=120)
        self._stream = self._connection.makefile("rb")
        self._number = 0
        self._read()
        self._call("WebDriver:NewSession", {})
        self._call("WebDriver:SetTimeouts", {"script": 120_000})

    def open(self, path: Path, state: str) -> None:
        """Open a page, and wait until it says that it is in this state."""
        self._call("WebDriver:Navigate", {"url": path.as_uri()})
        self.wait(f"document.documentElement.dataset.state === {json.dumps(state)}")

    def run(self, script: str, *arguments: Any) -> Any:
        """What a script of the page returns."""
        return self._call("WebDriver:ExecuteScript", {"script": script, "args": list(arguments)})[
            "value"
        ]

    def ask(self, promise: str, *arguments: Any) -> Any:
        """What a promise of the page is fulfilled with; the script is an expression."""
        script = (
            "const done = arguments[arguments.length - 1];"
            f"Promise.resolve({promise}).then(done, (error) => done('error: ' + error.message));"
        )
        return self._call(
            "WebDriver:ExecuteAsyncScript", {"script": script, "args": list(arguments)}
        )["value"]

    def wait(self, condition: str, seconds: float = 60) -> None:
        """Wait until an expression is true; `AssertionError` where it never is."""
        end = time.monotonic() + seconds
        while not self.run(f"return Boolean({condition})"):
            assert time.monotonic() < end, condition
            time.sleep(0.05)

    def send_file(self, selector: str, path: Path) -> None:
        """Choose a file in an input of the page."""
        element = self._element(selector)
        self._call("WebDriver:ElementSendKeys", {"id": element, "text": str(path)})

    def click(self, selector: str) -> None:
        """Click as a person does."""
        self._call("WebDriver:ElementClick", {"id": self._element(selector)})

    def close(self) -> None:
        """End the connection."""
        self._stream.close()
        self._connection.close()

    def _element(self, selector: str) -> str:
        found = self._call("WebDriver:FindElement", {"using": "css selector", "value": selector})
        return str(next(iter(found["value"].values())))

    def _call(self, name: str, parameters: Mapping[str, Any]) -> Any:
        self._number += 1
        body = json.dumps([0, self._number, name, parameters]).encode()
        self._connection.sendall(b"%d:%s" % (len(body), body))
        _, number, error, value = self._read()
        assert number == self._number
        assert error is None, error
        return value

    def _read(self) -> Any:
        """The next message: its length, a colon, JSON."""
        digits = b""
        while (digit := self._stream.read(1)) != b":":
            assert digit, "Firefox has ended the connection"
            digits += digit
        return json.loads(self._stream.read(int(digits)))


@contextmanager
def running(
    folder: Path, preferences: Mapping[str, bool | int | str] = MappingProxyType({})
) -> Iterator[Firefox]:
    """A browser that leaves its files in this folder, until the block ends.

    The test is skipped where it is not installed.
    """
    profile = folder / "profile"
    profile.mkdir()
    wanted = {**PREFERENCES, **preferences}
    lines = [f"user_pref({json.dumps(key)}, {json.dumps(it)});" for key, it in wanted.items()]
    (profile / "user.js").write_text("\n".join(lines))
    program = need_program("firefox-esr")
    words = [program, "--headless", "--marionette", "--no-remote", "--profile", str(profile)]
    silent = subprocess.DEVNULL
    browser = subprocess.Popen(words, stdout=silent, stderr=silent, env=_environment(folder))
    try:
        window = Firefox(_port_in(profile / "MarionetteActivePort"))
        try:
            yield window
        finally:
            window.close()
    finally:
        browser.terminate()
        try:
            browser.wait(20)
        except subprocess.TimeoutExpired:
            browser.kill()
            browser.wait()


def _environment(folder: Path) -> dict[str, str]:
    """No display, no home but this folder."""
    return {"HOME": str(folder), "PATH": "/usr/bin:/bin", "MOZ_HEADLESS": "1"}


def _port_in(path: Path) -> int:
    """The port that the browser has chosen, when it says so."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        if path.exists() and (text := path.read_text().strip()):
            return int(text)
        time.sleep(0.05)
    raise AssertionError("Firefox does not begin")
