"""Register values that live: smooth series, counters, states, floats over two registers.

A signal is the value of a register at a time in seconds. The same signal at the same time gives
the same value, so that two masters who ask for the same register get the same.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from random import Random

__all__ = ["Signal", "constant", "counter", "flag", "float_pair", "fluctuating", "smooth"]

Signal = Callable[[float], int]


def smooth(rng: Random) -> Signal:
    """A measurement: a slow wave with a little unrest, never near 0 or 65535."""
    middle = rng.uniform(800, 30_000)
    swing = middle * rng.uniform(0.01, 0.1)
    period, phase = rng.uniform(20, 900), rng.uniform(0, math.tau)
    unrest = rng.uniform(0, 3)

    def value(time_s: float) -> int:
        wave = swing * math.sin(math.tau * time_s / period + phase)
        return round(middle + wave + unrest * math.sin(97.3 * time_s + phase))

    return value


def counter(rng: Random) -> Signal:
    """A total that only rises, by up to some counts a second; it does not wrap while we look."""
    start, rate = rng.randint(100, 20_000), rng.uniform(0.05, 3.0)
    return lambda time_s: min(65_000, start + int(rate * time_s))


def constant(rng: Random) -> Signal:
    """A setting."""
    value = rng.choice([1, 2, 10, 100, 500, 2026, rng.randint(3, 4000)])
    return lambda _: value


def flag(rng: Random) -> Signal:
    """A state that changes now and then."""
    period, share = rng.uniform(30, 300), rng.uniform(0.1, 0.9)
    return lambda time_s: int(time_s % period < share * period)


def fluctuating(
    middle: float, swing: float, period_s: float, phase: float
) -> Callable[[float], float]:
    """A physical quantity."""
    return lambda time_s: middle + swing * math.sin(math.tau * time_s / period_s + phase)


def float_pair(rng: Random, order: str = "ABCD") -> list[Signal]:
    """A float32 over two registers, high word first (ABCD), low word first (CDAB) and so on."""
    level = rng.choice([50.0, 230.0, 21.5, 5.2, 1500.0]) * rng.uniform(0.9, 1.1)
    quantity = fluctuating(level, level * 0.02, rng.uniform(15, 300), rng.uniform(0, 6))

    def half(place: int) -> Signal:
        def value(time_s: float) -> int:
            packed = struct.pack(">f", quantity(time_s))
            ordered = bytes(packed["ABCD".index(letter)] for letter in order)
            return int.from_bytes(ordered[2 * place : 2 * place + 2], "big")

        return value

    return [half(0), half(1)]


def of_any_kind(rng: Random) -> Signal:
    return rng.choices([smooth, counter, constant, flag], [55, 15, 25, 5])[0](rng)
