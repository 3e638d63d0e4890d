"""Finds the settings of a line by listening at it.

The evidence is frames whose checksums fit: nothing else is believed. Which settings are tried next
comes from the bytes that the wrong ones gave. A receiver begins a character with a falling edge, so
the zeros at a byte's low end tell how long the line was low, in bits of the receiver's rate; that
length is a multiple of the line's bit (`likelihood`). At a rate nine times too high every
byte is 00. So a guess or two lead to the rate.

At the right rate the shapes of characters are tried; `analyzer.sources.character_format` has them.

>>> tuner = Tuner()
>>> str(tuner.line)
'115200-8E1'
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import _modlens
from analyzer.line import Line
from analyzer.sources.character_format import SHAPES, WIDE, Shaping, Trial
from analyzer.sources.serial import Chunk

__all__ = ["BAUDS", "MASKS", "Found", "Tuner", "evidence", "likelihood", "listener", "pulses"]

BAUDS: Mapping[int, float] = MappingProxyType(
    {
        9600: 0.28,
        19200: 0.25,
        115200: 0.12,
        38400: 0.09,
        57600: 0.07,
        4800: 0.04,
        2400: 0.03,
        1200: 0.03,
        14400: 0.01,
        28800: 0.01,
        76800: 0.01,
        128000: 0.005,
        187500: 0.005,
        230400: 0.02,
        250000: 0.01,
        460800: 0.01,
        500000: 0.005,
        921600: 0.01,
    }
)
"""The rates that are tried, and how usual each is."""

FIRST = 115200
"""The first guess is a high rate: what is slower shows itself there."""

PROBE, LIMIT = 24, 48
"""Bytes after which a wrong rate is left, and a rate's shape is given up."""

ODDS = 30.0
"""By so much another rate must be more likely before this one is left."""

LONGEST = 9
"""Zeros of a start bit and eight data bits: a longer pulse looks the same."""

_STRANGE, _SAME = 0.1, 0.9
_ZERO_SHARE = 0.25
_REFUSED = 2.0
_PAIRS, _FRAMES, _ASCII_FRAMES = 1, 3, 2
_INVERTED_BURSTS, _INVERTED_SHARE = 6, 0.7
_TEXT_FACTOR = 3
_NS_PER_S = 1_000_000_000
_QUIET_NS = 30_000_000


@dataclass(frozen=True, slots=True)
class Found:
    """Settings that fit: the line, `rtu` or `ascii`, what speaks for them, and the bytes so far."""

    line: Line
    mode: str
    evidence: str
    chunks: tuple[tuple[int, Chunk], ...]


