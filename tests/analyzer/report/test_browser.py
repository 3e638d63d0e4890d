"""Reports in a browser: drawn, usable, asking for nothing, and running nothing that is data."""

from __future__ import annotations

import base64
import json
import re
import struct
import subprocess
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer.report.page import page
from tests.conftest import CAPTURES, Modlens, need_program, without
from tests.doctor.frames import rtu
from tests.support.browser import Browser, running
from tests.support.documents import (
    RAN_NOTHING,
    document_of,
    poisoned,
    shows_hostile_texts,
    words_of,
)

NAMES = sorted(path.parent.name for path in CAPTURES.glob("*/about.toml"))

TEXT = "return document.getElementById('report').innerText"

PCAP = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
"""A capture without a packet."""

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
    assert labels[1].startswith("unit 1: 95 % of the responses take up to ")
    # The master waits 0.3 s; a serial port reports an end late by a millisecond or two.
    assert 295 <= float(labels[1].split()[-2]) <= 300


def test_a_link_opens_its_example(opened: Browser) -> None:
    opened.run("document.querySelector('#diagnoses a').click()")
    opened.wait("document.querySelector(location.hash).open")


def test_the_name_and_period_come_first(browser: Browser, modlens: Modlens, tmp_path: Path) -> None:
    """No file is named in the title or above the verdict; the zone is stated once, in one place."""
    target = tmp_path / "report.html"
    done = modlens("report", *words_of("pymodbus_disturbed"), "--title", "Pumps", "-o", target)
    assert done.status == 0, done.err
    browser.open(target)
    assert browser.run("return document.title") == "Pumps: Modbus report"
    name, period, verdict, *rest = browser.run(TEXT).replace("\n\n", "\n").splitlines()
    time = r"\d\d:\d\d:\d\d\.\d{3}"
    wanted = rf"2026-\d\d-\d\d {time} to {time} \(5\.1 s\)\. All times are UTC\."
    assert re.fullmatch(wanted, period)
    assert name == "Pumps"
    assert verdict.startswith("Trouble")
    text = "\n".join(rest)
    assert "Based on 1 recording, 5.1 s, 19200-8E1, 98.4 % of the bytes are in frames." in text
    assert text.index("recording.jsonl") > text.index("Appendix") > text.index("Timeline")
    assert not re.search(r"\d\dT\d\d:|\d\.\d+Z", text)


@pytest.mark.parametrize(
    ("files", "title"),
    [
        (["p91/tap.jsonl"], "p91"),
        (["line7.jsonl"], "line7"),
        (["line-01.jsonl", "line-02.jsonl"], "line"),
    ],
)
def test_the_name_is_what_files_have_in_common(
    files: list[str], title: str, modlens: Modlens, tmp_path: Path
) -> None:
    """A generic name gives way to that of its folder."""
    recording = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(recording.read_bytes())
    target = tmp_path / "report.html"
    assert modlens("report", *(tmp_path / name for name in files), "-o", target).status == 0
    assert f"<title>{title}: Modbus report</title>" in target.read_text()


