"""Every format and command with hostile texts on a terminal: no character may take it over.

    python -m tests.faults.terminal_walk FOLDER

Each case runs in a fork of a process that has everything loaded, with standard output and error on
a pseudo terminal of its own that changes nothing (no CR before LF). It prints what fell.
"""

from __future__ import annotations

import importlib
import os
import pty
import re
import signal
import sys
import threading
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

from analyzer.cli import COMMANDS, module_of
from analyzer.columns import TABLES
from analyzer.exports import FORMATS, load
from dissectors import importers
from tests.faults.hostile_inputs import HOSTILE, MAPS, UNSAFE, bus_file, frames, make
from tests.support.forked_command import become_command

__all__ = ["run"]

RECORDINGS = ("text", "raw", "pcapng", "zip", "mail", "chunks", "damaged", "nothing")
WALL_S = 60

SHOWN = [
    ["stats"], ["map"], ["learn"], ["match"], ["decode"], ["decode", "--strict", "--detect"],
    ["show", "--frame", "4"], ["show", "--txn", "3"], ["show", "--frame", "1000"],
    ["doctor"], ["doctor", "--to", "json"], ["doctor", "--to", "md"], ["doctor", "--to", "csv"],
]  # fmt: skip
"""The commands that read recordings, with the formats that they have of their own."""

TAPS = [[], ["--to", "csv"], ["--to", "influx"], ["--doctor"]]
"""Options of taps of a bus with a hostile name."""

OPTIONS = (
    "--where", "--between", "--columns", "--table", "--to", "--style", "--times", "--timezone",
    "--date", "--profile", "--bus", "--functions", "--dialects", "--line", "--baud", "--channels",
    "--mode", "--port", "--from", "--limit", "-o", "--no-such", "--t35",
)  # fmt: skip
"""Options whose value is named in the message that refuses it."""


def cases(made: dict[str, Path]) -> Iterator[list[str]]:
    """The words of each run."""
    every = {name: str(path) for name, path in made.items()}
    for name in RECORDINGS:
        yield from ([*words[:1], every[name], *words[1:]] for words in SHOWN)
    for command in ("decode", "export"):
        for form in ("table", *FORMATS):
            for name in ("text", "pcapng"):
                yield [command, every[name], "--to", form]
    for table in TABLES:
        for form in ("table", "csv", "jsonl", "txt", "md"):
            yield ["decode", every["pcapng"], "--table", table, "--to", form]
    for form in FORMATS:
        yield from (["export", every["pcapng"], "--to", form, "--style", style]
                    for style in load(form).styles)  # fmt: skip
    yield from _with_tables(every)
    yield from _of_profiles(every)
    yield from _wrong_use(every)


def _with_tables(every: dict[str, str]) -> Iterator[list[str]]:
    """Names from profiles, bus files, function tables and dialects."""
    for option in ("profile", "bus", "functions", "dialects"):
        for words in (*SHOWN, ["decode", "--table", "readings"]):
            if option == "dialects" and words[0] == "show":
                continue
            yield [words[0], every["raw"], *words[1:], f"--{option}", every[option]]
    yield ["explain", "list", "--functions", every["functions"]]
    yield ["decode", every["text"], "--table", "readings", "--profile", every["profile"],
           "--to", "influx"]  # fmt: skip
    yield ["formats", "--dialects", every["dialects"]]
    yield ["explain", "0x41", "--functions", every["functions"]]
    yield ["craft", "0x41", "unit=1", "data=1b5b324a", "--functions", every["functions"]]
    yield ["craft", "0x41", "unit=1", "data=1b5b324a", "--to", "raw"]
    yield ["match", every["raw"], "--with", every["profile"]]
    yield ["show", "01 41 1b 5b 32 4a", "--functions", every["functions"]]
    yield ["extcap", every["nothing"]]
    yield ["ports", HOSTILE]


