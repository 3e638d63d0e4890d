"""What is read from recordings in which no frame is valid: swapped wires, inverted or lost bits.

The bytes are made by a receiver's model (`tests/support/uart.py`) that knows nothing of the search.
"""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from analyzer import decode
from analyzer.line import Line, parse_line
from tests.doctor.cases import make
from tests.doctor.examine import diagnose, written
from tests.doctor.frames import read_request, rtu
from tests.doctor.recorded import EPOCH_S
from tests.doctor.wire import Pair
from tests.support.uart import Uart, Wire

EXCHANGES = 40


def sent() -> list[tuple[float, bytes]]:
    """Requests and answers of two units, one after the other, with their times."""
    rng = Random(7)
    all_frames = []
    for number in range(EXCHANGES):
        unit, at = 1 + number % 2, number * 0.2
        answer = bytes([3, 4, *rng.randbytes(4)])
        all_frames += [(at, rtu(unit, read_request(3, 0, 2))), (at + 0.05, rtu(unit, answer))]
    return all_frames


def judged(reads: list[tuple[float, bytes]], line: str, folder: Path) -> dict[str, str]:
    """The sentence of each diagnosis, by its code."""
    lines = [f'{{"t": {EPOCH_S + at:.6f}, "hex": "{data.hex()}"}}\n' for at, data in reads]
    (folder / "tap.jsonl").write_text("".join(lines))
    doctor = decode(folder / "tap.jsonl", line=line, mode="rtu", read_as="chunks").doctor()
    return {row["code"]: row["sentence"] for row in doctor["diagnoses"]}


@pytest.mark.parametrize("settings", ["9600-8N1", "19200-8E1", "9600-8O1"])
def test_swapped_wires_are_proved_by_the_frames_read_back(settings: str, tmp_path: Path) -> None:
    pair = Pair(parse_line(settings), inverted=True)
    for at, frame in sent():
        pair.put(at, frame)
    bursts: list[tuple[float, bytes]] = []
    for at, byte in pair.heard():
        if bursts and at - bursts[-1][0] < 0.02:
            bursts[-1] = (at, bursts[-1][1] + bytes([byte]))
        else:
            bursts.append((at, bytes([byte])))
    said = judged(bursts, settings, tmp_path)
    assert list(said) == ["swapped_wires"]
    assert "64 of 64 bursts become valid frames" in said["swapped_wires"]


@pytest.mark.parametrize("resync", [True, False])
def test_swapped_wires_are_proved_whatever_a_receiver_does_without_a_stop_bit(
    resync: bool, tmp_path: Path
) -> None:
    """It starts the next character at once, or waits until the line is high."""
    line = Line(9600, 8, "N", 1)
    wire = Wire(line, inverted=True)
    for at, frame in sent():
        wire.send(frame, at)
    bursts: list[tuple[float, bytes]] = []
    for one in Uart(line, resync=resync).receive(wire, 0.0):
        if bursts and one.time_s - bursts[-1][0] < 0.02:
            bursts[-1] = (one.time_s, bursts[-1][1] + bytes([one.byte]))
        else:
            bursts.append((one.time_s, bytes([one.byte])))
    said = judged(bursts, "9600-8N1", tmp_path)
    assert list(said) == ["swapped_wires"]
    assert "bursts become valid frames" in said["swapped_wires"]


def test_inverted_bits_are_wrong_settings_and_named(tmp_path: Path) -> None:
    reads = [(at, bytes(byte ^ 0xFF for byte in frame)) for at, frame in sent()]
    said = judged(reads, "9600-8N1", tmp_path)
    assert list(said) == ["wrong_line_settings"]
    assert "all bits are inverted (64 of 64" in said["wrong_line_settings"]


def test_seven_bits_are_wrong_settings_and_named(tmp_path: Path) -> None:
    """Requests alone have bodies below 128, so they tell; they are more than half of the bursts."""
    reads = [(at, bytes(byte & 0x7F for byte in frame)) for at, frame in sent()[::2]]
    said = judged(reads, "9600-8N1", tmp_path)
    assert "7 data bits" in said["wrong_line_settings"]


@pytest.mark.parametrize(("parity", "word"), [("E", "even"), ("O", "odd")])
def test_dropped_characters_tell_the_parity(parity: str, word: str, tmp_path: Path) -> None:
    """By a receiver without parity, which waits for the idle level after an error."""
    wire = Wire(Line(9600, 8, parity, 1))
    for at, frame in sent():
        wire.send(frame, at)
    heard = Uart(Line(9600, 8, "N", 1), resync=False).receive(wire, 0.0)
    reads = [(one.time_s, bytes([one.byte])) for one in heard if not one.error]
    said = judged(reads, "9600-8N1", tmp_path)
    assert f"the line has {word} parity, the receiver none" in said["wrong_line_settings"]


def test_a_preamble_of_another_protocol_is_no_stray_byte(tmp_path: Path) -> None:
    """In this case its telegrams begin with FE FE."""
    case = make("foreign_protocol", 74)
    written(case, tmp_path)
    rows = diagnose(case.main, case.words, tmp_path)
    assert [row["code"] for row in rows] == ["foreign_protocol"]


@pytest.mark.parametrize(("true", "given", "rate"), [(57600, 19200, 57600), (9600, 2400, 9600)])
def test_bytes_that_need_more_time_than_they_took_name_the_rate(
    true: int, given: int, rate: int, tmp_path: Path
) -> None:
    """A line of the one rate, full to nine tenths, is decoded with the settings of the other."""
    rng, at, reads = Random(3), 0.0, []
    while at < 12:
        frames = [rtu(1, read_request(3, 0, 50)), rtu(1, bytes([3, 100, *rng.randbytes(100)]))]
        for frame in frames:
            reads.append((at, frame))
            at += len(frame) * 11 / true / 0.9
    said = judged(reads, f"{given}-8E1", tmp_path)
    assert f"the line is faster than {given}; {rate} fits" in said["wrong_line_settings"]


def test_a_line_at_its_own_rate_is_not_too_fast(tmp_path: Path) -> None:
    at, reads = 0.0, []
    for _ in range(300):
        for frame in (rtu(1, read_request(3, 0, 50)), rtu(1, bytes([3, 100, *bytes(100)]))):
            reads.append((at, frame))
            at += len(frame) * 11 / 19200 / 0.95
    assert "wrong_line_settings" not in judged(reads, "19200-8E1", tmp_path)
