"""The live screens in a real terminal: every view in two sizes as it should look, and the keys.

The golden screens are in `golden/`; `MODLENS_UPDATE=1` writes them again, for a person to look at.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from analyzer.views.live import VIEWS
from tests.support.terminal import Terminal

GOLDEN = Path(__file__).parent / "golden"
CALM, DISTURBED = (
    f"captures/pymodbus_{name}/recording.jsonl" for name in ("two_units", "disturbed")
)
SIZES = ((50, 20), (80, 24), (132, 43), (160, 50), (200, 50))
UPDATE_S = 3.0


def showing(width: int, height: int, view: str, recording: str) -> Terminal:
    """The screens over a recording, with a clock that stands still."""
    words = (sys.executable, "-m", "tests.support.live_screen", recording, view)
    return Terminal(width, height, *words)


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize(("width", "height"), SIZES)
def test_every_view_looks_as_it_should(view: str, width: int, height: int) -> None:
    """Every view fills the window, and nothing more."""
    golden = GOLDEN / f"{view}_{width}x{height}.txt"
    recording = DISTURBED if view == "health" else CALM
    with showing(width, height, view, recording) as terminal:
        if os.environ.get("MODLENS_UPDATE") == "1":
            time.sleep(UPDATE_S)
            golden.write_text(terminal.screen().rstrip() + "\n", encoding="utf-8")
        wanted = golden.read_text(encoding="utf-8").rstrip()
        shown = terminal.wait_for(lambda text: text.rstrip() == wanted)
        assert max(map(len, shown.splitlines())) <= width


def test_keys_do_what_the_foot_says() -> None:
    """Pause, filter (an invalid one is reported), mark, pages, resize, quit."""
    with showing(80, 24, "log", DISTURBED) as terminal:
        terminal.wait_for("resp. ms")
        terminal.press("p")
        terminal.wait_for("PAUSED")
        terminal.press("p")
        terminal.press("k")
        terminal.wait_for("mark 1")
        terminal.press("/")
        terminal.press("-l", "unit = 1")
        terminal.wait_for("filter: unit = 1_")
        terminal.press("Enter")
        # What was typed stays, to be fixed.
        terminal.wait_for("filter: unit = 1_  write `==` to compare")
        terminal.press("BSpace", "BSpace")
        terminal.press("-l", "= 1")
        terminal.press("Enter")
        terminal.wait_for("filter: unit == 1  l log")
        # The other views are not filtered, and do not say so.
        terminal.press("t")
        terminal.wait_for(lambda text: "modlens table" in text and "filter:" not in text)
        terminal.press("l")
        terminal.wait_for("filter: unit == 1  l log")
        terminal.press("/")
        terminal.wait_for("filter: unit == 1_")
        terminal.press("C-u")
        terminal.wait_for("filter: _")
        terminal.press("Escape")
        terminal.wait_for("filter: unit == 1  l log")
        terminal.press("t")
        terminal.resize(40, 8)
        small = terminal.wait_for(lambda text: "modlens table" in text and "quit" not in text)
        assert small.splitlines()[0].startswith("modlens table")
        assert [line.split()[0] for line in small.splitlines()[2:4]] == ["unit", "1"]
        terminal.press("m")
        terminal.resize(80, 6)
        first = terminal.wait_for("1-3 of")
        terminal.press("n")
        terminal.wait_for("n next b back")
        assert terminal.wait_for(lambda text: "1-3 of" not in text) != first
        terminal.press("q")
        terminal.wait_for("mark 1 at")


def test_keys_of_a_keyboard_turn_pages_and_lines() -> None:
    """PageUp, PageDown, arrows, Home and End, in the log and in a view; `?` lists the keys."""
    with showing(80, 12, "log", DISTURBED) as terminal:
        terminal.wait_for("resp. ms")
        terminal.press("PageUp")
        terminal.wait_for("20-27 of 35")
        terminal.press("Up")
        terminal.wait_for("19-26 of 35")
        terminal.press("Home")
        terminal.wait_for("1-8 of 35")
        terminal.press("Down")
        terminal.wait_for("2-9 of 35")
        terminal.press("PageDown")
        terminal.wait_for("10-17 of 35")
        terminal.press("End")
        terminal.wait_for(lambda text: "of 35" not in text)
        terminal.press("?")
        terminal.wait_for("l            log: a line for each transaction")
        terminal.press("End")
        terminal.wait_for("any other key goes back")
        terminal.press("m")
        terminal.wait_for("modlens map")
        terminal.resize(80, 6)
        terminal.wait_for("1-3 of")
        terminal.press("Down")
        terminal.wait_for("2-4 of")
        terminal.press("Home")
        terminal.wait_for("1-3 of")


def test_marks_narrow_the_map_down() -> None:
    """After a mark, the registers that stayed are kept, then those that changed: none here."""
    with showing(80, 24, "map", CALM) as terminal:
        terminal.wait_for("registers")
        terminal.press("u")
        terminal.wait_for(lambda text: "candidate" not in text)
        terminal.press("k")
        terminal.press("=")
        terminal.wait_for("candidates: stayed the same")
        terminal.press("d")
        terminal.wait_for("0 candidates: stayed the same, then changed")
        terminal.press("a")
        terminal.wait_for(lambda text: "candidate" not in text and "+1" in text)
        terminal.press("q")
