"""`--where` and `--between` of commands that count: as if nothing else had been recorded."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import modlens
from analyzer.cli import main
from analyzer.filters import selection
from analyzer.session import FileRun
from analyzer.settings import Settings
from tests.conftest import CAPTURES

EVERYTHING = "bus != ''"
RECORDINGS = sorted(path.name for path in CAPTURES.iterdir() if list(path.glob("recording.*")))
DISTURBED = str(CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
DEAD = str(CAPTURES / "pymodbus_dead_unit" / "recording.jsonl")


def document(path: Path, where: str | None) -> dict[str, Any]:
    select = () if where is None else selection(lambda _: where)
    run = FileRun([str(path)], Settings(tables=("diagnoses",), overview="all", select=select))
    for _ in run.batches():
        pass
    return run.document()


def without_order(found: dict[str, Any]) -> dict[str, Any]:
    """What depends on when a transaction was decided, and what rows do not show, left out."""
    for bus in found["statistics"]["buses"]:
        bus["silence"] = None
        for request in (bus["timeouts"] or {"requests": []})["requests"]:
            request["before"] = None
    return found


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_condition_that_all_rows_meet_changes_nothing(name: str) -> None:
    """Doctor, statistics and overview of all rows, counted again, are those of the core.

    Only the verdict's sentence differs: it says that it is of a selection and not of the line.
    """
    path = next((CAPTURES / name).glob("recording.*"))
    chosen, whole = (without_order(document(path, where)) for where in (EVERYTHING, None))
    said, of_line = (found["doctor"].pop("sentence") for found in (chosen, whole))
    assert chosen == whole
    assert said == of_line or said.startswith("Of what was selected, ")


def test_statistics_of_a_selection_are_those_of_its_rows() -> None:
    recording = modlens.decode(DISTURBED, line="19200-8E1")
    for text in ("write", "no_response or retry", "function == 4", "response_time_us > 10e3"):
        chosen = recording.where(text)
        rows = list(recording.transactions.where(text))
        assert [row.txn for row in chosen.transactions] == [row.txn for row in rows]
        counts: dict[str, int] = {}
        for row in rows:
            counts[row.status] = counts.get(row.status, 0) + 1
        assert chosen.stats()["transactions"] == counts
        numbers = {row.txn for row in rows}
        frames = [row.frame for row in recording.frames if row.txn in numbers]
        assert [row.frame for row in chosen.frames if row.txn is not None] == frames


def test_a_stretch_of_time_has_its_noise() -> None:
    """Frames of no transaction are chosen by the condition itself, where it is about them."""
    recording = modlens.decode(DISTURBED, line="19200-8E1")
    noise = [row.frame for row in recording.frames.where("noise and elapsed_us < 2e6")]
    assert noise
    assert [row.frame for row in recording.where("elapsed_us < 2e6").frames.where("noise")] == noise
    assert not list(recording.where("status == 'ok'").frames.where("noise and txn is None"))


def test_the_doctor_judges_the_selection(capsys: pytest.CaptureFixture[str]) -> None:
    """A bus with one dead unit is healthy without it."""
    assert (
        main(["doctor", DEAD, "--line", "57600-8E1", "--to", "json", "--where", "unit == 3"]) == 0
    )
    assert json.loads(capsys.readouterr().out)["verdict"] == "broken"
    assert (
        main(["doctor", DEAD, "--line", "57600-8E1", "--to", "json", "--where", "unit != 3"]) == 0
    )
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["failed"]) == ("healthy", 0)


@pytest.mark.parametrize("command", ["doctor", "stats", "map"])
def test_commands_take_a_stretch_of_time(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, DISTURBED, "--between", "0", "1", "--line", "19200-8E1"]) == 0
    first = capsys.readouterr().out
    assert main([command, DISTURBED, "--line", "19200-8E1"]) == 0
    assert capsys.readouterr().out != first != ""


@pytest.mark.parametrize("command", ["doctor", "stats", "report"])
def test_a_selection_of_nothing_is_an_error(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is no verdict about the line."""
    output = ["-o", "-"] if command == "report" else []
    assert main([command, DISTURBED, "--where", "unit == 200", *output]) != 0
    assert "--where: nothing in this recording meets this" in capsys.readouterr().err


def test_a_report_says_that_it_is_of_a_selection(capsys: pytest.CaptureFixture[str]) -> None:
    """And of which, beside the period."""
    words = ["--line", "19200-8E1", "--where", "unit == 1 and write", "-o", "-"]
    assert main(["report", DISTURBED, *words]) == 0
    assert "Only what meets unit == 1 and write." in capsys.readouterr().out
    assert main(["report", DISTURBED, "--line", "19200-8E1", "-o", "-"]) == 0
    assert "Only what meets" not in capsys.readouterr().out
