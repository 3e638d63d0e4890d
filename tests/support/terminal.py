"""A real terminal for tests: tmux, its own server, a window of any size.

with Terminal(80, 24, "modlens", "tap", ...) as terminal:
    terminal.wait_for("unit")
    terminal.press("q")
"""

from __future__ import annotations

import os
import shlex
import subprocess
import time
from collections.abc import Callable
from typing import Self

from tests.conftest import ROOT, TIMEOUT_S, environment, need_program

SCREEN_TIMEOUT_S = 20.0


class Terminal:
    """A program in a window; used by `with`. The test is skipped where there is no tmux."""

    def __init__(self, width: int, height: int, *words: str) -> None:
        """Describe the window."""
        self._tmux = [
            need_program("tmux"),
            "-L",
            f"modlens{os.getpid()}-{id(self)}",
            "-f",
            "/dev/null",
        ]
        self._size = ("-x", str(width), "-y", str(height))
        self._words = words

    def screen(self, *options: str) -> str:
        """What is on the screen, without spaces at the ends of lines; `-e` keeps colours."""
        text = self._run("capture-pane", "-p", *options)
        return "\n".join(line.rstrip() for line in text.splitlines())

    def wait_for(self, wanted: str | Callable[[str], bool]) -> str:
        """The screen, once it shows that; AssertionError if it never does."""
        until = time.monotonic() + SCREEN_TIMEOUT_S
        while True:
            shown = self.screen()
            if wanted in shown if isinstance(wanted, str) else wanted(shown):
                return shown
            assert time.monotonic() < until, f"{wanted!r} did not come:\n{shown}"
            time.sleep(0.05)

    def press(self, *keys: str) -> None:
        """Type."""
        self._run("send-keys", *keys)

    def resize(self, width: int, height: int) -> None:
        """Another size of the window."""
        self._run("resize-window", "-x", str(width), "-y", str(height))

    def _run(self, *words: str) -> str:
        done = subprocess.run(
            [*self._tmux, *words], capture_output=True, text=True, check=True, timeout=TIMEOUT_S
        )
        return done.stdout

    def __enter__(self) -> Self:
        """Start it; the window stays when the program has ended."""
        program = shlex.join(self._words)
        changes = {"TERM": "screen-256color", "LANG": "C.UTF-8", "LC_ALL": "C.UTF-8"}
        subprocess.run(
            [*self._tmux, "-u", "new-session", "-d", *self._size, f"{program}; sleep 60"],
            check=True,
            timeout=TIMEOUT_S,
            env=environment(**changes),
            cwd=ROOT,
        )
        return self

    def __exit__(self, *error: object) -> None:
        """End it and its server."""
        subprocess.run([*self._tmux, "kill-server"], check=False, timeout=TIMEOUT_S)
