"""`--between`: a part of a recording by its times."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from analyzer.cli import main
from tests.conftest import CAPTURES

RECORDING = str(CAPTURES / "pymodbus_two_units" / "recording.jsonl")


def rows(path: Path, *words: str) -> list[dict[str, Any]]:
    """What `modlens export` writes with these options."""
    assert main(["export", RECORDING, "-o", str(path), *words]) == 0
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.mark.parametrize("table", ["transactions", "frames", "readings"])
def test_the_first_moment_is_in_and_the_last_is_not(tmp_path: Path, table: str) -> None:
    everything = rows(tmp_path / "all.jsonl", "--table", table)
    moments = sorted({row["time"] for row in everything})
    first, last = moments[3], moments[-2]
    found = rows(tmp_path / "some.jsonl", "--table", table, "--between", first, last)
    assert found == [row for row in everything if first <= row["time"] < last]
    assert 0 < len(found) < len(everything)


def test_zones_and_seconds(tmp_path: Path) -> None:
    everything = rows(tmp_path / "all.jsonl")
    moment = datetime.fromisoformat(everything[5]["time"])
    zone = moment.replace(tzinfo=None).isoformat() + "+00:00"
    found = rows(tmp_path / "zone.jsonl", "--between", zone, "2100-01-01")
    assert found == everything[5:]
    found = rows(tmp_path / "seconds.jsonl", "--between", "0.2", "0.4")
    assert found == [row for row in everything if 200_000 <= row["elapsed_us"] < 400_000]


def test_with_a_filter_whatever_its_operators(tmp_path: Path) -> None:
    words = ("--where", "unit == 1 or unit == 2", "--between", "0.2", "0.4")
    assert rows(tmp_path / "both.jsonl", *words) == rows(tmp_path / "one.jsonl", *words[2:])


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        (("yesterday", "2026-01-01"), "not a time"),
        (("1", "inf"), "not a time"),
        (("2", "1"), "T2 is before"),
        (("1", "2026-01-01"), "not one of each"),
    ],
)
def test_what_cannot_be_between(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], bounds: tuple[str, str], said: str
) -> None:
    out = tmp_path / "out.csv"
    assert main(["export", RECORDING, "-o", str(out), "--between", *bounds]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()
