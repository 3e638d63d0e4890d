"""An option that has no effect says so."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer.cli import main
from tests.conftest import CAPTURES

RAW = str(CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
PCAP = str(CAPTURES / "pymodbus_tcp" / "recording.pcap")


@pytest.mark.parametrize(
    ("words", "note"),
    [
        (["decode", RAW, "--context", "5"], "--context is ignored: frames around a match are for"),
        (["decode", RAW, "-o", "a.csv", "--address", "hex"], "--address is ignored"),
        (["decode", RAW, "-o", "a.csv", "--times", "delta"], "--times delta is ignored"),
        (["decode", RAW, "--port", "1502"], "--port is ignored: chunks is no network capture"),
        (["stats", RAW, "--channels", "RX"], "--channels is ignored: chunks is not of a logic"),
        (["doctor", PCAP, "--timezone", "local"], "--timezone is ignored: pcap has no times in"),
        (["report", PCAP, "--date", "2026-11-21", "-o", "a.html"], "--date is ignored"),
    ],
)
def test_an_ignored_option_says_so(
    words: list[str],
    note: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 0
    assert note in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    "words",
    [
        [RAW, "-o", "a.pcapng", "--context", "5", "--where", "exception"],
        [RAW, "--address", "hex", "--times", "delta"],
        [RAW, "-o", "a.md", "--address", "hex"],
        [PCAP, "--port", "502"],
    ],
)
def test_an_option_with_an_effect_does_not(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["decode", *words]) == 0
    assert "is ignored" not in capsys.readouterr().err
