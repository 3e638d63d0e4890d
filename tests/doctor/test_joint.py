"""One explanation for all failures: which of two causes that claim the same damage stays."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

from analyzer import decode
from tests.doctor.frames import read_request, rtu

CHARACTER_NS = 572_917  # of 11 bits at 19200 baud
EXCHANGES = 120


class Tape:
    """Frames and the times at which they begin, as a recording in lines of JSON."""

    def __init__(self) -> None:
        self.now, self.lines = 1_700_000_000_000_000_000, list[str]()

    def add(self, frame: bytes, pause_ms: float) -> None:
        """Append a frame after a pause."""
        self.now += int(pause_ms * 1e6)
        end = self.now + len(frame) * CHARACTER_NS
        self.lines.append(f'{{"t": {end / 1e9:.6f}, "hex": "{frame.hex()}"}}\n')
        self.now = end

    def doctor(self, folder: Path) -> dict[str, Any]:
        """The report of the doctor on it."""
        path = folder / "tape.jsonl"
        path.write_text("".join(self.lines), "utf-8")
        return decode(path, line="19200-8E1").doctor()

    def codes(self, folder: Path) -> list[str]:
        """What the doctor reports for it."""
        return [row["code"] for row in self.doctor(folder)["diagnoses"]]


def exchange(tape: Tape, unit: int, damage: bytes | None, number: int) -> None:
    tape.add(rtu(unit, read_request(3, 0, 4)), 40)
    answer = rtu(unit, bytes([3, 8, 0, number % 256, 1, 44, 0, 20, 83, 240]))
    tape.add(answer if damage is None else damage + answer[5:], 8)


def test_answers_that_begin_alike_and_wrong_are_a_late_driver(tmp_path: Path) -> None:
    """Its receivers fall into step some bytes later: not only the first one or two are wrong."""
    tape, rng = Tape(), Random(7)
    for number in range(EXCHANGES):
        unit = number % 3 + 1
        is_late = unit == 2 and rng.random() < 0.7
        exchange(tape, unit, b"\x36\x08\x0c" if is_late else None, number)
    found = tape.codes(tmp_path)
    assert found[:1] == ["driver_enable"]
    assert "duplicate_address" not in found


def test_answers_that_begin_differently_are_not(tmp_path: Path) -> None:
    """The near miss: as many damaged answers of the same unit."""
    tape, rng = Tape(), Random(7)
    for number in range(EXCHANGES):
        unit = number % 3 + 1
        is_hit = unit == 2 and rng.random() < 0.7
        exchange(tape, unit, rng.randbytes(3) if is_hit else None, number)
    assert "driver_enable" not in tape.codes(tmp_path)


def test_requests_that_do_not_wait_for_a_timeout_are_of_a_second_master(tmp_path: Path) -> None:
    """One master that gets no answer waits; here the next request comes 5 ms later."""
    tape, rng = Tape(), Random(7)
    for number in range(EXCHANGES):
        if number % 15 == 7:
            tape.add(rtu(1, read_request(3, 0, 4)), 40)
            tape.add(rtu(3, read_request(3, 8, 2)), 1)
            tape.add(rng.randbytes(9), 2)
            tape.now += 300_000_000
        else:
            exchange(tape, number % 3 + 1, None, number)
    assert tape.codes(tmp_path)[:1] == ["two_masters"]


def test_swapped_checksums_of_one_unit_are_no_healthy_line(tmp_path: Path) -> None:
    """From some answers on the engine reads them as they are meant; few of 600 requests fail."""
    tape = Tape()
    for number in range(600):
        unit = number % 3 + 1
        tape.add(rtu(unit, read_request(3, 0, 2)), 40)
        answer = rtu(unit, bytes([3, 4, 0, number % 256, 1, 44]))
        swapped = answer[:-2] + answer[:-3:-1]
        tape.add(swapped if unit == 2 else answer, 8)
    assert tape.codes(tmp_path) == ["wrong_layout"]
