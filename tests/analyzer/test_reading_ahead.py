"""Recordings that are read ahead of their decoding give the same rows, messages and statistics."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer.pool import Pool
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from tests.conftest import CAPTURES, Modlens

TABLES = ("frames", "transactions", "findings", "connections", "diagnoses")


def decoded(path: Path, pool: Pool | None) -> tuple[list[str], list[RecordingStatus], object]:
    """All rows as text, what was reported, and the statistics."""
    heard: list[RecordingStatus] = []
    ahead = None if pool is None else pool.ahead
    run = FileRun([str(path)], Settings(), on_status=heard.append, ahead=ahead)
    rows = [
        repr(row.as_dict())
        for batch in run.batches()
        for table in TABLES
        for row in getattr(batch, table)
    ]
    return rows, heard, run.document()


@pytest.mark.parametrize(
    "path", sorted(CAPTURES.glob("*/recording.*")), ids=lambda it: it.parent.name
)
def test_the_rows_are_the_same(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("analyzer.sources.files.BLOCK_BYTES", 700)
    monkeypatch.setattr("analyzer.sources.files.SAMPLE_BYTES", 1500)
    expected = decoded(path, None)
    for threads in (1, 2):
        with Pool(threads) as pool:
            assert decoded(path, pool) == expected


def test_an_export_that_is_read_back(
    modlens: Modlens, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A capture that modlens wrote holds rows instead of bytes."""
    monkeypatch.setattr("analyzer.sources.files.BLOCK_BYTES", 700)
    for name in ("pymodbus_disturbed/recording.jsonl", "pymodbus_tcp/recording.pcap"):
        path = tmp_path / "back.pcapng"
        done = modlens("export", CAPTURES / name, "-o", f"frames:{path}")
        assert done.status == 0
        expected = decoded(path, None)
        with Pool(2) as pool:
            assert decoded(path, pool) == expected
