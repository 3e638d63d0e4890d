"""`--notify`: each event of a trouble to a command, or to an address by HTTP.

A command gets the event as JSON on standard input, and its line in `MODLENS_TEXT`; an address gets
the JSON in a POST. One at a time, in the order of the events; what fails is tried again twice.
"""

from __future__ import annotations

import json
import os
import queue
import shlex
import shutil
import subprocess
import threading
import urllib.error
import urllib.request
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import _modlens
from dissectors.errors import UsageError

__all__ = ["Notifier"]

WAITING = 256
"""Events that may wait; of more, the newest are lost, which is reported."""

TRIES = 3
_PAUSE_S = 2.0
_TIMEOUT_S = 20.0


class Notifier:
    """Sends events to one command or URL, in a thread of its own.

    `say` is called in the thread of `put` when something fails. `UsageError` where there is no such
    program.
    """

    def __init__(
        self, target: str, say: Callable[[str], None], *, pause_s: float = _PAUSE_S
    ) -> None:
        self.name = target
        self._say, self._pause_s = say, pause_s
        self._send = _poster(target) if "://" in target else _runner(target)
        self._waiting: queue.Queue[Mapping[str, Any] | None] = queue.Queue(WAITING)
        self._failures: deque[str] = deque(maxlen=WAITING)
        self._is_closing = threading.Event()
        self._thread = threading.Thread(target=self._work, name="notify", daemon=True)
        self._thread.start()

    def __call__(self, event: Mapping[str, Any]) -> None:
        """Send an event as soon as those before it are sent."""
        try:
            self._waiting.put_nowait(event)
        except queue.Full:
            self._failures.append("too many events are waiting: one is lost")

    def put(self, batch: _modlens.Batch) -> None:
        """Report what has failed; see `analyzer.pump.Sink`."""
        while self._failures:
            self._say(f"--notify {self.name}: {self._failures.popleft()}")

    def close(self) -> None:
        """Send what is waiting, without further tries, and report what has failed."""
        self._is_closing.set()
        self._waiting.put(None)
        self._thread.join(_TIMEOUT_S)
        while self._failures:
            self._say(f"--notify {self.name}: {self._failures.popleft()}")

    def _work(self) -> None:
        while (event := self._waiting.get()) is not None:
            for left in reversed(range(TRIES)):
                try:
                    self._send(event)
                    break
                except (OSError, ValueError, subprocess.SubprocessError) as error:
                    if not left or self._is_closing.wait(self._pause_s):
                        self._failures.append(f"{_reason(error)}; lost: {event['text']}")
                        break


def _reason(error: Exception) -> str:
    if isinstance(error, urllib.error.HTTPError):
        return f"the server answers {error.code} {error.reason}"
    if isinstance(error, urllib.error.URLError):
        return str(error.reason)
    if isinstance(error, subprocess.CalledProcessError):
        return f"exit status {error.returncode}"
    return str(error)


def _poster(url: str) -> Callable[[Mapping[str, Any]], None]:
    """What sends an event to a URL."""
    if not url.startswith(("http://", "https://")):
        raise UsageError(f"--notify {url}: write http://, https://, or a command")

    def post(event: Mapping[str, Any]) -> None:
        request = urllib.request.Request(
            url,
            data=json.dumps(event).encode(),
            headers={
                "Content-Type": "application/json",
                "User-Agent": f"modlens/{_modlens.__version__}",
            },
            method="POST",
        )
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S):
            pass

    return post


def _runner(command: str) -> Callable[[Mapping[str, Any]], None]:
    """What runs a command for an event."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise UsageError(f"--notify {command}: {error}") from error
    if not words or shutil.which(words[0]) is None:
        raise UsageError(f"--notify {command}: there is no such program")

    def run(event: Mapping[str, Any]) -> None:
        subprocess.run(
            words,
            input=json.dumps(event).encode(),
            env={**os.environ, "MODLENS_TEXT": str(event["text"])},
            stdout=subprocess.DEVNULL,
            timeout=_TIMEOUT_S,
            check=True,
        )

    return run
