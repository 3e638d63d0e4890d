"""The page by keys, and rows that are looked at: what is chosen is in view and followed."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

import modlens as api
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
KEYS = {"Enter": 13, "End": 35, "Home": 36, "ArrowLeft": 37, "ArrowRight": 39, "ArrowDown": 40}


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


def examples() -> list[int]:
    """The transactions that the diagnoses of the longer recording name."""
    rows = api.decode(LONGER).doctor()["diagnoses"]
    return sorted(number for row in rows for number in row["examples"])


def test_an_example_is_in_view_and_walked_on_from(sized: Browser) -> None:
    """Its row stays in sight below what is open; arrows move on, and what is open follows."""
    show(sized, LONGER)
    number = examples()[-1]
    sized.run(f"document.querySelector('#verdict a[href=\"#txn-{number}\"]').focus()")
    press(sized, "Enter")
    for row in (number - 1, number):
        sized.wait(f"{DETAIL} === '{row}' && {CHOSEN}?.dataset.row === '{row}' && {IN_VIEW}")
        press(sized, "ArrowDown")


def test_the_last_row_of_a_window_stays_in_view(sized: Browser) -> None:
    """A click opens it, and the table shrinks."""
    show(sized, DISTURBED)
    sized.run(
        "const bottom = document.querySelector('.grid').getBoundingClientRect().bottom;"
        "[...document.querySelectorAll('.grid-lines .grid-row')]"
        ".filter((it) => it.getBoundingClientRect().bottom <= bottom).at(-1).click()"
    )
    sized.wait(f"{DETAIL} === {CHOSEN}?.dataset.row && {IN_VIEW}")


def test_arrows_go_from_tab_to_tab(opened: Browser) -> None:
    """Round and round; Tab goes to the chosen one alone."""
    show(opened, DISTURBED)
    chosen = "document.querySelector('#tabs [aria-selected=true]')"
    opened.run(f"{chosen}.focus()")
    for key, table in (
        ("ArrowRight", "frames"),
        ("ArrowRight", "findings"),
        ("ArrowLeft", "frames"),
        ("Home", "transactions"),
        ("ArrowLeft", "registers"),
        ("ArrowRight", "transactions"),
        ("End", "registers"),
    ):
        press(opened, key)
        opened.wait(f"{chosen}.dataset.table === '{table}' && document.activeElement === {chosen}")
    stops = "[...document.querySelectorAll('#tabs [role=tab]')].filter((it) => it.tabIndex === 0)"
    assert opened.run(f"return {stops}.map((it) => it.dataset.table)") == ["registers"]


def test_the_bytes_of_a_row_are_read_on_a_phone(opened: Browser) -> None:
    """Titles and names of fields stay whole, and nothing is wider than the page."""
    opened.shape(390, 800)
    try:
        show(opened, DISTURBED)
        opened.run("document.querySelectorAll('.grid-lines .grid-row')[1].click()")
        opened.wait(f"{DETAIL} === '1'")
        heights = opened.run(
            "return [...document.querySelectorAll('.bytes th')].map((it) => it.offsetHeight)"
        )
        assert max(heights) < 30
        widths = opened.run(
            "return [...document.querySelectorAll('.bytes tr:first-child td')]"
            ".map((it) => it.offsetWidth)"
        )
        assert min(widths) >= 24
        assert opened.run("return document.documentElement.scrollWidth") <= 390
        assert opened.run("return detail.scrollWidth - detail.clientWidth") == 0
    finally:
        opened.shape(1280)


def test_times_of_a_row_have_their_unit(opened: Browser) -> None:
    """Of a row whose request was not answered; the table of the library has microseconds."""
    rows = api.decode(LONGER).transactions
    row = next(row for number in examples() if (row := rows[number - 1]).waited_us is not None)
    show(opened, LONGER)
    opened.run(f"document.querySelector('#verdict a[href=\"#txn-{row.txn}\"]').click()")
    opened.wait(f"{DETAIL} === '{row.txn - 1}'")
    text = opened.run("return document.getElementById('detail').innerText")
    times = dict(re.findall(r"(elapsed|waited)\s+([\d.,]+ m?s)\b", text))
    assert times == {
        "elapsed": f"{row.elapsed_us / 1e6:,.6f} s",
        "waited": f"{row.waited_us / 1e3:,.3f} ms",
    }
