"""DataFrames, compared with what plain Python makes of the rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest

import modlens
from tests.conftest import CAPTURES
from tests.doctor.frames import read_answer, read_request, rtu
from tests.support.ordinary_traffic import framed

TIMEOUTS = modlens.decode(CAPTURES / "pymodbus_timeouts" / "recording.jsonl", line="19200-8E1")
DEAD = modlens.decode(CAPTURES / "pymodbus_dead_unit" / "recording.jsonl", line="9600-8E1")
PLANT = modlens.decode(CAPTURES / "pymodbus_plant" / "recording.jsonl", line="19200-8E1")
CLOCKLESS = modlens.decode(CAPTURES / "seed_rtu" / "recording.hex")


def test_columns_keep_their_types() -> None:
    frame = TIMEOUTS.transactions.to_pandas()
    kinds = {key: str(kind) for key, kind in frame.dtypes.items()}
    assert kinds["time"] == "datetime64[ns, UTC]"
    assert (kinds["unit"], kinds["retry_of"], kinds["unconfirmed"]) == ("Int64", "Int64", "boolean")
    assert (kinds["status"], kinds["function_name"]) == ("category", "category")
    assert kinds["response_time_us"] == "float64"
    assert [None if row is pd.NA else row for row in frame["retry_of"]] == [
        row.retry_of for row in TIMEOUTS.transactions
    ]


def test_values_stand_by_time_and_name() -> None:
    readings = PLANT.readings.where("unit == 9 and address in (3223, 3224)")
    frame = readings.wide()
    assert list(frame) == ["unit 9 holding_register 3223", "unit 9 holding_register 3224"]
    wanted = [row.value for row in readings if row.address == 3223]
    assert frame.iloc[:, 0].dropna().tolist() == wanted


def test_values_have_their_unit_of_measure(tmp_path: Path) -> None:
    """Of columns that a profile gives one, with and without an interval."""
    profile = tmp_path / "meter.toml"
    profile.write_text(
        'profile = 1\n[device]\nid = "meter"\n'
        '[[registers]]\nat = "hr:0"\nname = "level"\ntype = "u16"\nunit = "mm"\n'
        '[[registers]]\nat = "hr:1"\nname = "state"\ntype = "u16"\n',
        encoding="utf-8",
    )
    path = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
    readings = modlens.decode(path, profiles=[f"1={profile}"]).readings.where("unit == 1")
    assert readings.wide().attrs["units"] == {"level": "mm"}
    assert readings.wide(every="1s").attrs["units"] == {"level": "mm"}


def test_an_interval_without_a_value_stays_empty() -> None:
    """Compared with the values of each second, gathered by hand."""
    readings = DEAD.readings.where("unit == 1 and touches(hr, 0)")
    frame = readings.wide(every="200ms", how="mean")
    by_interval: dict[int, list[float]] = {}
    for row in readings:
        assert row.time is not None
        assert row.value is not None
        by_interval.setdefault(int(row.time.timestamp() * 5), []).append(row.value)
    for moment, value in frame.iloc[:, 0].items():
        values = by_interval.get(round(moment.timestamp() * 5))
        assert (values is None) == pd.isna(value)
        if values:
            assert value == pytest.approx(sum(values) / len(values))
    assert frame.iloc[:, 0].isna().any()


def test_a_name_of_several_units_gets_its_unit(tmp_path: Path) -> None:
    profile = tmp_path / "two.toml"
    profile.write_text(
        'profile = 1\n[device]\nid = "two"\n'
        '[[registers]]\nat = "hr:0"\nname = "level"\ntype = "u16"\n',
        encoding="utf-8",
    )
    path = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
    both = modlens.decode(path, line="19200-8E1", profiles=[str(profile)])
    names = set(both.readings.where("name == 'level'").wide())
    assert names == {"unit 1 level", "unit 2 level"}


@pytest.mark.parametrize("name", ["pymodbus_disturbed", "pymodbus_timeouts", "pymodbus_slow_unit"])
@pytest.mark.parametrize("requests", [1, 2, 3])
def test_outages_are_runs_of_unanswered_requests(name: str, requests: int) -> None:
    """Compared with a walk over the rows, unit by unit."""
    recording = modlens.decode(CAPTURES / name / "recording.jsonl", line="19200-8E1")
    wanted = []
    for unit in {row.unit for row in recording.transactions}:
        run: list[Any] = []
        for row in recording.transactions.where(f"unit == {unit}"):
            if row.status == "no_response":
                run.append(row.time)
            elif row.status in ("ok", "exception", "bad_response"):
                wanted += [(*run[:1], unit, len(run), row.time)] * (len(run) >= requests)
                run = []
        wanted += [(*run[:1], unit, len(run), pd.NaT)] * (len(run) >= requests)
    found = recording.outages(requests=requests)
    rows = [
        (one.begin.to_pydatetime(warn=False), one.unit, one.requests, one.end)
        for one in found.itertuples()
    ]
    assert [row[:3] for row in rows] == [row[:3] for row in sorted(wanted, key=lambda row: row[0])]
    assert [row[3] is pd.NaT for row in rows] == [
        row[3] is pd.NaT for row in sorted(wanted, key=lambda row: row[0])
    ]
    assert (found["duration"].dropna() == (found["end"] - found["begin"]).dropna()).all()


def test_an_outage_to_the_end_has_no_end() -> None:
    (row,) = DEAD.outages().itertuples()
    assert (row.unit, row.requests) == (3, len(DEAD.transactions.where("unit == 3")))
    assert row.end is pd.NaT


def test_response_times_by_unit_and_interval() -> None:
    frame = TIMEOUTS.response_times(("unit", "function"), every="1s")
    times = [row for row in TIMEOUTS.transactions if row.response_time_us is not None]
    assert frame["count"].sum() == len(times)
    for (moment, unit, function), row in frame.iterrows():
        here = [
            one.response_time_us
            for one in times
            if (one.unit, one.function) == (unit, function)
            and one.time is not None
            and one.time.replace(microsecond=0) == moment
        ]
        assert (row["count"], row["max_us"]) == (len(here), max(here))


def test_without_a_clock_there_is_no_time() -> None:
    for call in (CLOCKLESS.readings.wide, CLOCKLESS.outages):
        with pytest.raises(modlens.UsageError, match="has no times"):
            call()
    times = CLOCKLESS.response_times()
    answered = CLOCKLESS.transactions.where("status in ('ok', 'exception')")
    assert (times["count"].sum(), times["answered"].sum()) == (0, len(answered))


@pytest.mark.parametrize(
    ("mistake", "instead"),
    [
        (DEAD.transactions.wide, "recording.readings.wide()"),
        (lambda: DEAD.readings.wide(every="often"), "'15min'"),
        (lambda: DEAD.readings.wide(how="median"), "last, first, mean"),
        (lambda: DEAD.response_times(by="colour"), "colour"),
        (lambda: DEAD.outages(requests=0), "1 or more"),
        (lambda: DEAD.transactions.select("slave"), "write 'unit'"),
        (lambda: DEAD.response_times(by="slave"), "write 'unit'"),
        (lambda: DEAD.where(unit=3), 'where("unit == 3")'),  # type: ignore[arg-type]
        (lambda: DEAD.transactions.where(status="ok"), "where(\"status == 'ok'\")"),  # type: ignore[arg-type]
        (lambda: DEAD.where(3), 'where("unit == 1'),  # type: ignore[arg-type]
        (lambda: DEAD.transactions.to_pandas(columns=["unit"]), 'select("unit", "status")'),  # type: ignore[arg-type]
    ],
)
def test_a_mistake_says_what_to_write(mistake: Any, instead: str) -> None:
    with pytest.raises(modlens.ModlensError, match=instead.replace("(", r"\(").replace(")", r"\)")):
        mistake()


@pytest.mark.parametrize(
    ("rows", "name", "instead"),
    [
        (DEAD.transactions, "response_times", "write recording.response_times()"),
        (DEAD.transactions, "to_csv", 'write write("rows.csv")'),
        (DEAD.transactions, "query", 'write where("unit == 1")'),
        (DEAD.transactions, "slave", "write 'unit'"),
        (DEAD.transactions, "unitt", "did you mean 'unit'?"),
        (DEAD, "wide", "write recording.readings.wide()"),
        (DEAD, "groupby", "write recording.transactions.to_pandas()"),
    ],
)
def test_a_name_that_is_missing_says_what_to_write(rows: Any, name: str, instead: str) -> None:
    with pytest.raises(AttributeError) as raised:
        getattr(rows, name)
    assert instead in str(raised.value)


def test_times_that_few_answers_have_are_a_warning() -> None:
    """By a clock of 1 s only the time of the slow answer is known."""
    pair = [framed(bytes.fromhex(body)).hex(" ") for body in ("0103006B0001", "0103020007")]
    times = [("00", "00"), *[(f"{second:02}", f"{second:02}") for second in range(2, 20)]]
    times.append(("30", "35"))
    text = "".join(
        f"12:00:{at} {word} {frame}\n"
        for pair_times in times
        for at, word, frame in zip(pair_times, ("TX", "RX"), pair, strict=True)
    )
    with pytest.warns(UserWarning, match="compare count with answered"):
        table = modlens.decode(text.encode()).response_times()
    assert table.loc[1, "answered"] == len(times)


def test_times_by_a_column_with_empty_cells_have_a_row_for_these() -> None:
    """On a serial line no transaction has a client."""
    frame = TIMEOUTS.response_times(by=["unit", "client"])
    assert frame["answered"].sum() == TIMEOUTS.response_times()["answered"].sum() > 0


def test_many_recordings_that_are_there_twice_are_one_warning(tmp_path: Path) -> None:
    """Ten recordings of one folder, each beside its bytes alone."""
    for number in range(1, 11):
        unit = f"{number:02X}"
        pair = [bytes.fromhex(f"{unit}03006B0001"), bytes.fromhex(f"{unit}03020007")]
        frames = [framed(body).hex(" ") for body in pair]
        lines = [
            f"12:00:{second:02}.{part}00 {word} {frame}\n"
            for second in range(30)
            for part, word, frame in ((0, "TX", frames[0]), (1, "RX", frames[1]))
        ]
        (tmp_path / f"{number}.log").write_text("".join(lines))
        (tmp_path / f"{number}.bin").write_bytes(bytes.fromhex("".join(frames)) * 30)
    with pytest.warns(UserWarning, match="counted twice") as caught:
        modlens.decode(tmp_path).stats()
    [warning] = [one for one in caught if "counted twice" in str(one.message)]
    assert "(and 9 more such pairs)" in str(warning.message)


def test_a_stream_of_long_rows_ends(tmp_path: Path) -> None:
    """Tables of fewer rows than a batch should have, whose values are more bytes than it may."""
    path = tmp_path / "long.bin"
    exchanges = 4000
    request = rtu(1, read_request(3, 0, 125))
    values = list(range(125))
    path.write_bytes(
        b"".join(
            request + rtu(1, read_answer(3, [number, *values[1:]])) for number in range(exchanges)
        )
    )
    rows = modlens.decode(path, read_as="raw", mode="rtu").transactions
    batches = list(pa.RecordBatchReader.from_stream(rows))
    assert sum(batch.num_rows for batch in batches) == exchanges
    assert len(batches) > 2
    assert [row["data"][0] for batch in batches for row in batch.to_pylist()] == list(
        range(exchanges)
    )