def test_the_name_is_that_of_the_bus_file(modlens: Modlens, tmp_path: Path) -> None:
    """Without `--title`; without a bus file it is what the names of the files have in common."""
    plant = tmp_path / "plant.toml"
    plant.write_text('plant = 1\n[[bus]]\nname = "Boiler house"\nline = "19200-8E1"\n')
    source = str(CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
    done = modlens("stats", source, "--bus", plant, "--to", "json")
    assert json.loads(done.out)["summary"]["name"] == "Boiler house"
    for day in ("monday-1", "monday-2"):
        (tmp_path / f"{day}.jsonl").write_bytes(Path(source).read_bytes())
    done = modlens(
        "stats", *(str(tmp_path / f"monday-{day}.jsonl") for day in (1, 2)), "--to", "json"
    )
    summary = json.loads(done.out)["summary"]
    assert summary["name"] == "monday"
    assert summary["sources"].startswith("2 recordings, 10.2 s, ")


@pytest.mark.parametrize("name", ["pymodbus_disturbed", "pymodbus_plant", "pymodbus_types"])
def test_no_bucket_is_shorter_than_a_poll_cycle(
    name: str, browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """The joined buckets hold the same counts, and begin at multiples of their width."""
    document = document_of(modlens, name)
    target = tmp_path / "report.html"
    target.write_bytes(page(document))
    browser.open(target)
    for bus, counts in zip(
        document["overview"]["buses"], document["statistics"]["buses"], strict=True
    ):
        steps, values, silence = browser.run(
            "const [data, bus] = arguments;"
            "const steps = Buckets.joined(bus.line, Buckets.least(data, bus));"
            "return [steps, Buckets.join(bus.line.frames, steps, 'sum'),"
            " bus.line.silence_us && Buckets.join(bus.line.silence_us, steps, 'max')]",
            document,
            bus,
        )
        assert steps["step"] >= counts["cycle"]["p50_us"]
        assert steps["start"] / steps["step"] == pytest.approx(
            round(steps["start"] / steps["step"]), abs=1e-3
        )
        assert steps["start"] <= bus["line"]["start"]
        assert len(values) == steps["count"]
        assert sum(values) == sum(bus["line"]["frames"])
        if silence:
            assert max(silence) == max(bus["line"]["silence_us"])


def test_a_legend_has_values_at_rest(opened: Browser) -> None:
    """The figures of a whole plot stand below it while the pointer is elsewhere."""
    legends = opened.run(
        "return [...document.querySelectorAll('#timeline .u-legend')].map((one) => one.innerText)"
    )
    assert any("11 in all" in one for one in legends)
    assert not any(re.search(r":\s*$", line) for one in legends for line in one.splitlines())


PLOTS = [
    (section["id"], plot)
    for section in json.loads(_modlens.report_layout())["section"]
    for plot in section.get("plots", [])
]


@pytest.mark.parametrize(("section", "plot"), PLOTS, ids=[plot["title"] for _, plot in PLOTS])
def test_each_plot_of_the_layout_is_drawn(
    section: str, plot: dict[str, Any], browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """Of ordinary traffic: the sum of each count is in the legend, or its sentence is shown."""
    source, target = tmp_path / "bus.jsonl", tmp_path / "report.html"
    source.write_text("".join(ordinary_traffic(30)))
    options = [] if plot.get("only_without") else ["--line", "19200-8N1"]
    document = json.loads(modlens("stats", source, *options, "--to", "json").out)
    target.write_bytes(page(document))
    browser.open(target)
    shown = browser.run(
        "const head = [...document.querySelectorAll(`#${arguments[0]} h3`)]"
        ".find((one) => one.textContent === arguments[1]);"
        "return head && (head.parentElement.getAttribute('role') === 'group'"
        " ? head.parentElement : head.nextElementSibling).innerText",
        section,
        plot["title"],
    )
    (bus,) = document["overview"]["buses"]
    for series in plot["series"]:
        if series["as"] == "count":
            count = sum(bus["line"][series["path"]])
            assert (f"{count:,} in all" if count else plot["empty"]) in shown
        else:
            assert re.search(rf"{series['name']}:?\s*[\d.,]+( to [\d.,]+)?\s", shown)


def ordinary_traffic(count: int) -> Iterator[str]:
    """Requests for two registers and their responses, ten a second."""
    for number in range(count):
        request, response = (
            rtu(1, b"\x03\0\x10\0\x02"),
            rtu(1, b"\x03\x04\0\x05" + bytes((0, number))),
        )
        for delay_s, frame in ((0.0, request), (0.03, response)):
            line = {"t": round(1.8e9 + number / 10 + delay_s, 6), "hex": frame.hex()}
            yield json.dumps(line) + "\n"


def test_two_pages_for_a_manager_and_an_appendix(opened: Browser) -> None:
    """Printed: the appendix begins on the third page at the latest; nothing is folded or blank."""
    opened.shape(1280, media="print")
    opened.run("window.dispatchEvent(new Event('beforeprint'))")
    shown = "[...document.querySelectorAll('details')].filter((one) => one.checkVisibility())"
    assert opened.run(f"return {shown}.filter((one) => !one.open).length") == 0
    printed = opened.run("return document.querySelectorAll('.example.named').length")
    assert opened.run(f"return {shown}.length") == printed > 0
    scales = opened.run("return Charts.scales()")
    assert scales
    assert all(len(figures) >= 2 for figures in scales)
    found = opened.command("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
    pages = pages_of(base64.b64decode(found["data"]))
    opened.shape(1280)
    opened.run("window.dispatchEvent(new Event('afterprint'))")
    appendix = next(number for number, text in enumerate(pages, 1) if "Appendix" in text)
    assert appendix <= 3
    for word in ("What to do first", "Units", "Timeline", "longest silence"):
        assert any(word in text for text in pages[: appendix - 1])
    assert all(len(text.split()) > 8 for text in pages)


def pages_of(data: bytes) -> list[str]:
    """The text of each page of a PDF, by pdftotext."""
    need_program("pdftotext")
    done = subprocess.run(
        ["pdftotext", "-layout", "-", "-"], input=data, capture_output=True, check=True
    )
    return done.stdout.decode().split("\f")[:-1]


NOISE = "".join(
    json.dumps({"t": 1.8e9 + at, "hex": f"{at * 40503 % 2**64:016x}"}) + "\n" for at in range(300)
)

LITTLE = {
    "noise.jsonl": (
        NOISE.encode(),
        ["Cannot be judged", "No unit was asked"],
    ),
    "quiet.pcap": (PCAP, ["Not Enough To Judge", "Nothing was recorded", "Without times"]),
    "three.hex": (
        b"010300000001840a\n0103020007f986\n" * 3,
        ["are too few to judge the line", "Without times", "No request failed"],
    ),
}
"""Noise, a capture without packets, three transactions: what the page shows."""


@pytest.mark.parametrize("name", LITTLE)
def test_little_or_nothing_was_recorded(
    name: str, browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """The page says so, and has no empty tables."""
    source, target = tmp_path / name, tmp_path / "report.html"
    source.write_bytes(LITTLE[name][0])
    done = modlens("report", source, "--mode", "rtu", "-o", target)
    assert done.status == 0, done.err
    browser.open(target)
    text = browser.run(TEXT)
    for word in LITTLE[name][1]:
        assert word in text
    assert browser.log("browser") == []
    counts = "return [...document.querySelectorAll('tbody')].map((one) => one.rows.length)"
    assert all(browser.run(counts))


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


def test_hostile_texts_are_shown_and_not_run(
    browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """Every text of the document is hostile."""
    target = tmp_path / "page.html"
    target.write_bytes(page(poisoned(document_of(modlens, "pymodbus_disturbed"))))
    browser.requests()
    browser.open(target)
    shows_hostile_texts(browser.run(TEXT))
    assert browser.run(RAN_NOTHING)
    assert browser.requests() == [target.as_uri()]
    assert browser.log("browser") == []