def _of_profiles(every: dict[str, str]) -> Iterator[list[str]]:
    written = [name for name, form in importers.FORMATS.items() if form.writes]
    yield ["profiles", "check", every["profile"]]
    yield ["profiles", "list"]
    yield from (["profiles", "convert", every["profile"], "--to", form] for form in written)
    folder = str(Path(every["text"]).parent)
    yield ["import", "auto", folder]
    yield ["decode", folder]
    for name in MAPS:
        yield ["import", "auto", every[f"map {name}"]]
        for form in written:
            base = ["--base", "0"] if name == "csv" else []
            yield ["import", name, every[f"map {name}"], *base, "--to", form]


def _wrong_use(every: dict[str, str]) -> Iterator[list[str]]:
    """What a user may have copied from elsewhere."""
    yield from ([command, HOSTILE] for command in COMMANDS if command not in ("tap", "formats"))
    yield from (["decode", every["text"], option, HOSTILE] for option in OPTIONS)
    yield [HOSTILE]
    yield ["tap", every["nothing"]]
    yield ["tap", every["nothing"], "--mqtt", f"mqtt://{HOSTILE}"]
    yield ["explain", "exception", HOSTILE]
    yield ["import", HOSTILE, every["text"]]
    yield ["export", every["text"], "-o", f"{every['nothing']}/x.csv"]
    yield ["export", every["text"], "-o", f"{every['nothing']}.csv"]
    yield ["craft", "3", f"{HOSTILE}={HOSTILE}"]


def run(folder: Path) -> list[str]:
    """Run all cases; gives a line about each that fell."""
    for command in COMMANDS:
        importlib.import_module(module_of(command))
    made, fell, count = make(folder), [], 0
    for words in cases(made):
        count += 1
        fell += _wrong(words, *_on_terminal(words))
    for words in TAPS:
        count += 1
        fell += _wrong(["tap", *words], *_tapped(words, folder))
    return [*fell, f"{count} cases, {len(fell)} fell"]


def _wrong(words: list[str], status: int, got: bytes) -> list[str]:
    """What is wrong with a case, as a line; none if nothing is."""
    text = got.decode("utf-8", "surrogateescape")
    if b"Traceback" in got or status not in range(5):
        return [f"{words}: status {status}: {text[-500:]!a}"]
    if not got and words[-2:-1] != ["-o"]:
        return [f"{words}: nothing on the terminal"]
    if found := re.search(UNSAFE + "|[\udc80-\udcff]", text):
        return [f"{words}: {text[max(found.start() - 60, 0) : found.end() + 60]!a}"]
    return []


def _tapped(words: list[str], folder: Path) -> tuple[int, bytes]:
    """Run one tap of a line on which the frames pass half a second later, as `_on_terminal`."""
    line, port = pty.openpty()
    tty.setraw(port)
    path = folder / "tapped.toml"
    path.write_text(bus_file(os.ttyname(port)))
    speak = threading.Timer(0.5, os.write, (line, b"".join(frames())))
    try:
        return _on_terminal(["tap", "--bus", str(path), "--duration", "1s", *words], speak.start)
    finally:
        speak.join()
        os.close(line)
        os.close(port)


def _on_terminal(words: list[str], started: Callable[[], None] = lambda: None) -> tuple[int, bytes]:
    """Run one case; its exit status (below 0: a signal), and every byte that the terminal got."""
    leader, follower = pty.openpty()
    tty.setraw(follower)
    pid = os.fork()
    if pid == 0:
        os.close(leader)
        become_command(words, lambda: _arrange(follower))
    os.close(follower)
    started()
    got = b""
    while block := _block(leader):
        got += block
    os.close(leader)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), got


def _block(leader: int) -> bytes:
    try:
        return os.read(leader, 65536)
    except OSError:  # EIO is the end on Linux
        return b""


def _arrange(terminal: int) -> None:
    """Bound the time of a case, and give it the terminal."""
    signal.alarm(WALL_S)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(terminal, 1)
    os.dup2(terminal, 2)
    os.close(terminal)
    sys.stdin = open(0)
    sys.stdout, sys.stderr = (open(number, "w", encoding="utf-8") for number in (1, 2))


if __name__ == "__main__":
    print("\n".join(run(Path(sys.argv[1]))))  # noqa: T201
    sys.stdout.flush()
