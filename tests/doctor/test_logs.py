"""Half of those who ask have nothing but a client's log, with a clock of a second or none.

What needs no tap is diagnosed from it; what does is said not to be judged, with what it takes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from analyzer import decode
from tests.doctor.cases import make
from tests.doctor.examine import subject_fits, written

SEED = 3
CLIENT = "client, no clock.log"
SERVER = "server, seconds.log"


def judged(kind: str, view: str, folder: Path) -> tuple[Any, dict[str, Any]]:
    """What was expected of a case, and what the doctor reports about one side's log of it."""
    case = make(kind, SEED)
    written(replace(case, files={**case.files, **case.views()}), folder)
    return case.expected, decode(folder / view).doctor()


@pytest.mark.parametrize("view", [CLIENT, SERVER])
@pytest.mark.parametrize("kind", ["device_busy", "register_hole", "unexpected_writer"])
def test_what_needs_no_tap_is_told_from_a_log(kind: str, view: str, tmp_path: Path) -> None:
    expected, found = judged(kind, view, tmp_path)
    assert any(subject_fits(row, expected) for row in found["diagnoses"]), found["sentence"]


@pytest.mark.parametrize("view", [CLIENT, SERVER])
def test_what_needs_a_clock_is_said_not_to_be_judged(view: str, tmp_path: Path) -> None:
    _, found = judged("device_busy", view, tmp_path)
    lacking = [row for row in found["not_judged"] if "no clock" in row["what"]]
    assert lacking
    assert "modlens tap" in lacking[0]["needs"]


def test_a_log_of_a_healthy_line_is_healthy(tmp_path: Path) -> None:
    """No cause is made up where half of the evidence is missing."""
    for view in (CLIENT, SERVER):
        _, found = judged("a set point that moves", view, tmp_path / view)
        assert found["verdict"] == "healthy", found["sentence"]
        assert found["diagnoses"] == []


def test_too_few_requests_are_said_to_be_too_few(tmp_path: Path) -> None:
    case = make("a set point that moves", SEED)
    written(replace(case, files=case.views()), tmp_path)
    log = tmp_path / CLIENT
    log.write_text("".join(log.read_text("utf-8").splitlines(keepends=True)[:8]), "utf-8")
    found = decode(log).doctor()
    assert found["verdict"] == "unknown"
    assert any("too few" in row["what"] for row in found["not_judged"])
