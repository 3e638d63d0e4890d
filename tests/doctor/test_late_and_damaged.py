"""Late answers of which none is whole: they meet the next request, or its answer."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random
from typing import Any

import pytest

from analyzer import decode
from tests.doctor.frames import read_answer, read_request, rtu

SEEDS = range(4)
TIMEOUT_S = 0.2
CHARACTER_S = 11 / 19200
"""A start bit, eight data bits, parity and a stop bit."""


class Tap:
    """What a tap has heard, one frame or run of bytes a chunk."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.now_s = 1_790_000_000.0
        self.lines: list[str] = []
        self.slow, self.other = self.rng.sample(range(1, 60), 2)

    def hears(self, data: bytes, pause_s: float) -> None:
        """These bytes after a pause; a chunk has the time of its end."""
        self.now_s += pause_s + len(data) * CHARACTER_S
        self.lines.append(json.dumps({"t": round(self.now_s, 6), "hex": data.hex()}))

    def asks(self, unit: int, pause_s: float = 0.02) -> bytes:
        """Sends a request for ten registers, and returns its answer."""
        self.hears(rtu(unit, read_request(3, 100, 10)), pause_s)
        return rtu(unit, read_answer(3, [self.rng.randrange(0x1122, 0x7744) for _ in range(10)]))

    def wrecked(self, data: bytes, intact: int = 0) -> bytes:
        """The same with what another frame on top of it leaves: fewer bits set."""
        return data[:intact] + bytes(byte & self.rng.randrange(0xFF) for byte in data[intact:])

    def doctor(self, folder: Path) -> dict[str, Any]:
        """Give what the doctor finds in the recording."""
        path = folder / "tap.jsonl"
        path.write_text("\n".join(self.lines) + "\n", encoding="utf-8")
        return decode(path, line="19200-8E1").doctor()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_late_answer_comes_as_that_of_the_next_unit(seed: int, tmp_path: Path) -> None:
    tap = Tap(seed)
    for number in range(150):
        answer, is_late = tap.asks(tap.slow), number % 5 == 2
        if not is_late:
            tap.hears(answer, 0.01)
        other = tap.asks(tap.other, TIMEOUT_S if is_late else 0.02)
        tap.hears(tap.wrecked(answer, intact=7) if is_late else other, 0.01)
        if is_late:
            tap.now_s += TIMEOUT_S
    found = tap.doctor(tmp_path)["diagnoses"]
    assert [(one["code"], one["unit"]) for one in found] == [("slow_answers", tap.slow)]


@pytest.mark.parametrize("seed", SEEDS)
def test_each_late_answer_meets_the_next_request(seed: int, tmp_path: Path) -> None:
    tap = Tap(seed)
    for number in range(150):
        answer, is_late = tap.asks(tap.slow), number % 3 == 1
        wreck = tap.wrecked(answer + answer[3:6], intact=tap.rng.randrange(1, 4))
        tap.hears(wreck if is_late else answer, TIMEOUT_S if is_late else 0.01)
        tap.hears(tap.asks(tap.other, TIMEOUT_S if is_late else 0.02), 0.01)
    found = tap.doctor(tmp_path)["diagnoses"]
    assert [(one["code"], one["unit"]) for one in found] == [("slow_answers", tap.slow)]


@pytest.mark.parametrize("seed", SEEDS)
def test_damage_that_begins_as_soon_as_good_answers_is_not_late(seed: int, tmp_path: Path) -> None:
    tap = Tap(seed)
    for number in range(150):
        answer, is_wrecked = tap.asks(tap.slow), number % 3 == 1
        tap.hears(tap.wrecked(answer + answer[3:6]) if is_wrecked else answer, 0.01)
        tap.hears(tap.asks(tap.other, TIMEOUT_S if is_wrecked else 0.02), 0.01)
    codes = {one["code"] for one in tap.doctor(tmp_path)["diagnoses"]}
    assert "slow_answers" not in codes
    assert "duplicate_address" in codes


@pytest.mark.parametrize("seed", SEEDS)
def test_a_damaged_request_names_no_unit_that_another_one_answers_for(
    seed: int, tmp_path: Path
) -> None:
    tap = Tap(seed)
    for number in range(200):
        for unit in (tap.slow, tap.other):
            answer = tap.asks(unit)
            if number % 40 == unit % 40:
                # The tap hears one bit of the unit wrong, and the unit hears all.
                heard = json.loads(tap.lines.pop())
                first = int(heard["hex"][:2], 16) ^ 0x40
                tap.lines.append(json.dumps({**heard, "hex": f"{first:02x}{heard['hex'][2:]}"}))
            tap.hears(answer, 0.01)
    assert "bystander" not in {one["code"] for one in tap.doctor(tmp_path)["diagnoses"]}
