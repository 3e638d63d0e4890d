"""Filters in words on the page: the rows and the messages of `--where`."""

from __future__ import annotations

from pathlib import Path

import pytest

import modlens as api
from analyzer import FilterError, filters
from tests.analyzer.test_filters_people_type import RECORDING, SELECTED, TOLD
from tests.conftest import CAPTURES
from tests.support.browser import Browser
from tests.support.page import show

ON_THE_PAGE = ("transactions", "frames", "findings", "connections")
TOTALS = (
    "Promise.all(arguments[0].map(async ([table, where]) => (await Page.ask("
    "{ call: 'rows', table, columns: [], where, from: 0, count: 0 })).total))"
)
MESSAGES = (
    "Promise.all(arguments[0].map(async ([table, where]) => Page.ask("
    "{ call: 'check', table, where }).then(() => 'accepted', (error) => error.message)))"
)
SAID = "document.getElementById('where-said').textContent"


def type_filter(browser: Browser, text: str) -> None:
    browser.run(
        "const field = document.getElementById('where'); field.value = arguments[0];"
        "field.dispatchEvent(new Event('change'))",
        text,
    )


def test_filters_select_the_same_rows(opened: Browser) -> None:
    show(opened, Path(RECORDING))
    wanted = [(table, text) for table, text, _ in SELECTED if table in ON_THE_PAGE]
    decoded = api.decode(RECORDING)
    expected = [len(getattr(decoded, table).where(text)) for table, text in wanted]
    assert opened.ask(TOTALS, wanted) == expected


def test_filters_are_refused_with_the_same_words(opened: Browser) -> None:
    show(opened, Path(RECORDING))
    expected = []
    for table, text, _ in TOLD:
        with pytest.raises(FilterError) as caught:
            filters.parse(text, table)
        expected.append(str(caught.value))
    assert opened.ask(MESSAGES, [(table, text) for table, text, _ in TOLD]) == expected


def test_a_filter_is_typed(opened: Browser) -> None:
    """Rows follow what is right; what is wrong is said, and shows all rows."""
    show(opened, Path(RECORDING))
    rows = api.decode(RECORDING).transactions
    chosen = len(rows.where("retry and unit == 1"))
    type_filter(opened, "retry and unit == 1")
    opened.wait(f"document.getElementById('shown').textContent === '{chosen} rows'")
    type_filter(opened, "unit = 1")
    opened.wait(f"{SAID}.startsWith('write `==` to compare')")
    type_filter(opened, "address == 40001")
    opened.wait(f"{SAID}.startsWith('40001 is taken as a wire address')")
    type_filter(opened, "")
    opened.wait(f"document.getElementById('shown').textContent === '{len(rows)} rows'")


def test_a_time_of_day_may_be_local(opened: Browser) -> None:
    show(opened, Path(RECORDING))
    rows = api.decode(RECORDING).transactions
    middle = rows[len(rows) // 2].time
    assert middle is not None
    text = f"time >= '{middle.astimezone():%H:%M:%S} local'"
    type_filter(opened, text)
    opened.wait(f"document.getElementById('shown').textContent === '{len(rows.where(text))} rows'")


def test_a_wrong_filter_leaves_no_rows_of_the_one_before(opened: Browser) -> None:
    """All rows are shown, and what is said names what the page has: tabs, not options."""
    path = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
    show(opened, path)
    decoded = api.decode(path)
    opened.run("document.getElementById('tab-frames').click()")
    opened.wait("document.querySelector('.grid').getAttribute('aria-label') === 'frames'")
    type_filter(opened, "direction == 'request'")
    chosen = len(decoded.frames.where("direction == 'request'"))
    opened.wait(f"document.getElementById('shown').textContent === '{chosen} rows'")
    type_filter(opened, "status == 'ok'")
    opened.wait(f"document.getElementById('shown').textContent === '{len(decoded.frames)} rows'")
    said = opened.run(f"return {SAID}")
    assert "on Transactions" in said
    assert "--table" not in said
    assert said.endswith("; rows are shown without this filter")


@pytest.mark.parametrize("table", ON_THE_PAGE)
def test_the_example_is_a_filter_of_its_table(table: str, opened: Browser) -> None:
    show(opened, CAPTURES / "pymodbus_idle_close" / "recording.pcap")
    opened.run(f"document.getElementById('tab-{table}').click()")
    opened.wait(f"document.querySelector('.grid').getAttribute('aria-label') === '{table}'")
    example = opened.run("return document.getElementById('where').placeholder")
    assert example
    assert opened.ask(MESSAGES, [[table, example]]) == ["accepted"]
