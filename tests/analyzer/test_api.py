"""The public API, as a program uses it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import analyzer
from analyzer import SourceError, UsageError, decode
from analyzer.columns import TABLES
from tests.conftest import ROOT, recording_with, without

POLLS = "pymodbus_two_units/recording.jsonl"

HEAVY = ("rich", "serial", "scapy", "argparse", "asyncio", "pyarrow", "polars", "numpy")


def test_transactions_of_a_recording(captures: Path) -> None:
    """Iterating a decoding gives its transactions, again each time."""
    recording = decode(captures / POLLS, line="19200-8E1")
    first = [(row.txn, row.unit, row.status) for row in recording]
    again = [(row.txn, row.unit, row.status) for row in recording.transactions]
    assert first == again
    assert first[0] == (1, 1, "ok")


@pytest.mark.parametrize("name", TABLES)
def test_each_table_has_its_columns(name: str) -> None:
    """Rows have the columns as attributes, in order."""
    rows = getattr(decode(recording_with(name)), name)
    assert rows.name == name
    row = next(iter(rows))
    assert tuple(row.as_dict()) == rows.columns


def test_several_recordings_are_one_sequence(captures: Path) -> None:
    """Numbers go on from file to file, and each file is a bus."""
    names = [captures / "seed_rtu" / "recording.hex", captures / "seed_ascii" / "recording.bin"]
    rows = list(decode(names).frames)
    assert [row.frame for row in rows] == list(range(1, len(rows) + 1))
    assert {row.bus for row in rows} == {str(name) for name in names}


def test_statistics_of_a_recording(captures: Path) -> None:
    """`stats` has the counters of a whole pass."""
    recording = decode(captures / POLLS, line="19200-8E1")
    stats = recording.stats()
    assert sum(stats["transactions"].values()) == len(list(recording))


@pytest.mark.parametrize("library", ["pyarrow", "polars"])
def test_arrow_streams_are_taken_by_others(library: str) -> None:
    """The rows of the tables, by the Arrow PyCapsule interface; a fresh pass each time."""
    try:
        module = __import__(library)
    except ImportError:
        without(library)
    for table in TABLES:
        rows = getattr(decode(recording_with(table)), table)
        read = module.table if library == "pyarrow" else module.DataFrame
        for _ in range(2):
            found = read(rows)
            names = found.column_names if library == "pyarrow" else found.columns
            assert tuple(names) == rows.columns
            assert found.shape[0] == len(list(rows))


def test_a_missing_file_is_reported_at_once(tmp_path: Path) -> None:
    """A missing file is reported by the call that names it."""
    with pytest.raises(SourceError, match="no such file"):
        decode(tmp_path / "no.hex")


def test_settings_that_cannot_be() -> None:
    """Invalid arguments are reported at once."""
    with pytest.raises(UsageError, match="line settings"):
        decode(b"", line="fast")
    with pytest.raises(UsageError, match="mode 'rtx'"):
        decode(b"", mode="rtx")
    with pytest.raises(UsageError, match="no recording"):
        decode([])
    with pytest.raises(UsageError, match="no port"):
        analyzer.tap(line="19200-8E1")


def test_a_named_format_is_read_as_such(captures: Path) -> None:
    """`read_as` replaces the detection of the format."""
    recording = decode(captures / "seed_ascii" / "recording.bin", read_as="raw")
    assert next(iter(recording.frames)).mode == "ascii"


def test_the_import_is_cheap() -> None:
    """No screen, port, capture or table library comes with `import analyzer`."""
    code = f"import sys, analyzer; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, check=True, timeout=60
    )
    assert done.stdout.decode().strip() == "[]"
