"""Traffic of a device that a profile describes, with values that chance moves, for `modlens match`.

Values have the sizes of their units, and powers are voltage times current of their phase. The
same requests can be answered by a device of the other family: floats where the profile has
integers, and integers where it has floats.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import _modlens
from dissectors.profile import Profile

__all__ = ["frame", "recording"]

READ = {"co": 1, "di": 2, "hr": 3, "ir": 4}
WIDTHS = {"u32": 2, "s32": 2, "f32": 2, "bcd32": 2, "u64": 4, "s64": 4, "f64": 4}
WIDEST_HOLE = 6
MOST_REGISTERS = 60

Words = dict[tuple[str, int], int]


def recording(
    profile: Profile,
    seed: int,
    *,
    polls: int = 40,
    other_family: bool = False,
    one_by_one: bool = False,
) -> str:
    """The recording as hex lines: requests and responses of unit 1.

    Chance makes the blocks that are asked for; one by one, each point is.
    """
    rng = random.Random(seed)
    points = [point for point in profile.points if point["at"][:2] in ("hr", "ir")]
    blocks = sorted(set(map(_place, points))) if one_by_one else _blocks(points, rng)
    device = _other_device(points, blocks, rng) if other_family else _device(points, rng)
    lines = []
    for _ in range(polls):
        words = next(device)
        for space, first, count in blocks:
            lines.append(frame(bytes([1, READ[space]]) + struct.pack(">HH", first, count)))
            data = b"".join(
                words.get((space, at), 0).to_bytes(2, "big") for at in range(first, first + count)
            )
            lines.append(frame(bytes([1, READ[space], len(data)]) + data))
    return "\n".join(lines) + "\n"


def frame(body: bytes) -> str:
    """A frame in hex, with its checksum."""
    return (body + _modlens.crc16(body).to_bytes(2, "little")).hex(" ")


def _place(point: Mapping[str, Any]) -> tuple[str, int, int]:
    space, _, place = point["at"].partition(":")
    width = point.get("count") or WIDTHS.get(point.get("type", "u16"), 1)
    return space, int(place.partition(".")[0]), width


def _blocks(points: list[Any], rng: random.Random) -> list[tuple[str, int, int]]:
    """What a master asks for: runs of points, with holes or without."""
    hole = rng.choice([0, 0, WIDEST_HOLE])
    blocks: list[tuple[str, int, int]] = []
    for space, first, width in sorted(map(_place, points)):
        if blocks:
            last_space, begin, count = blocks[-1]
            end = max(begin + count, first + width)
            if (
                space == last_space
                and first - (begin + count) <= hole
                and end - begin <= MOST_REGISTERS
            ):
                blocks[-1] = (space, begin, end - begin)
                continue
        blocks.append((space, first, width))
    kept = [block for block in blocks if rng.random() < 0.8]
    return kept or blocks


def _phase(name: str) -> str:
    words = name.lower().split("_")
    return next((word for word in words if word[-1:] in "123abc" and len(word) <= 3), "")


def _device(points: list[Any], rng: random.Random) -> Iterator[Words]:
    """The registers of a device that the profile describes, poll after poll."""
    start = {point["name"]: rng.random() for point in points}
    idle = {point["name"] for point in points if rng.random() < 0.1}
    load, energy = rng.uniform(0.5, 10), 0.0
    while True:
        load = min(20.0, max(0.3, load + rng.gauss(0, 0.4)))
        energy += load / 20
        volts = {phase: 230 + rng.gauss(0, 1.5) for phase in ("", "1", "2", "3")}
        words: Words = {}
        for point in points:
            value = _value(point, start[point["name"]], energy, load, volts)
            if point["name"] in idle and point.get("unit") not in ("V", "A", "W", "Hz"):
                value = 0.0
            words.update(_words(point, value, rng))
        yield words


def _value(
    point: Mapping[str, Any], start: float, energy: float, load: float, volts: Mapping[str, float]
) -> float:
    """A value of the size of its unit."""
    phase = _phase(point["name"])[-1:]
    phase = {"a": "1", "b": "2", "c": "3"}.get(phase, phase)
    voltage = volts.get(phase, volts[""])
    amperes = load * (0.8 + 0.1 * "123".find(phase))
    power = 230 * load * 2.7 if not phase else 0.95 * voltage * amperes
    total = 10 ** (1 + 4 * start)
    wave = math.sin(energy + 6 * start)
    by_unit = {
        "V": voltage, "A": amperes, "W": power, "VA": power / 0.95, "var": power * 0.3,
        "kW": power / 1000, "kVA": power / 950, "kvar": power / 3000, "Hz": 50 + 0.03 * wave,
        "Wh": 1000 * total + 100 * energy, "kWh": total + energy / 10,
        "kvarh": total + energy / 20, "Ah": total / 50 + energy, "%": 50 + 40 * wave,
        "degC": 30 + 10 * wave, "deg": 180 + 120 * wave, "1/min": 1400 + 20 * wave,
    }  # fmt: skip
    if "enum" in point:
        labels = sorted(map(int, point["enum"]))
        return float(labels[int(start * len(labels)) % len(labels)])
    return by_unit.get(point.get("unit", ""), float(int(1000 * start) + int(energy) % 2))


def _words(point: Mapping[str, Any], value: float, rng: random.Random) -> Words:
    """The registers of a value."""
    space, first, width = _place(point)
    kind = point.get("type", "u16")
    scaled = (
        (value - point.get("offset", 0)) / point.get("scale", 1) if "enum" not in point else value
    )
    if kind in ("f32", "f64"):
        data = struct.pack(">f" if kind == "f32" else ">d", scaled)
    elif kind in ("str", "strh", "strl", "raw"):
        data = b"AB12".ljust(2 * width, b"\0")[: 2 * width]
    else:
        bits = 16 * (WIDTHS.get(kind, 1))
        most = (1 << (bits - (kind[0] == "s"))) - 1
        data = (min(most, round(abs(scaled))) & ((1 << bits) - 1)).to_bytes(bits // 8, "big")
    words = [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
    if point.get("order") in ("CDAB", "DCBA"):
        words.reverse()
    return {(space, first + at): word for at, word in enumerate(words)}


def _other_device(
    points: list[Any], blocks: list[tuple[str, int, int]], rng: random.Random
) -> Iterator[Words]:
    """The registers of a device of the other family: integers for floats, floats for integers."""
    floats = sum(point.get("type") == "f32" for point in points)
    has_floats = floats * 2 < len(points)
    order = rng.choice([1, -1])
    sizes = {}
    for space, first, count in blocks:
        for at in range(first, first + count):
            sizes[space, at] = rng.choice([0, 10, 230, 500, 2300, 5000, 20_000])
    poll = 0
    while True:
        poll += 1
        words: Words = {}
        for (space, at), size in sizes.items():
            words.setdefault((space, at), 0)
            drift = 1 + 0.02 * math.sin(poll / 5 + at) + 0.003 * rng.random()
            if not has_floats:
                words[space, at] = int(size * drift)
        for space, first, count in blocks if has_floats else ():
            for at in range(first, first + count - 1, 2):
                drift = 1 + 0.02 * math.sin(poll / 5 + at) + 0.003 * rng.random()
                data = struct.pack(">f", (sizes[space, at] or 0.7) / 10 * drift)
                for place, word in enumerate(struct.unpack(">HH", data)[::order]):
                    words[space, at + place] = word
        yield words
