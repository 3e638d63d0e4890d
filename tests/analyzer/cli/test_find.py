"""`find`: the register that holds a value, by history or changes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer.cli.find_times import RecordedTimes
from analyzer.cli.history_file import load_history
from analyzer.marks import note_mark
from dissectors.errors import SourceError, UsageError
from tests.conftest import Modlens

START = 1_781_515_800
"""2026-06-15 09:30 UTC."""


def registers(second: int) -> list[int]:
    """A voltage in tenths, a temperature that drifts, a constant, and a stage with one pulse."""
    voltage = 2300 + round(30 * math.sin(second / 300) + 9 * math.cos(second / 47))
    temperature = 215 + second // 240
    stage = 3 if 1_000 <= second < 2_000 else 1
    return [voltage, temperature, 2314, stage]


def frame(body: bytes) -> str:
    return (body + _modlens.crc16(body).to_bytes(2, "little")).hex()


@pytest.fixture
def recording(tmp_path: Path) -> str:
    """An hour, a poll every ten seconds, of registers 100 to 103 of unit 7."""
    lines = []
    for second in range(0, 3_600, 10):
        data = b"".join(word.to_bytes(2, "big") for word in registers(second))
        for late, body in ((0.0, bytes.fromhex("070300640004")), (0.05, b"\x07\x03\x08" + data)):
            lines.append(json.dumps({"t": START + second + late, "hex": frame(body)}))
    path = tmp_path / "bus.jsonl"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def found(modlens: Modlens, recording: str, *words: str) -> list[dict[str, Any]]:
    done = modlens("find", recording, *words, "--times", "utc", "--to", "jsonl")
    return [json.loads(line) for line in done.out.splitlines()]


def test_three_values_decide(modlens: Modlens, recording: str) -> None:
    words = []
    for second, at in ((600, "9:40:00"), (1500, "09:55:00"), (3000, "2026-06-15T10:20:00Z")):
        words += ["--value", f"{registers(second)[0] / 10}", "--at", at]
    best = found(modlens, recording, *words)[0]
    assert (best["unit"], best["register_type"], best["address"]) == (7, "holding_register", 100)
    assert (best["type"], best["scale"], best["offset"], best["rank"]) == ("u16", 0.1, 0.0, 1)
    assert best["odds_bits"] > 3


def test_one_value_names_when_to_look_again(modlens: Modlens, recording: str) -> None:
    """The constant 231.4 and the voltage fit alike where the voltage is 231.4, too."""
    second = next(s for s in range(0, 3_600, 10) if registers(s)[0] == 2314)
    done = modlens("find", recording, "--value", "231.4", "--at", str(second), "--times", "utc")
    assert "hr 100" in done.out
    assert "hr 102" in done.out
    assert "Tell them apart: a second value, best at " in done.out


def test_a_value_that_was_never_there(modlens: Modlens, recording: str) -> None:
    """46 is 2300 x 0.02, which no device does: the chances say so, and so does the last line."""
    words = ("--value", "46", "--at", "9:40:00", "--times", "utc")
    lines = modlens("find", recording, *words).out.splitlines()
    assert "none of these: the value was not on the line" in lines[-2]
    assert lines[-1].startswith("Probably none of these")
    assert not any("cannot tell them apart" in line for line in lines)


def test_what_changed(modlens: Modlens, recording: str) -> None:
    words = ["--same", "9:31..9:45", "--up", "9:45..9:48", "--down", "10:02..10:05"]
    best = found(modlens, recording, *words)[0]
    assert best["address"] == 103
    assert best["odds_bits"] > 1


def test_marks_are_times(modlens: Modlens, recording: str) -> None:
    """As `k` on the screens of a tap notes them beside the recording: the same as their times."""
    times = ("9:31", "9:45", "9:48", "10:02", "10:05")
    for number, text in enumerate(times, 1):
        hour, _, minute = text.partition(":")
        second = START + 3600 * (int(hour) - 9) + 60 * (int(minute) - 30)
        note_mark(recording, number, second * 10**9)
    by_marks = ["--same", "k1..k2", "--up", "k2..k3", "--down", "k4..k5"]
    by_times = ["--same", "9:31..9:45", "--up", "9:45..9:48", "--down", "10:02..10:05"]
    assert found(modlens, recording, *by_marks) == found(modlens, recording, *by_times)
    missing = modlens("find", recording, "--up", "k4..k9", "--times", "utc")
    assert "--up k9: no such mark beside the recording (there: k1, k2, k3, k4, k5)" in missing.err


@pytest.mark.parametrize("form", ["home assistant", "grafana"])
def test_a_history(modlens: Modlens, recording: str, tmp_path: Path, form: str) -> None:
    """In Fahrenheit from Home Assistant; from Grafana in another zone, 40 s late, comma and all."""
    path = tmp_path / "history.csv"
    lines = ["entity_id,state,last_changed"] if form == "home assistant" else ["Time;Voltage"]
    for second in range(60, 3_500, 60):
        if form == "home assistant":
            shown = registers(second)[1] / 10 * 1.8 + 32
            lines.append(f"sensor.flow,{shown:.1f},{iso(second)}Z")
        else:
            shown = registers(second)[0] / 10
            lines.append(f"{iso(second + 2 * 3600 + 40)};{shown:.1f}".replace(".", ","))
    path.write_text("\n".join(lines))
    best = found(modlens, recording, "--like", str(path))[0]
    if form == "home assistant":
        assert (best["address"], round(best["scale"], 3), best["offset"]) == (101, 0.18, 32)
    else:
        assert (best["address"], best["scale"], best["offset"]) == (100, 0.1, 0)


def iso(second: int) -> str:
    minutes, seconds = divmod(34_200 + second, 60)
    return f"2026-06-15 {minutes // 60:02d}:{minutes % 60:02d}:{seconds:02d}"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "say what is known of the value"),
        (("--value", "12", "--value", "13", "--at", "9:40"), "2 --value and 1 --at"),
        (("--value", "high"), "--value high: not a number"),
        (("--value", "12", "--at", "noon"), "--at noon: not a time"),
        (("--value", "12", "--at", "2020-01-01"), "the recording is from"),
        (("--up", "9:40"), "write two times"),
        (("--up", "9:45..9:40"), "the second time is not after the first"),
        (("--like", "absent.csv"), "absent.csv: cannot be read"),
    ],
)
def test_mistakes(modlens: Modlens, recording: str, words: tuple[str, ...], says: str) -> None:
    done = modlens("find", recording, *words, "--times", "utc")
    assert done.status in (2, 3)
    assert says in done.err


def test_a_time_of_day_needs_one_day() -> None:
    day = 86_400 * 10**9
    times = RecordedTimes(START * 10**9, START * 10**9 + 2 * day, {}, local=False)
    with pytest.raises(UsageError, match="several such days; give the date"):
        times.moment("12:00", "--at")
    assert times.moment("2026-06-16 12:00", "--at") == (START + 86_400 + 9_000) * 10**9


def test_history_files_that_leave_something_open(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    rows = [f"2026-06-15T09:{i:02d}:00Z,{i},{2 * i}" for i in range(12)]
    path.write_text("\n".join(["time,flow,return", *rows]))
    with pytest.raises(UsageError, match=r"choose one with --like .*:NAME: flow, return"):
        load_history(str(path), None)
    assert load_history(str(path), "return").values[3] == 6
    path.write_text("a,b\n1,2\n")
    with pytest.raises(SourceError, match="no column of times"):
        load_history(str(path), None)
