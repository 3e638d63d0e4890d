"""Settings inferred from recordings that were made with other settings on a simulated line."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from analyzer.exports.recorder import RecordedPort, Recorder
from analyzer.line import parse_line
from analyzer.sources.settings_inference import infer_settings, reads, recorded_settings
from tests.conftest import command, environment
from tests.support.settings_search import Chunk, traffic
from tests.support.uart import Uart

NS = 1_000_000_000


def recorded(path: Path, real: str, read_at: str) -> bytes:
    """A raw recording of a polled line; a read a byte."""
    recorder = Recorder(str(path), [RecordedPort("bus", None, "/dev/ttyUSB0", read_at)])
    wire = traffic(parse_line(real), "rtu", seed=9)
    for count, one in enumerate(Uart(parse_line(read_at)).receive(wire, 0.0)):
        places = [0] if one.error else []
        recorder.write_read("bus", None, Chunk(bytes([one.byte]), round(one.time_s * NS), places))
        if count > 1500:
            break
    recorder.close()
    return path.read_bytes()


@pytest.mark.parametrize(
    ("real", "read_at", "words"),
    [
        ("9600-8E1", "9600-8E1", "settings: 9600-8E1 (0 of"),
        ("9600-8O1", "9600-8E1", "settings: 9600-8O1 ("),
        ("19200-8N2", "19200-8E1", "settings: 19200-8N2 ("),
        ("19200-8E1", "19200-8O1", "settings: 19200-8E1 ("),
        ("9600-8E1", "9600-8N1", "pulses fit 9600 baud; other parity"),
        ("9600-8E1", "19200-8E1", "look like 9600"),
        ("19200-8E1", "115200-8E1", "look like 19200"),
    ],
)
def test_the_settings_are_reported(real: str, read_at: str, words: str, tmp_path: Path) -> None:
    """Parity from the marks, the rate from checksums, or from pulses where nothing fits."""
    data = recorded(tmp_path / "r.pcapng", real, read_at)
    assert str(recorded_settings(data)) == read_at
    said = list(infer_settings(list(reads(data)), recorded_settings(data)))
    assert any(words in line for line in said), said
    assert ("no checksum matches" in said[0]) == ("pulses" in words or "look like" in words)


def test_decode_says_it(tmp_path: Path) -> None:
    """With --detect, on standard error, from the file alone; text has no line errors to judge."""
    raw, text = tmp_path / "r.pcapng", tmp_path / "r.hex"
    recorded(raw, "9600-8O1", "9600-8E1")
    text.write_text("010300000001840a\n0103020007f986\n")
    words = command("decode", "--detect", raw, text, "--to", "csv")
    done = subprocess.run(words, capture_output=True, check=True, text=True, env=environment())
    assert "settings: 9600-8O1 (" in done.stderr
    assert "carries no line errors" in done.stderr
    assert done.stdout.startswith("txn,")


def test_bytes_without_marks_and_few_bytes() -> None:
    """A file of bytes reports neither rate nor parity, whatever --line says; few bytes nothing."""
    pair = bytes.fromhex("010300000001840a0103020007f986")
    for given in (None, parse_line("19200-8E1")):
        (said,) = infer_settings(list(reads(pair * 20)), given)
        assert "rtu: " in said
        assert "bytes alone do not tell which they were" in said
        assert "19200" not in said
    (few,) = infer_settings(list(reads(pair)), None)
    assert "too few" in few
