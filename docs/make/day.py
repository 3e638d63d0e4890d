"""A day on a small plant's line, for the notebook: an inverter, a meter and a room sensor.

`python -m docs.make.day day.jsonl` writes the recording. The three are asked once a minute. While
a large motor runs, from 13 to 15 hours, bits are flipped in what the far end of the line sends; at
night the meter is without power for a quarter of an hour.
"""

from __future__ import annotations

import json
import math
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random

from analyzer.line import Line
from tests.doctor.line_model import Answer, Exchange, Habits, Master, Trouble
from tests.doctor.plant import Plant, Poll, Unit
from tests.doctor.wire import Pair

__all__ = ["write"]

MIDNIGHT_S = 1_782_252_000.0
"""24 June 2026, 00:00 in Central Europe."""

HOUR_S, MINUTES = 3600.0, 24 * 60
MOTOR_H, AWAY_H = (13.0, 15.0), (3.15, 3.4)
INVERTER, METER, SENSOR = 1, 2, 3


def sun_w(time_s: float) -> float:
    """The power of a roof on a day with some clouds."""
    height = math.sin(math.pi * (time_s / HOUR_S - 5.5) / 15)
    clouds = 0.8 + 0.2 * math.sin(time_s / 700) * math.sin(time_s / 1900)
    return float(6200 * max(height, 0) ** 1.3 * clouds)


def house_w(time_s: float) -> float:
    """What a house takes: more in the morning and in the evening."""
    hour = time_s / HOUR_S
    peaks = 900 * math.exp(-((hour - 7.5) ** 2)) + 1800 * math.exp(-((hour - 19.5) ** 2) / 3)
    return 350 + peaks + 60 * math.sin(time_s / 400)


def energy_wh(time_s: float) -> float:
    """What the roof has given since midnight."""
    return sum(sun_w(minute * 60.0) for minute in range(int(time_s // 60))) / 60


def words_of(value: Callable[[float], float], place: int) -> Callable[[float], int]:
    """One of the two registers of a float32, the high one first."""
    return lambda time_s: int(struct.unpack(">HH", struct.pack(">f", value(time_s)))[place])


def plant() -> Plant:
    """The units, their registers and the poll list."""
    inverter: dict[int, Callable[[float], int]] = {
        0: lambda time_s: round(sun_w(time_s)),
        1: lambda time_s: round(energy_wh(time_s) / 100),
        2: lambda time_s: round(10 * (22 + sun_w(time_s) / 180)),
        3: lambda time_s: int(sun_w(time_s) > 0),
    }
    grid = {place: words_of(lambda t: house_w(t) - sun_w(t), place) for place in (0, 1)}
    sensor: dict[int, Callable[[float], int]] = {
        0: lambda time_s: round(100 * (21 + 2.5 * math.sin((time_s / HOUR_S - 9) / 24 * math.tau))),
        1: lambda time_s: round(10 * (48 - 6 * math.sin((time_s / HOUR_S - 8) / 24 * math.tau))),
    }
    units = [
        Unit(INVERTER, {3: inverter}, delay_s=0.045, spread=0.3),
        Unit(METER, {4: grid}, delay_s=0.012),
        Unit(SENSOR, {4: sensor}, delay_s=0.006),
    ]
    polls = [Poll(INVERTER, 3, 0, 4), Poll(METER, 4, 0, 2), Poll(SENSOR, 4, 0, 2)]
    return Plant(units, polls)


class Day(Trouble):
    """The motor, and the meter's fuse."""

    def __init__(self, rng: Random) -> None:
        """Chance flips the bits."""
        self._rng = rng

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """What is left of the answers."""
        hour = exchange.start_s / HOUR_S
        if exchange.unit == METER and AWAY_H[0] <= hour < AWAY_H[1]:
            return []
        motor = MOTOR_H[0] <= hour < MOTOR_H[1]
        if exchange.unit == SENSOR and motor and self._rng.random() < 0.2:  # noqa: PLR2004
            for answer in answers:
                data = bytearray(answer.data)
                data[self._rng.randrange(len(data))] ^= 1 << self._rng.randrange(8)
                answer.data, answer.right = bytes(data), False
        return answers


def write(path: Path) -> None:
    """Write the recording: a line for each burst, as a reader that is never late sees it."""
    rng = Random(23)
    pair = Pair(Line(9600, 8, "N", 1))
    habits = Habits(timeout_s=0.5, pauses_s=(0.05,), period_s=60.0)
    Master(pair, plant(), habits, rng, Day(rng)).run(3 * MINUTES)
    lines: list[tuple[float, bytearray]] = []
    last_s = -1.0
    for time_s, byte, *_ in pair.heard():
        if time_s - last_s > 0.004:  # noqa: PLR2004 - four characters
            lines.append((time_s, bytearray()))
        lines[-1][1].append(byte)
        last_s = time_s
    text = "".join(
        json.dumps({"t": round(MIDNIGHT_S + time_s, 6), "hex": data.hex()}) + "\n"
        for time_s, data in lines
    )
    path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
