"""`--between`: a part of a recording by its times."""

from __future__ import annotations

import json
import operator
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from analyzer.cli import main
from analyzer.cli.between import combine_filters
from analyzer.filters import Tree, parse
from analyzer.times import parse_ns
from tests.conftest import CAPTURES

RECORDING = str(CAPTURES / "pymodbus_two_units" / "recording.jsonl")
DISTURBED = str(CAPTURES / "pymodbus_disturbed" / "recording.jsonl")


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


@pytest.fixture
def berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A computer in Berlin: UTC+1 in November, when the recording was made."""
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("berlin")
@pytest.mark.parametrize("words", [(), ("--times", "utc")])
@pytest.mark.parametrize("table", ["transactions", "frames"])
@pytest.mark.parametrize("day", ["", "2026-11-21 "])
def test_the_times_that_the_table_shows(
    capsys: pytest.CaptureFixture[str], words: tuple[str, ...], table: str, day: str
) -> None:
    """Copied out of the table, they select the rows from one line of it to before another."""
    command = ["decode", DISTURBED, "--table", table, *words]
    assert main(command) == 0
    shown = [line.split()[:2] for line in capsys.readouterr().out.splitlines()[2:]]
    assert shown[0][1] == ("11:12:56.645" if words else "12:12:56.645")
    (_, first), (_, last) = shown[4], shown[11]
    for bounds in ((day + first, day + last), (day + first, last)):
        assert main([*command, "--between", *bounds]) == 0
        found = [line.split()[:2] for line in capsys.readouterr().out.splitlines()[2:]]
        assert found == shown[4:11]


@pytest.mark.usefixtures("berlin")
def test_a_time_of_day_means_every_day_in_its_zone() -> None:
    """Over midnight, and on both sides of the change to summer time (29 March 2026, 1:00 UTC)."""
    moments = ["2026-03-28T11:00:05Z", "2026-03-29T10:00:05Z", "2026-03-29T11:00:05Z"]
    text = combine_filters(None, ["12:00", "12:01"])
    assert text is not None
    assert [holds(text, moment) for moment in moments] == [True, True, False]
    assert holds("time == '13:00:05 +02:00'", moments[2])
    assert holds("'11:00' < time", moments[2])
    assert not holds("time < '11:00:05 utc'", moments[2])
    over_midnight = combine_filters(None, ["23:59", "0:01"], zone="utc")
    assert over_midnight is not None
    midnight = ["2026-03-28T23:58:59Z", "2026-03-28T23:59:00Z", "2026-03-29T00:00:59.9Z"]
    assert [holds(over_midnight, moment) for moment in midnight] == [False, True, True]
    assert not holds(over_midnight, "2026-03-29T00:01Z")


def holds(text: str, moment: str) -> bool:
    """Whether a filter selects a row at this moment, by a small interpreter of filter trees."""
    return bool(value(parse(text).tree, parse_ns(moment)))


OPERATIONS: dict[str, Callable[..., Any]] = {
    "and": lambda a, b: a and b, "or": lambda a, b: a or b, "==": operator.eq, "<": operator.lt,
    ">=": operator.ge, "+": operator.add, "%": operator.mod,
}  # fmt: skip


def value(tree: Tree, moment_ns: int | None) -> Any:
    """The value of a tree whose only column is the time."""
    head, *rest = tree
    if head in ("num", "time"):
        return rest[0]
    if head == "col":
        return moment_ns
    if head in ("cmp", "arith"):
        head, *rest = rest
    return OPERATIONS[head](*(value(part, moment_ns) for part in rest))


def test_nothing_between_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """Where no row has such a time, with the zone that times are taken in."""
    assert main(["decode", DISTURBED, "--between", "3:00", "3:01"]) == 0
    said = capsys.readouterr().err
    assert "no row has such a time; times without a zone are" in said
    assert "over midnight" not in said
    assert (
        main(
            [
                "export",
                DISTURBED,
                "--between",
                "3:01",
                "3:00",
                "--times",
                "utc",
                "--where",
                "unit == 99",
                "--to",
                "csv",
            ]
        )
        == 0
    )
    assert "T2 is earlier in the day than T1, which means over midnight" in capsys.readouterr().err


def test_a_condition_on_times_that_selects_nothing_is_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Only where the condition compares times."""
    assert main(["decode", DISTURBED, "--where", "time < '2001-01-01'"]) == 0
    assert "--where: no row matches; times without a zone are UTC" in capsys.readouterr().err
    assert main(["decode", DISTURBED, "--where", "unit == 77"]) == 0
    assert "no row matches" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        (("last week", "2026-01-01"), "not a time"),
        (("1", "inf"), "not a time"),
        (("2", "1"), "T2 is before"),
        (("2", "2"), "T2 is before T1, or equal"),
        (("12:00", "12:00"), "T2 is before T1, or equal"),
        (("1", "2026-01-01"), "not one of each"),
        (("12:00", "2026-01-01"), "not one of each"),
        (
            ("12:00", "25:00"),
            "not a time; write 2023-10-11T14:00:00Z, 14:00:00, yesterday, or seconds",
        ),
    ],
)
def test_what_cannot_be_between(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], bounds: tuple[str, str], said: str
) -> None:
    out = tmp_path / "out.csv"
    assert main(["export", RECORDING, "-o", str(out), "--between", *bounds]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()


def test_yesterday_and_today_are_midnights(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the zone in which the table shows times: in Kiritimati it is a day later than in UTC."""
    monkeypatch.setenv("TZ", "Pacific/Kiritimati")
    time.tzset()
    try:
        for zone in ("local", "utc"):
            text = combine_filters(None, ["yesterday", "today"], zone=zone)
            now = datetime.now().astimezone() if zone == "local" else datetime.now(UTC)
            midnight = now.replace(hour=0, minute=0, second=0, microsecond=0)
            dates = [str((midnight - timedelta(back)).date()) for back in (1, 0)]
            assert text == combine_filters(None, dates, zone=zone)
    finally:
        monkeypatch.undo()
        time.tzset()


def test_one_bound_is_too_few_and_says_what_to_write(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "--between", "yesterday"]) == 2
    assert "such as --between yesterday today" in capsys.readouterr().err
    assert main(["doctor", RECORDING, "--unit", "3"]) == 2
    assert "--where 'unit == 3'" in capsys.readouterr().err
