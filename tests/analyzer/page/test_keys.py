"""The page by keys, and rows that are looked at: what is chosen is in view and followed."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.conftest import CAPTURES
from tests.support.browser import Browser
from tests.support.page import show

DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
# One of its examples is transaction 320.
LONGER = CAPTURES / "pymodbus_two_masters" / "recording.jsonl"
CHOSEN = "document.querySelector('.grid-lines [aria-selected=true]')"
DETAIL = "document.documentElement.dataset.detail"
# Whether the chosen row is in the window and under the head of the table, above its end.
IN_VIEW = (
    f"(() => {{ const row = {CHOSEN}?.getBoundingClientRect();"
    " const table = document.querySelector('.grid').getBoundingClientRect();"
    " return row && row.top >= table.top + 23 && row.bottom <= table.bottom + 1"
    " && row.top >= 0 && row.bottom <= innerHeight; })()"
)
KEYS = {"Enter": 13, "ArrowDown": 40}


@pytest.fixture(params=[1280, 390])
def sized(request: pytest.FixtureRequest, opened: Browser) -> Iterator[Browser]:
    """The page on a screen and a phone."""
    opened.shape(request.param, 800)
    yield opened
    opened.shape(1280)


def press(browser: Browser, key: str) -> None:
    """Press a key where the focus is."""
    text = {"text": "\r"} if key == "Enter" else {}
    for kind in ("keyDown", "keyUp"):
        browser.command(
            "Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=KEYS[key], **text
        )


def test_an_example_is_in_view_and_walked_on_from(sized: Browser) -> None:
    """Its row stays in sight below what is open; arrows move on, and what is open follows."""
    show(sized, LONGER)
    sized.run("document.querySelector('#verdict a[href=\"#txn-320\"]').focus()")
    press(sized, "Enter")
    sized.wait(f"{DETAIL} === '319' && {CHOSEN}?.dataset.row === '319' && {IN_VIEW}")
    press(sized, "ArrowDown")
    sized.wait(f"{DETAIL} === '320' && {CHOSEN}?.dataset.row === '320' && {IN_VIEW}")


def test_the_last_row_of_a_window_stays_in_view(sized: Browser) -> None:
    """A click opens it, and the table shrinks."""
    show(sized, DISTURBED)
    sized.run(
        "const bottom = document.querySelector('.grid').getBoundingClientRect().bottom;"
        "[...document.querySelectorAll('.grid-lines .grid-row')]"
        ".filter((it) => it.getBoundingClientRect().bottom <= bottom).at(-1).click()"
    )
    sized.wait(f"{DETAIL} === {CHOSEN}?.dataset.row && {IN_VIEW}")
