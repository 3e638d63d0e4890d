"""A limit gives no counts of all rows; a filter is of the table that the outputs name."""

from __future__ import annotations

from pathlib import Path

from tests.conftest import Modlens

READ = "01 03 00 00 00 01 84 0A\n01 03 02 00 2A 39 9B\n"
"""Unit 1, holding register 0 is 42."""


def test_a_limit_leaves_the_counts_out(modlens: Modlens, tmp_path: Path) -> None:
    """Counts of what was read until then would be taken for those of the recording."""
    log = tmp_path / "bus.hex"
    log.write_text(READ * 3)
    said = modlens("decode", log, "--limit", 1).err
    assert "--limit: reading stopped there" in said
    assert "transaction" not in said
    assert "3 transactions: ok 3" in modlens("decode", log).err


def test_a_filter_is_of_the_table_that_the_outputs_name(modlens: Modlens, tmp_path: Path) -> None:
    log, out = tmp_path / "bus.hex", tmp_path / "flow.csv"
    log.write_text(READ)
    done = modlens("export", log, "--where", "value == 42", "-o", f"readings:{out}")
    assert done.status == 0, done.err
    assert len(out.read_text().splitlines()) == 2
