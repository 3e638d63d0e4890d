"""A row for each bus and day: from counters, over an archive, of a tap's last days."""

from __future__ import annotations

import csv
import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

import _modlens
from analyzer.bus_days import COLUMNS, bus_day
from tests.support.fleet import Traffic, archive

DAY = {
    "date": "2026-11-20",
    "bus": "pumps",
    "seconds": 200.0,
    "verdict": "trouble",
    "sentence": "the line works, but unit 2 is slow",
    "requests": 1000,
    "failed": 30,
    "diagnoses": [
        {"code": "slow_answers", "unit": 2},
        {"code": "line_noise", "unit": None},
        {"code": "value_spike", "unit": 1},
        {"code": "address_off_by_one", "unit": 1},
    ],
    "reserves": [
        {"unit": 1, "requests": 600, "answered": 600, "damaged": 3, "late": 0}
        | {"response_time_p99_us": 20_000.0, "timeout_us": 100_000.0},
        {"unit": 2, "requests": 400, "answered": 370, "damaged": 2, "late": 10}
        | {"response_time_p99_us": 95_000.0, "timeout_us": 100_000.0},
    ],
    "not_judged": [],
}


def test_a_row_is_what_the_counters_say() -> None:
    """Each number by hand from those above."""
    assert bus_day(DAY) == {
        "date": "2026-11-20",
        "bus": "pumps",
        "verdict": "trouble",
        "diagnosis_1": "slow_answers unit 2",
        "diagnosis_2": "line_noise",
        "diagnosis_3": "value_spike unit 1",
        "requests": 1000,
        "requests_per_s": 5.0,
        "failed_share": 0.03,
        "damaged_share": 0.005,
        "late_share": 0.01,
        "weakest_unit": 2,
        "answered_share": 0.925,
        "slowest_unit": 2,
        "response_time_p99_us": 95_000.0,
        "timeout_us": 100_000.0,
        "time_reserve": 0.05,
        "sentence": "the line works, but unit 2 is slow",
    }


def test_what_is_not_known_is_null() -> None:
    empty = {**DAY, "date": None, "seconds": None, "requests": 0, "failed": 0}
    row = bus_day({**empty, "diagnoses": [], "reserves": []})
    known = {name for name, value in row.items() if value is not None}
    assert known == {"bus", "verdict", "requests", "sentence"}
    assert list(row) == list(COLUMNS)


def doctor(*words: str, cwd: Path) -> tuple[list[dict[str, str]], subprocess.CompletedProcess[str]]:
    command = [sys.executable, "-m", "analyzer", "doctor", *words, "--to", "csv"]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    return list(csv.DictReader(io.StringIO(done.stdout))), done


@pytest.mark.parametrize("threads", ["1", "2"])
def test_an_archive_has_a_row_for_each_bus_and_day(tmp_path: Path, threads: str) -> None:
    """Three shifts a day; every seventeenth request of three units has no answer."""
    archive(tmp_path / "archive", buses=4, shifts=7, requests=170)
    rows, done = doctor("archive/", "--threads", threads, cwd=tmp_path)
    assert done.returncode == 3, "one file is damaged"
    assert "cut.jsonl.gz" in done.stderr
    of_first = [row for row in rows if row["bus"] == "bus-00"]
    assert [row["date"] for row in of_first[:2]] == ["2026-11-20", "2026-11-21"]
    # What a recording's ends cut off shows nothing: two requests of each shift at most.
    assert all(3 * 168 <= int(row["requests"]) <= 3 * 170 for row in of_first[:2])
    assert [row["date"] for row in rows if row["bus"] == "10.0.3.2:502"] == [
        "2026-11-20",
        "2026-11-21",
        "2026-11-22",
    ]
    # Without a date a bus has one row for all.
    assert [row["date"] for row in rows if row["bus"] in {"bus-01", "bus-02"}] == ["", ""]
    [undated] = [row for row in rows if row["bus"] == "bus-02"]
    assert 7 * 168 <= int(undated["requests"]) <= 7 * 170
    assert all(8 / 168 - 1e-5 <= float(row["failed_share"]) <= 10 / 170 for row in rows)
    assert {row["verdict"] for row in rows} <= {"trouble", "broken"}


def test_a_day_of_trouble_is_told_on_that_day_only(tmp_path: Path) -> None:
    """A unit that is silent the whole second day, and answers on the first and the third."""
    lines = []
    for shift in (0, 3, 6):
        for now, request, answer in Traffic(0, shift, 300).exchanges():
            lines.append((now, request))
            if answer is not None and not (shift == 3 and request[0] == 2):
                lines.append((now + 21_000_000, answer))
    (tmp_path / "tap.jsonl").write_text(
        "".join(f'{{"t": {now / 1e9:.3f}, "hex": "{data.hex()}"}}\n' for now, data in lines)
    )
    rows, _ = doctor("tap.jsonl", cwd=tmp_path)
    assert [row["date"] for row in rows] == ["2026-11-20", "2026-11-21", "2026-11-22"]
    weak = [(row["weakest_unit"], float(row["answered_share"])) for row in rows]
    assert weak[1] == ("2", 0.0)
    assert all(share > 0.9 for _, share in (weak[0], weak[2]))
    assert "unit 2" in rows[1]["diagnosis_1"]
    assert all("unit 2" not in row["diagnosis_1"] for row in (rows[0], rows[2]))


def test_days_that_are_not_kept_are_forgotten() -> None:
    days, core = _modlens.Days(2), _modlens.Session(_modlens.Functions(), live=True)
    bus = core.add_bus("pumps", source="pumps", clock="utc")
    for shift in (0, 3, 6, 9):
        for now, data in Traffic(0, shift, 20).reads():
            core.feed(bus, data, now)
        days.add(core.take())
    core.flush()
    days.add(core.take())
    assert [day["date"] for day in json.loads(days.rows())] == ["2026-11-22", "2026-11-23"]