class Tuner:
    """Says what `line` to listen with, takes what comes in, until `found`.

    Whoever owns the port sets it to `line` whenever that has changed, and calls `feed` for every
    read and `advance` when time has passed. `told` hears what was tried, and why it was left.
    `marks` says whether the driver marks line errors; `labels` names the lines of a two-line tap by
    port number.
    """

    def __init__(
        self,
        told: Callable[[str], None] = lambda _: None,
        *,
        marks: bool = True,
        labels: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        self.found: Found | None = None
        self._told = told
        self._marks = marks
        self._labels = labels
        self._evidence = ""
        self._kept: list[tuple[int, Chunk]] = []
        self._pulses: dict[int, list[int]] = {}
        self._tried: set[Line] = set()
        self._limit = LIMIT
        self._shaping: Shaping | None = None
        self._suspected = False
        self._rests: dict[int, tuple[int, int]] = {}
        self._begin(_line(FIRST, WIDE))

    @property
    def line(self) -> Line:
        """The settings to listen with now."""
        return self._trial.line

    def feed(self, port: int, chunk: Chunk) -> None:
        """What came in with these settings."""
        if self.found is not None or not chunk.data:
            return
        self._trial.add(port, chunk)
        for core, mask in self._scores.values():
            data = bytes(byte & mask for byte in chunk.data)
            core.feed(0, data, chunk.time_ns, line=self._labels.get(port))
        self._decide()

    def advance(self, now_ns: int) -> None:
        """Nothing came until now: what the silence ends is judged."""
        if self.found is None and self._trial.data and now_ns - self._trial.last_ns > _QUIET_NS:
            for core, _ in self._scores.values():
                core.poll(now_ns)
            self._decide()

    def _begin(self, line: Line) -> None:
        self._trial = Trial(line)
        self._scores = {mode: (listener(mode, line), mask) for mode, mask in MASKS.items()}

    def _decide(self) -> None:
        trial = self._trial
        mode, evidence = self._best()
        if self._shaping is not None:
            self._shape(self._shaping, evidence)
        elif evidence:
            self._shaping = Shaping(trial, mode, marks=self._marks)
            self._evidence = f"{evidence} in {len(trial.data)} bytes"
            self._kept = list(trial.chunks)
            self._follow(self._shaping)
        elif len(trial.data) >= PROBE:
            self._go_on(trial)

    def _best(self) -> tuple[str, str]:
        """The framing that something speaks for, and what."""
        for mode, (core, _) in self._scores.items():
            proof = evidence(mode, core)
            if proof:
                return mode, proof
        return "", ""

    def _go_on(self, trial: Trial) -> None:
        """Leave for a rate that is likelier, or when enough was heard in vain."""
        baud = trial.line.baud
        self._pulses[baud] = pulses(bytes(trial.data))
        odds = self._odds()
        left = [
            rate for rate in odds if any(_line(rate, shape) not in self._tried for shape in SHAPES)
        ]
        best = max(left, key=lambda rate: odds[rate])
        limit = self._limit * (_TEXT_FACTOR if trial.looks_like_text() else 1)
        if odds[best] - odds[baud] > math.log(ODDS):
            self._leave(f"looks like {best} baud")
        elif len(trial.data) >= limit:
            self._tried.add(trial.line)
            self._suspect()
            self._leave("no checksum fits")

    def _odds(self) -> dict[int, float]:
        """The logarithm of each rate's odds: how usual, what pulses say, what was in vain."""
        odds = {}
        for baud, prior in BAUDS.items():
            vain = sum(_line(baud, shape) in self._tried for shape in SHAPES)
            odds[baud] = math.log(prior) - _REFUSED * vain
            for rate, counts in self._pulses.items():
                odds[baud] += likelihood(counts, rate / baud)
        return odds

    def _leave(self, why: str) -> None:
        trial = self._trial
        zeros = trial.data.count(0) / len(trial.data)
        marked = f", {trial.marked} with line errors" if trial.marked else ""
        self._told(f"{trial.line}: {len(trial.data)} bytes, {zeros:.0%} are 00{marked}: {why}")
        self._begin(self._next())

    def _next(self) -> Line:
        """The likeliest rate that has a shape left to try; from the start again after all."""
        odds = self._odds()
        for baud in sorted(odds, key=lambda rate: -odds[rate]):
            for shape in SHAPES:
                if _line(baud, shape) not in self._tried:
                    return _line(baud, shape)
        self._tried.clear()
        self._pulses.clear()
        self._limit *= 4
        self._told("no settings fit so far; trying all again, each for longer")
        return _line(FIRST, WIDE)

    def _suspect(self) -> None:
        """A line whose wires are swapped rests at the level of a start bit: bursts end in 00."""
        trial = self._trial
        before, zero_before = self._rests.get(trial.line.baud, (0, 0))
        bursts, to_zero = before + trial.bursts, zero_before + trial.bursts_to_zero
        self._rests[trial.line.baud] = (bursts, to_zero)
        at_rest = to_zero >= _INVERTED_SHARE * max(bursts, _INVERTED_BURSTS)
        mixed = trial.data.count(0) < len(trial.data) / 2
        if at_rest and mixed and not self._suspected:
            self._suspected = True
            self._told(
                f"every burst at {trial.line.baud} baud ends in a 00 that is none: A and B (D- and"
                " D+) may be swapped; the other wiring is worth a try"
            )

    def _shape(self, shaping: Shaping, evidence: str) -> None:
        """The rate is sure; which characters it has is being tried."""
        self._kept += self._trial.chunks[-1:]
        if shaping.judge(self._trial, fits=bool(evidence)):
            self._follow(shaping)

    def _follow(self, shaping: Shaping) -> None:
        if shaping.line is None:
            self._begin(shaping.trying)
            return
        text = f"{shaping.line}, {shaping.mode}: {self._evidence}"
        if shaping.seen:
            text += f"; line errors: {shaping.seen}"
        self.found = Found(shaping.line, shaping.mode, text, tuple(self._kept))


MASKS: Mapping[str, int] = MappingProxyType({"rtu": 0xFF, "ascii": 0x7F})
"""Framing -> the bits of a character that count."""


_LENGTHS = bytes((byte & -byte).bit_length() if byte else LONGEST for byte in range(256))
"""How long the line is low at the start of a character, by what was received, in bits."""


def pulses(data: bytes) -> list[int]:
    """How often the line was low for how many bits at the start of a character.

    The last count is of `LONGEST` bits and any longer.

    >>> pulses(bytes([0xFF, 0xFE, 0xFE, 0x80, 0x00]))
    [0, 1, 2, 0, 0, 0, 0, 0, 1, 1]
    """
    lengths = data.translate(_LENGTHS)
    return [lengths.count(length) for length in range(LONGEST + 1)]


def likelihood(counts: Sequence[int], ratio: float) -> float:
    """The logarithm of how well pulses fit a line whose bits are `ratio` bits of the receiver."""
    if ratio < _SAME:
        return sum(counts) * math.log(1 / LONGEST)
    chances = [_STRANGE / LONGEST] * (LONGEST + 1)
    for bits in range(1, LONGEST + 1):
        share = (1 - _ZERO_SHARE) / 2**bits if bits < LONGEST else _ZERO_SHARE
        chances[min(math.floor(bits * ratio + 0.5), LONGEST)] += (1 - _STRANGE) * share
    return sum(count * math.log(chance) for count, chance in zip(counts, chances, strict=True))


def _line(baud: int, shape: tuple[int, str, float]) -> Line:
    return Line(baud, *shape)


def listener(mode: str, line: Line) -> _modlens.Session:
    """A core with one bus, that looks for frames of this framing."""
    core = _modlens.Session(_modlens.Functions(), live=True, tables=())
    core.add_bus("tuning", source="tuning", mode=mode, line=line.settings, clock="utc")
    return core


def evidence(mode: str, core: _modlens.Session) -> str:
    """What speaks for these settings, in words; nothing if not enough."""
    stats = json.loads(core.stats())
    frames = stats["buses"][0]["frames"]["ok"]
    answered = sum(stats["transactions"].get(status, 0) for status in ("ok", "exception"))
    tentative = stats["findings"].get("tentative", 0)
    enough = frames >= _ASCII_FRAMES if mode == "ascii" else answered >= _PAIRS
    if not enough and frames - tentative < _FRAMES:
        return ""
    return f"{frames} frames with a right checksum, {answered} requests answered"
