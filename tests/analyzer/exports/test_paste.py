"""Text to paste: the table as it is shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer.columns import TABLES
from tests.conftest import Modlens, recording_with

FILE = "captures/pymodbus_disturbed/recording.jsonl"


@pytest.mark.parametrize("table", TABLES)
def test_a_text_file_is_the_table_on_the_screen(
    table: str, tmp_path: Path, modlens: Modlens
) -> None:
    """The text file equals the screen's table of the same width."""
    file = str(recording_with(table))
    words = ["decode", file, "--line", "19200-8E1", "--table", table, "--times", "utc"]
    shown = modlens(*words, COLUMNS="100").out
    path = tmp_path / "reply.txt"
    done = modlens(*words, "-o", path)
    assert (done.status, done.out) == (0, "")
    assert path.read_text(encoding="utf-8") == shown


def test_a_markdown_file_is_the_same_between_fences(tmp_path: Path, modlens: Modlens) -> None:
    """The Markdown file is the table between fences, which keeps columns aligned."""
    words = ["export", FILE, "--line", "19200-8E1", "--where", "status != 'ok'"]
    text, reply = tmp_path / "reply.txt", tmp_path / "reply.md"
    assert modlens(*words, "-o", text, "-o", reply).status == 0
    shown = text.read_text(encoding="utf-8")
    assert "no_response" in shown
    assert reply.read_text(encoding="utf-8") == f"```text\n{shown}```\n"


def test_a_table_without_rows_is_sound(tmp_path: Path, modlens: Modlens) -> None:
    """An empty table gives only the fences."""
    reply = tmp_path / "reply.md"
    assert modlens("export", FILE, "--where", "unit == 99", "-o", reply).status == 0
    assert reply.read_text(encoding="utf-8") == "```text\n```\n"


def test_addresses_and_times_are_as_asked(tmp_path: Path, modlens: Modlens) -> None:
    """The options for tables hold for these files as well."""
    reply = tmp_path / "reply.md"
    words = ["--line", "19200-8E1", "--address", "5digit", "--times", "elapsed"]
    assert modlens("export", FILE, *words, "-o", reply).status == 0
    text = reply.read_text(encoding="utf-8")
    assert "40001-" in text
    assert "elapsed" in text.splitlines()[1]
