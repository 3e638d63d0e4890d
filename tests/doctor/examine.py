"""Runs the doctor over a case and compares its diagnoses with what was expected.

`examine(make("lockstep", 1)).place` is 1 where the right diagnosis is named first, None where it is
not named at all.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analyzer import decode
from tests.conftest import ROOT, environment
from tests.doctor.case import Case, Expected

__all__ = ["Outcome", "diagnose", "examine", "ran", "subject_fits", "written"]

TIMEOUT_S = 120
SUBJECT = ("unit", "function", "address", "client")
Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Which place the expected code has among the diagnoses, from 1, and what else was said.

    `fits` says whether its subject is right, `confused` which forbidden codes were named before it,
    or at all if nothing is expected, `errors` the codes of severity error.
    """

    rows: list[Row]
    place: int | None
    fits: bool
    confused: tuple[str, ...]
    errors: tuple[str, ...]

    @property
    def first(self) -> str:
        """The code named first."""
        return self.rows[0]["code"] if self.rows else "nothing"


def ran(*words: str | Path, cwd: Path) -> str:
    """What a command of modlens prints; RuntimeError with its last words when it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "analyzer", *map(str, words)],
        capture_output=True,
        timeout=TIMEOUT_S,
        env=environment(PYTHONPATH=str(ROOT)),
        cwd=cwd,
        check=False,
    )
    if done.returncode not in (0, 1):
        raise RuntimeError(f"modlens {' '.join(map(str, words))}: {done.stderr.decode()[-400:]}")
    return done.stdout.decode()


def diagnose(recording: str | Path, words: Sequence[str], folder: Path) -> list[Row]:
    """The diagnoses of a recording, by harm; `words` are those of the command."""
    given = dict(zip(words[::2], words[1::2], strict=True))
    profiles = []
    if "--profile" in given:
        units, _, name = given["--profile"].partition("=")
        profiles = [f"{units}={folder / name}"]
    decoding = decode(
        folder / recording,
        line=given.get("--line"),
        mode=given.get("--mode", "auto"),
        read_as=given.get("--from"),
        profiles=profiles,
    )
    rows: list[Row] = decoding.doctor()["diagnoses"]
    return rows


def written(case: Case, folder: Path) -> Path:
    """Write the case's files; the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in case.files.items():
        (folder / name).write_bytes(data)
    return folder


def examine(case: Case) -> Outcome:
    """Diagnose the case's main recording."""
    with tempfile.TemporaryDirectory() as scratch:
        rows = diagnose(case.main, case.words, written(case, Path(scratch)))
    return judged(case, rows)


def judged(case: Case, rows: list[Row]) -> Outcome:
    """The rows beside what was expected; a code counts with the right subject first."""
    errors = tuple(row["code"] for row in rows if row["severity"] == "error")
    expected = case.expected
    if expected is None:
        said = tuple(row["code"] for row in rows if row["code"] in case.forbidden)
        return Outcome(rows, None, not said, said, errors)
    counted = [row for row in rows if row["code"] not in case.beside]
    place = next((at for at, row in enumerate(counted, 1) if row["code"] == expected.code), None)
    before = counted[: place - 1] if place else counted
    confused = tuple(row["code"] for row in before)
    fits = any(subject_fits(row, expected) for row in rows)
    return Outcome(rows, place, fits, confused, errors)


def subject_fits(row: Row, expected: Expected) -> bool:
    """The code, and the subject as far as one is expected."""
    if row["code"] != expected.code:
        return False
    wanted = {key: getattr(expected, key) for key in SUBJECT}
    return all(value is None or row.get(key) == value for key, value in wanted.items())
