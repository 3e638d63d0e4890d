"""Reports in a browser: drawn, usable, asking for nothing, and running nothing that is data."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from analyzer.report.page import page, viewer
from tests.conftest import CAPTURES, Modlens, without
from tests.support.browser import Browser, running

NAMES = sorted(path.parent.name for path in CAPTURES.glob("*/about.toml"))

TEXT = "return document.getElementById('report').innerText"

WORDS = "return document.getElementById('report').textContent.replaceAll('\\n', '')"

IS_BLANK = """
return [...document.querySelectorAll('canvas')].filter((canvas) => {
  const {width, height} = canvas;
  const pixels = canvas.getContext('2d').getImageData(0, 0, width, height).data;
  return !pixels.some((value) => value !== 0);
}).map((canvas) => canvas.getAttribute('aria-label'))
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with running(tmp_path_factory.mktemp("browser")) as found:
        found.shape(1280)
        found.requests()
        yield found


def words_of(name: str) -> list[str]:
    """A recording of `captures/` with the options that it needs."""
    folder = CAPTURES / name
    about = tomllib.loads((folder / "about.toml").read_text("utf-8"))
    words = [str(folder / about["file"])]
    if about.get("line"):
        words += ["--line", about["line"]]
    return [*words, "--mode", about["mode"]] if about.get("mode") else words


def document_of(modlens: Modlens, name: str) -> dict[str, Any]:
    done = modlens("stats", *words_of(name), "--to", "json")
    assert done.status == 0, done.err
    found: dict[str, Any] = json.loads(done.out)
    return found


