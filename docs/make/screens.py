"""The pictures of screens: made by running the program, in SVG, with no font from elsewhere.

`python -m docs.make.screens` draws all of them again, with names only those. A test compares what
the program shows today with what is in the pictures (`tests/docs/test_site_pictures.py`).
"""

from __future__ import annotations

import html
import io
import os
import re
import shlex
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.text import Text

__all__ = ["LIVE", "PRINTED", "drawn", "picture", "screen_of", "words_in"]

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "docs" / "pictures"
COLUMNS, LINES = 96, 60

DEAD_UNIT = "captures/pymodbus_dead_unit/recording.jsonl --line 57600-8E1"

PRINTED: Mapping[str, str] = {
    "decode": f"modlens decode {DEAD_UNIT} --limit 14",
    "doctor": f"modlens doctor {DEAD_UNIT}",
    "stats": "modlens stats captures/pymodbus_disturbed/recording.jsonl --line 19200-8E1",
    "show": "modlens show captures/pymodbus_disturbed/recording.jsonl --line 19200-8E1 --txn 2",
    "map": "modlens map captures/pymodbus_types/recording.jsonl --line 57600-8E1",
    "explain": "modlens explain exception 2",
    "learn": "modlens learn captures/pymodbus_types/recording.jsonl --line 57600-8E1 --to table",
    "find": "modlens find captures/pymodbus_types/recording.jsonl --line 57600-8E1 --value 229.8",
}
"""Picture -> the command whose output it shows."""

LIVE: Mapping[str, tuple[str, str]] = {
    "live-log": ("log", "captures/pymodbus_two_units/recording.jsonl"),
    "live-table": ("table", "captures/pymodbus_two_units/recording.jsonl"),
    "live-map": ("map", "captures/pymodbus_two_units/recording.jsonl"),
    "live-health": ("health", "captures/pymodbus_disturbed/recording.jsonl"),
}
"""Picture -> the view of a tap that it shows, over a recording with a clock that stands still."""

LIVE_SIZE = (96, 26)
MOST_LINES = 34
"""The longest picture; what is below is left out."""

_COMMENT = re.compile(r"\s*<!--.*?-->", re.DOTALL)
_FONT_FACES = re.compile(r"@font-face \{\{.*?\}\}", re.DOTALL)
_WORDS = re.compile(r"<text[^>]*>([^<]*)</text>")


def screen_of(name: str) -> str:
    """What a terminal shows for a picture, with its colours as control sequences."""
    if name in PRINTED:
        words = shlex.split(PRINTED[name])[1:]
        return f"$ {PRINTED[name]}\n" + _printed([sys.executable, "-m", "analyzer", *words])
    view, recording = LIVE[name]
    return _live(view, recording)


def _printed(words: list[str]) -> str:
    """What a command writes to a terminal."""
    from tests.support.printed import printed  # noqa: PLC0415 - the tests are beside the tree

    env = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "COLUMNS")}
    env |= {"TERM": "xterm-256color", "TZ": "UTC", "PYTHONIOENCODING": "utf-8", "MODLENS_PAGER": ""}
    return printed(words, env, cwd=ROOT, lines=LINES, columns=COLUMNS)[0]


def _live(view: str, recording: str) -> str:
    """A view in a window of tmux, once it has not changed for a second."""
    from tests.support.terminal import Terminal  # noqa: PLC0415 - the others need no tmux

    words = (sys.executable, "-m", "tests.support.live_screen", recording, view)
    with Terminal(*LIVE_SIZE, *words) as terminal:
        terminal.wait_for("modlens")
        before, shown = "", terminal.screen("-e")
        while before != shown:
            time.sleep(1)
            before, shown = shown, terminal.screen("-e")
    return shown


def drawn(screen: str) -> str:
    """A screen as SVG."""
    console = Console(
        record=True,
        width=COLUMNS,
        file=io.StringIO(),
        force_terminal=True,
        color_system="truecolor",
    )
    lines = screen.rstrip().split("\n")
    more = [f"... {len(lines) - MOST_LINES} more lines"] if len(lines) > MOST_LINES else []
    console.print(Text.from_ansi("\n".join([*lines[:MOST_LINES], *more])), end="")
    own = _COMMENT.sub("", _FONT_FACES.sub("", CONSOLE_SVG_FORMAT))
    own = own.replace("Fira Code", "DejaVu Sans Mono, Menlo")
    return console.export_svg(title="", code_format=own)


def words_in(svg: str) -> str:
    """The words of a picture, whatever the version of rich that has drawn it."""
    return html.unescape(" ".join(_WORDS.findall(svg))).replace("\xa0", " ")


def picture(name: str) -> Path:
    """Where a picture is."""
    return PICTURES / f"{name}.svg"


if __name__ == "__main__":
    for chosen in sys.argv[1:] or [*PRINTED, *LIVE]:
        picture(chosen).write_text(drawn(screen_of(chosen)), encoding="utf-8")
