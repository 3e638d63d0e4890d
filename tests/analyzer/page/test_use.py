"""How the page is used: by everybody, on a phone, with recordings that are large."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path

import pytest

from tests.conftest import CAPTURES, without
from tests.support.browser import Browser
from tests.support.page import STATE, TROUBLE, show

LIMIT_MB = 40
EXCHANGE = bytes.fromhex("010300000001840a0103020007f986")
CANCELLED = (
    "(async () => { const began = performance.now();"
    " document.getElementById('cancel').click();"
    f" while ({STATE} !== 'refused') await new Promise((resume) => setTimeout(resume, 1));"
    " return performance.now() - began; })()"
)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_nobody_is_shut_out(width: int, scheme: str, opened: Browser) -> None:
    """axe-core finds no serious fault, on a screen and a phone; nothing is wider than the page."""
    try:
        script = resources.files("axe_core_python").joinpath("axe.min.js").read_text("utf-8")
    except ModuleNotFoundError:
        without("axe-core-python")
    opened.shape(width, scheme=scheme)

    def check() -> None:
        opened.run(script + "; window.axe = axe;")
        faults = opened.ask(
            "axe.run().then((found) => found.violations"
            ".filter((one) => ['serious', 'critical'].includes(one.impact))"
            ".map((one) => [one.id, one.nodes.map((node) => node.html.slice(0, 200))]))"
        )
        assert faults == []
        assert opened.run("return document.documentElement.scrollWidth") <= width

    try:
        check()
        show(opened, CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
        opened.run("document.querySelectorAll('.grid-lines .grid-row')[1].click()")
        opened.wait("document.documentElement.dataset.detail === '1'")
        check()
        opened.run("document.getElementById('tab-registers').click()")
        opened.wait("document.querySelector('.grid').getAttribute('aria-label') === 'registers'")
        opened.run("document.querySelectorAll('.grid-lines .grid-row')[0].click()")
        opened.wait("document.querySelector('#detail canvas')")
        check()
    finally:
        opened.shape(1280)


@pytest.mark.parametrize("width", [1280, 390])
def test_the_chosen_row_is_in_view_with_the_table(width: int, opened: Browser) -> None:
    """Below the table where there is no room beside it; another recording is one button away."""
    opened.shape(width, 800)
    try:
        show(opened, CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
        opened.run("document.querySelectorAll('.grid-lines .grid-row')[1].click()")
        opened.wait("document.documentElement.dataset.detail === '1'")
        tops = opened.run(
            "return ['.grid', '#detail h2'].map((one) => {"
            " const { top, bottom } = document.querySelector(one).getBoundingClientRect();"
            " return top < innerHeight && bottom > 0; })"
        )
        assert tops == [True, True]
        opened.run("document.getElementById('another').click()")
        assert opened.run("return document.activeElement.id") == "file"
        assert not opened.run("return document.getElementById('welcome').hidden")
    finally:
        opened.shape(1280)


def test_reading_is_cancelled_at_once(opened: Browser, tmp_path: Path) -> None:
    path = tmp_path / "large.bin"
    path.write_bytes(EXCHANGE * 1_500_000)
    waits = []
    for _ in range(3):
        opened.run(f"{STATE} = 'waiting'")
        opened.send_file("#file", path)
        opened.wait(f"{STATE} === 'decoding' && document.getElementById('bar').value > 0", 60)
        waits.append(opened.ask(CANCELLED))
        assert "cancelled" in opened.run(TROUBLE)
    # The quickest of three: other programs of the machine may hold the browser up.
    assert min(waits) < 100, waits


def test_above_the_limit_of_memory_the_first_rows_are_listed(
    opened: Browser, tmp_path: Path
) -> None:
    """Causes and statistics are those of all, and the page says so."""
    path = tmp_path / "large.bin"
    path.write_bytes(EXCHANGE * 2_000_000)
    opened.ask(f"Page.request('start', {{ memoryLimit: {LIMIT_MB} << 20 }})")
    show(opened, path)
    limits = opened.run("return document.getElementById('limits').textContent")
    found = re.search(r"all are too big for this tab, about ([\d,]+) MB needed", limits)
    assert found, limits
    assert int(found[1].replace(",", "")) > LIMIT_MB
    document = opened.ask(
        "Page.ask({ call: 'rows', table: 'transactions', columns: [], count: 0 })"
    )
    assert 0 < document["total"] < 2_000_000