@pytest.mark.parametrize("name", NAMES)
def test_the_report_of_a_recording_is_drawn(
    name: str, browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """No error, no request but for the page itself, no empty plot; verdict and units are there."""
    target = tmp_path / "report.html"
    done = modlens("report", *words_of(name), "-o", target)
    assert done.status == 0, done.err
    assert target.stat().st_size < 1_000_000
    browser.open(target)
    assert browser.requests() == [target.as_uri()]
    assert browser.log("browser") == []
    assert browser.run(IS_BLANK) == []
    sentence = " ".join(done.err.split("\n")[-2].split())
    assert sentence in " ".join(browser.run(TEXT).split())
    assert browser.run("return document.documentElement.scrollWidth") <= 1280


@pytest.fixture
def opened(browser: Browser, modlens: Modlens, tmp_path: Path) -> Browser:
    """The report of a line with trouble."""
    target = tmp_path / "report.html"
    target.write_bytes(page(document_of(modlens, "pymodbus_disturbed")))
    browser.shape(1280)
    browser.open(target)
    return browser


def test_zoom_goes_for_all_plots_of_the_axis(opened: Browser) -> None:
    """Dragging across one plot shows the same time in the others; a double click shows all."""
    get = "return [...document.querySelectorAll('[data-plot=timeline] .u-over')].map((over) => {"
    box = f"{get} const at = over.getBoundingClientRect(); return [at.x, at.y, at.width]}})[0]"
    opened.run("document.querySelector('[data-plot=timeline] .u-over').scrollIntoView()")
    ticks = "return Plots.ranges()"
    before = opened.run(ticks)
    x, y, width = opened.run(box)
    move = {"type": "pointerMove", "duration": 0, "origin": "viewport", "y": round(y) + 30}
    start, end = {**move, "x": round(x + width / 4)}, {**move, "x": round(x + width / 2)}
    down, up = {"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}
    opened.press([start, down, end, up])
    opened.wait(f"JSON.stringify(Plots.ranges()) !== {json.dumps(json.dumps(before))}")
    after = opened.run(ticks)
    assert len(after) == len(before) > 3
    assert len({tuple(one) for one in after}) == 1
    low, high = before[0]
    assert after[0][0] == pytest.approx(low + (high - low) / 4, abs=(high - low) / 50)
    assert after[0][1] == pytest.approx(low + (high - low) / 2, abs=(high - low) / 50)


def test_chosen_registers_are_plotted_together(opened: Browser) -> None:
    """Choosing a value adds a line to the plot, and its name to the title."""
    title = "return document.querySelector('[data-plot=registers] h3')?.textContent || ''"
    count = "return document.querySelectorAll('#registers input[type=checkbox]').length"
    assert opened.run(count) == 3
    before = opened.run(title).split(", ")
    opened.run("document.querySelector('#registers input[type=checkbox]').click()")
    assert opened.run(title).split(", ") == before[1:]


def test_filters_leave_what_matches(opened: Browser) -> None:
    """Registers by type, examples by status; the number is stated for those who do not see it."""
    script = (
        "const box = document.getElementById(arguments[0]); box.value = arguments[1];"
        "box.dispatchEvent(new Event('input'));"
        "return document.getElementById('said').textContent"
    )
    assert opened.run(script, "filter-registers", "coil") == "12 of 28 are shown."
    shown = "return [...document.querySelectorAll('.example')].filter((one) => !one.hidden).length"
    opened.run(script, "filter-examples", "no response")
    assert opened.run(shown) == 7


def test_a_filter_takes_columns_by_name(browser: Browser, modlens: Modlens, tmp_path: Path) -> None:
    """The number of a function, words, and both; an empty filter shows everything."""
    target = tmp_path / "report.html"
    target.write_bytes(page(document_of(modlens, "pymodbus_all_functions")))
    browser.open(target)
    script = (
        "const box = document.getElementById('filter-polls'); box.value = arguments[0];"
        "box.dispatchEvent(new Event('input'));"
        "const rows = box.closest('section').querySelectorAll('tbody tr');"
        "return [...rows].filter((row) => !row.hidden)"
        ".map((row) => [row.cells[0].textContent, row.cells[1].textContent])"
    )
    every = browser.run(script, "")
    assert len({function for _, function in every}) > 5
    for unit, function in every:
        code = function.split()[0]
        shown = browser.run(script, f"function={code}")
        assert shown == [row for row in every if row[1].split()[0] == code]
        assert browser.run(script, f"unit={unit} {function.split()[-1].lower()} function={code}")
    assert browser.run(script, "unit=99") == []
    assert browser.run(script, "write") == [row for row in every if "Write" in row[1]]
    assert browser.run(script, " ") == every


def test_many_registers_are_laid_out_once(
    browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """A thousand small plots; to lay out the page for each took twenty seconds."""
    document = document_of(modlens, "pymodbus_plant")
    rows = document["overview"]["buses"][0]["registers"]["rows"]
    changing = next(row for row in rows if row["course"])
    rows[:] = [{**changing, "address": address} for address in range(1000)]
    target = tmp_path / "report.html"
    target.write_bytes(page(document))
    browser.command("Performance.enable")
    browser.open(target)
    metrics = browser.command("Performance.getMetrics")["metrics"]
    assert len(browser.run("return document.querySelectorAll('#registers .strip')")) == 1000
    layouts = next(one["value"] for one in metrics if one["name"] == "LayoutCount")
    assert layouts < 100


def test_strips_show_a_unit_over_time(opened: Browser) -> None:
    """The share that was answered, and p95 against the timeout, which is said in words as well."""
    labels = opened.run(
        "return [...document.querySelectorAll('#units canvas')]"
        ".map((one) => one.getAttribute('aria-label'))"
    )
    assert labels[0] == "unit 1: answered share over time"
    assert labels[1].startswith("unit 1: 95 % of the responses take up to 4.")
    assert labels[1].endswith(" ms, the timeout is 302.0 ms")


def test_a_link_opens_its_example(opened: Browser) -> None:
    opened.run("document.querySelector('#diagnoses a').click()")
    opened.wait("document.querySelector(location.hash).open")


@pytest.mark.parametrize(
    "name", ["pymodbus_disturbed", "pymodbus_tcp", "pymodbus_plant", "seed_ascii"]
)
def test_the_viewer_shows_what_the_page_says(
    name: str, browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """A document on a page without data: the same words as in the page that Python made of it."""
    document = document_of(modlens, name)
    whole, empty = tmp_path / "page.html", tmp_path / "viewer.html"
    whole.write_bytes(page(document))
    empty.write_bytes(viewer())
    (tmp_path / "document.json").write_text(json.dumps(document), encoding="utf-8")
    browser.open(whole)
    text = browser.run(WORDS)
    browser.open(empty, "empty")
    browser.send_file("#file", tmp_path / "document.json")
    browser.wait("document.documentElement.dataset.state === 'drawn'")
    assert browser.run(WORDS) == text
    assert browser.log("browser") == []


def test_what_is_no_document_is_refused(opened: Browser, modlens: Modlens, tmp_path: Path) -> None:
    """Another JSON, a later version, a broken file: told, and the page stays as it is."""
    before = opened.run(TEXT)
    later = {**document_of(modlens, "pymodbus_disturbed"), "version": 2}
    for number, (content, reason) in enumerate(
        [("{}", "no document"), (json.dumps(later), "version 1"), ("{", "JSON")]
    ):
        path = tmp_path / f"{number}.json"
        path.write_text(content, encoding="utf-8")
        opened.send_file("#file", path)
        opened.wait(f"document.getElementById('said').textContent.startsWith('{path.name}')")
        said = opened.run("return document.getElementById('said').textContent")
        assert reason.removeprefix("no ") in said
        assert opened.run(TEXT) == before


def test_without_scripts_everything_but_plots_is_there(
    browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    document = document_of(modlens, "pymodbus_disturbed")
    target = tmp_path / "report.html"
    target.write_bytes(page(document))
    browser.command("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(target, None)
    finally:
        browser.command("Emulation.setScriptExecutionDisabled", value=False)
    text = browser.run("return document.body.innerText")
    assert document["doctor"]["sentence"] in text
    for row in document["doctor"]["diagnoses"]:
        assert row["advice"] in text
    assert "Plots and filters need JavaScript" in text
    assert browser.run("return document.querySelector('canvas')") is None


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_nobody_is_shut_out(width: int, scheme: str, opened: Browser) -> None:
    """axe-core finds no serious fault, on a screen and a phone; nothing is wider than the page."""
    try:
        script = resources.files("axe_core_python").joinpath("axe.min.js").read_text("utf-8")
    except ModuleNotFoundError:
        without("axe-core-python")
    opened.shape(width, scheme=scheme)
    opened.run("window.dispatchEvent(new Event('resize'))")
    opened.run(script + "; window.axe = axe;")
    opened.run("window.found = null; axe.run().then((found) => { window.found = found; })")
    opened.wait("window.found !== null")
    faults = [
        (one["id"], one["impact"], [node["html"][:200] for node in one["nodes"]])
        for one in opened.run("return window.found.violations")
        if one["impact"] in ("serious", "critical")
    ]
    assert faults == []
    assert opened.run("return document.documentElement.scrollWidth") <= width
    opened.shape(1280)


HOSTILE = (
    '</script><script>window.ran=1</script><img src=x onerror="window.ran=1">"\'&\x1b[2J\u202e\x00'
)


def test_hostile_texts_are_shown_and_not_run(
    browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """Every text of the document is hostile: in the page, and in the viewer."""

    def poisoned(value: Any, key: str = "") -> Any:
        if isinstance(value, dict):
            return {name: poisoned(one, name) for name, one in value.items()}
        if isinstance(value, list):
            return [poisoned(one, key) for one in value]
        kept = key in ("format", "verdict", "axis", "bus", "source", "request_hex", "response_hex")
        return value + HOSTILE if isinstance(value, str) and not kept else value

    document = poisoned(document_of(modlens, "pymodbus_disturbed"))
    document["sources"][0]["name"] += "</template></title>"
    whole, empty = tmp_path / "page.html", tmp_path / "viewer.html"
    whole.write_bytes(page(document))
    empty.write_bytes(viewer())
    (tmp_path / "hostile.json").write_text(json.dumps(document), encoding="utf-8")
    browser.requests()
    browser.open(whole)
    texts = [browser.run(TEXT)]
    browser.open(empty, "empty")
    browser.send_file("#file", tmp_path / "hostile.json")
    browser.wait("document.documentElement.dataset.state === 'drawn'")
    texts.append(browser.run(TEXT))
    for text in texts:
        assert "<script>window.ran=1</script>" in text
        assert "\\x1b[2J\\u202e\\x00" in text
        assert not any(one in text for one in ("\x1b", "\u202e", "\x00"))
    assert browser.run("return window.ran === undefined && document.images.length === 0")
    assert browser.requests() == [whole.as_uri(), empty.as_uri()]
    assert browser.log("browser") == []
