"""Bytes beside meaning."""

from __future__ import annotations

import io

import pytest

from analyzer.views.detail import show_findings, show_frame
from analyzer.views.screen import Screen
from dissectors.describe import Piece, describe


def shown(pieces: list[Piece], monkeypatch: pytest.MonkeyPatch, width: int = 80) -> list[str]:
    """The lines of one frame."""
    monkeypatch.setenv("COLUMNS", str(width))
    stream = io.StringIO()
    show_frame("frame 1", pieces, Screen(stream))
    return stream.getvalue().splitlines()


def test_each_piece_has_its_bytes_and_its_meaning(monkeypatch: pytest.MonkeyPatch) -> None:
    """The title, the heads, then the blocks in wire order."""
    pieces = describe(bytes.fromhex("1103006B00037687"), mode="rtu", direction="request")
    lines = shown(pieces, monkeypatch)
    assert lines[0] == "frame 1"
    assert lines[1].split() == ["offset", "bytes", "field", "value", "meaning"]
    assert lines[4].split()[:5] == ["2", "00", "6b", "address", "107"]
    assert "400108" in lines[4]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_nothing_is_cut(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Long runs of bytes and long meanings take several lines."""
    data = bytes(range(256))
    pieces = [Piece(0, data, "noise", data.hex(" "), "why " * 40, "frame", is_valid=False)]
    lines = shown(pieces, monkeypatch, width)
    assert max(map(len, lines)) <= max(width, 80)
    text = " ".join(line[8:31] for line in lines[2:])
    assert "".join(text.split()) == data.hex()
    assert sum(line.count("why") for line in lines) == 40


def test_hostile_text_is_spelled_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """An object of a device's identification may hold anything."""
    lines = shown([Piece(0, b"\x1b", "value", "\x1b[2J", "a\x1bb")], monkeypatch)
    assert r"\x1b[2J" in lines[2]
    assert "\x1b" not in "".join(lines)


def test_findings_say_what_to_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """Severity and code, what was seen, what to check."""
    monkeypatch.setenv("COLUMNS", "40")
    stream = io.StringIO()
    advice = "Termination at both ends, bias at one place."
    found = {"severity": "error", "code": "bad_checksum", "detail": "found 1", "advice": advice}
    show_findings([found], Screen(stream))
    lines = stream.getvalue().splitlines()
    assert lines[1:3] == ["error: bad_checksum", "  found 1"]
    assert max(map(len, lines)) <= 40
