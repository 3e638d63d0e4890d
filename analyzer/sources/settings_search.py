"""Finds the settings of a line by listening.

The only evidence that counts is frames with valid checksums. Which settings are tried next follows
from the bytes that wrong settings gave. A receiver starts a character at a falling edge, so the
zeros at the low end of a byte tell how long the line was low, in bits of the receiver's rate. That
length is a multiple of the line's bit time (`log_likelihood`). At a rate nine times too high every
byte is 00. So one or two steps lead to the right rate.

At the right rate the character formats are tried; see `analyzer.sources.character_format`.

>>> tuner = SettingsSearch()
>>> str(tuner.line)
'115200-8E1'
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from types import MappingProxyType

import _modlens
from analyzer.line import Line
from analyzer.sources.character_format import (
    CHARACTER_FORMATS,
    ELEVEN_BITS,
    CharacterFormatSearch,
    Trial,
)
from analyzer.sources.serial import Chunk

__all__ = [
    "BAUDS",
    "CHARACTER_MASKS",
    "FoundSettings",
    "SettingsSearch",
    "evidence",
    "listener",
    "log_likelihood",
    "pulse_lengths",
]

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
"""The baud rates that are tried -> their prior probability."""

FIRST_BAUD = 115200
"""The first rate is a high one: a slower line shows its bit time in the bytes received at it."""

MIN_BYTES, MAX_BYTES = 24, 48
"""Bytes after which a wrong rate may be left; bytes after which a character format is given up."""

MIN_ODDS = 30.0
"""Another rate must be more likely by this factor before the present one is left."""

MAX_PULSE_BITS = 9
"""Longest low pulse that can be told apart: a start bit and eight data bits of zero."""

_OUTLIER_SHARE, _MIN_RATIO = 0.1, 0.9
_ZERO_SHARE = 0.25
_FAILED_TRIAL_COST = 2.0
_MIN_ANSWERED, _MIN_FRAMES, _MIN_ASCII_FRAMES = 1, 3, 2
_INVERTED_BURSTS, _INVERTED_SHARE = 6, 0.7
_TEXT_FACTOR = 3
_MIN_TO_JUDGE = 200
_MAX_KEPT_BYTES = 1 << 20
_NS_PER_S = 1_000_000_000
_IDLE_NS = 30_000_000


@dataclass(frozen=True, slots=True)
class FoundSettings:
    """The settings found, `rtu` or `ascii`, the evidence, and the reads made with them."""

    line: Line
    mode: str
    evidence: str
    chunks: tuple[tuple[int, Chunk], ...]


class SettingsSearch:
    """Searches the settings of a line; `found` is set when they are known.

    The owner of the port sets it to `line` whenever that has changed, and calls `feed` for every
    read and `advance` when time has passed. `notify` gets messages on what was tried and why it was
    given up. `marks_errors` says whether the driver marks line errors; `labels` names the lines of
    a two-line tap by port number.
    """

    def __init__(
        self,
        notify: Callable[[str], None] = lambda _: None,
        *,
        marks_errors: bool = True,
        labels: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        self.found: FoundSettings | None = None
        self._notify = notify
        self._marks_errors = marks_errors
        self._labels = labels
        self._evidence = ""
        self._chunks: list[tuple[int, Chunk]] = []
        self._pulse_lengths: dict[int, list[int]] = {}
        self._tried: set[Line] = set()
        self._limit = MAX_BYTES
        self._format_search: CharacterFormatSearch | None = None
        self._reported_swap = False
        self._burst_ends: dict[int, tuple[int, int]] = {}
        self._heard: deque[tuple[Line, int, Chunk]] = deque()
        self._heard_bytes = self._kept_bytes = 0
        self._begin(_line(FIRST_BAUD, ELEVEN_BITS))

    @property
    def line(self) -> Line:
        """The settings to listen with now."""
        return self._trial.line

    def feed(self, port: int, chunk: Chunk) -> None:
        """Evaluate a read made with the present settings."""
        if self.found is not None or not chunk.data:
            return
        self._keep(port, chunk)
        self._trial.add(port, chunk)
        for core, mask in self._listeners.values():
            data = bytes(byte & mask for byte in chunk.data)
            core.feed(0, data, chunk.time_ns, line=self._labels.get(port))
        self._decide()

    def heard(self) -> Iterator[tuple[Line, list[tuple[int, Chunk]]]]:
        """All reads so far, or the newest where they are too many, by the settings of the time."""
        for line, reads in groupby(self._heard, key=lambda read: read[0]):
            yield line, [(port, chunk) for _, port, chunk in reads]

    def diagnosis(self) -> str:
        """What can be said when the search ends without a result."""
        if not self._heard_bytes:
            return "nothing was received: check the wires (A, B, ground), and that a master polls"
        bursts = sum(count for count, _ in self._burst_ends.values())
        to_zero = sum(count for _, count in self._burst_ends.values())
        swapped = bursts >= _INVERTED_BURSTS and to_zero >= _INVERTED_SHARE * bursts
        text = f"no line settings fit the {self._heard_bytes:,} bytes received"
        if swapped:
            return f"{text}; most bursts end in 00: A and B (D- and D+) may be swapped"
        if self._heard_bytes < _MIN_TO_JUDGE:
            return f"{text}, which are few: listen longer, or give the settings by --line"
        return (
            f"{text}: noise, another protocol, or a rate that was not tried; --line gives settings,"
            " and modlens decode --detect tries them on a recording"
        )

    def _keep(self, port: int, chunk: Chunk) -> None:
        """Keep a read for the end of a search without a result; the oldest beyond a bound go."""
        self._heard.append((self.line, port, chunk))
        self._heard_bytes += len(chunk.data)
        self._kept_bytes += len(chunk.data)
        while self._kept_bytes > _MAX_KEPT_BYTES:
            self._kept_bytes -= len(self._heard.popleft()[2].data)

    def advance(self, now_ns: int) -> None:
        """Tell the search that nothing was received until now: a silence may complete a frame."""
        if self.found is None and self._trial.data and now_ns - self._trial.last_ns > _IDLE_NS:
            for core, _ in self._listeners.values():
                core.poll(now_ns)
            self._decide()

    def _begin(self, line: Line) -> None:
        self._trial = Trial(line)
        self._listeners = {
            mode: (listener(mode, line), mask) for mode, mask in CHARACTER_MASKS.items()
        }

    def _decide(self) -> None:
        """Evaluate the trial so far: go on with it, change the rate, or the character format."""
        trial = self._trial
        mode, evidence = self._evidence_by_mode()
        if self._format_search is not None:
            self._evaluate_format(self._format_search, evidence)
        elif evidence:
            self._format_search = CharacterFormatSearch(
                trial, mode, marks_errors=self._marks_errors
            )
            self._evidence = f"{evidence} in {len(trial.data)} bytes"
            self._chunks = list(trial.chunks)
            self._follow_format_search(self._format_search)
        elif len(trial.data) >= MIN_BYTES:
            self._change_baud(trial)

    def _evidence_by_mode(self) -> tuple[str, str]:
        """The framing with enough evidence, and the evidence in words.

        Empty where there is none.
        """
        for mode, (core, _) in self._listeners.items():
            proof = evidence(mode, core)
            if proof:
                return mode, proof
        return "", ""

    def _change_baud(self, trial: Trial) -> None:
        """Begin a trial at a rate that is more likely, or after enough bytes without a frame."""
        baud = trial.line.baud
        self._pulse_lengths[baud] = pulse_lengths(bytes(trial.data))
        log_odds = self._log_odds()
        left = [
            rate
            for rate in log_odds
            if any(_line(rate, format_) not in self._tried for format_ in CHARACTER_FORMATS)
        ]
        best = max(left, key=lambda rate: log_odds[rate])
        limit = self._limit * (_TEXT_FACTOR if trial.looks_like_text() else 1)
        if log_odds[best] - log_odds[baud] > math.log(MIN_ODDS):
            self._begin_next_trial(f"looks like {best} baud")
        elif len(trial.data) >= limit:
            self._tried.add(trial.line)
            self._check_swapped_wires()
            self._begin_next_trial("no checksum matches")

    def _log_odds(self) -> dict[int, float]:
        """The log odds of each rate: its prior, the pulse lengths seen, and failed trials."""
        log_odds = {}
        for baud, prior in BAUDS.items():
            failed_trials = sum(
                _line(baud, format_) in self._tried for format_ in CHARACTER_FORMATS
            )
            log_odds[baud] = math.log(prior) - _FAILED_TRIAL_COST * failed_trials
            for rate, counts in self._pulse_lengths.items():
                log_odds[baud] += log_likelihood(counts, rate / baud)
        return log_odds

    def _begin_next_trial(self, why: str) -> None:
        trial = self._trial
        zeros = trial.data.count(0) / len(trial.data)
        marked_bytes = f", {trial.marked_bytes} with line errors" if trial.marked_bytes else ""
        self._notify(
            f"{trial.line}: {len(trial.data)} bytes, {zeros:.0%} are 00{marked_bytes}: {why}"
        )
        self._begin(self._next_line())

    def _next_line(self) -> Line:
        """The next settings to try: the most likely rate with a character format that is left.

        After all have been tried the search starts again and listens four times as long to each.
        """
        log_odds = self._log_odds()
        for baud in sorted(log_odds, key=lambda rate: -log_odds[rate]):
            for format_ in CHARACTER_FORMATS:
                if _line(baud, format_) not in self._tried:
                    return _line(baud, format_)
        self._tried.clear()
        self._pulse_lengths.clear()
        self._limit *= 4
        self._notify("no settings fit so far; trying all of them again for longer")
        return _line(FIRST_BAUD, ELEVEN_BITS)

    def _check_swapped_wires(self) -> None:
        """Report that A and B may be swapped: such a line idles at 0, so that bursts end in 00."""
        trial = self._trial
        before, zero_before = self._burst_ends.get(trial.line.baud, (0, 0))
        bursts, to_zero = before + trial.bursts, zero_before + trial.bursts_ending_in_zero
        self._burst_ends[trial.line.baud] = (bursts, to_zero)
        at_rest = to_zero >= _INVERTED_SHARE * max(bursts, _INVERTED_BURSTS)
        mixed = trial.data.count(0) < len(trial.data) / 2
        if at_rest and mixed and not self._reported_swap:
            self._reported_swap = True
            self._notify(
                f"every burst at {trial.line.baud} baud ends in a spurious 00: A and B (D- and"
                " D+) may be swapped; the other wiring is worth a try"
            )

    def _evaluate_format(self, format_search: CharacterFormatSearch, evidence: str) -> None:
        """Evaluate the trial of a character format; the rate is known."""
        self._chunks += self._trial.chunks[-1:]
        if format_search.evaluate(self._trial, fits=bool(evidence)):
            self._follow_format_search(format_search)

    def _follow_format_search(self, format_search: CharacterFormatSearch) -> None:
        if format_search.line is None:
            self._begin(format_search.candidate)
            return
        text = f"{format_search.line}, {format_search.mode}: {self._evidence}"
        if format_search.error_shares:
            text += f"; line errors: {format_search.error_shares}"
        self.found = FoundSettings(
            format_search.line, format_search.mode, text, tuple(self._chunks)
        )


CHARACTER_MASKS: Mapping[str, int] = MappingProxyType({"rtu": 0xFF, "ascii": 0x7F})
"""Framing -> mask of the bits of a character that are evaluated."""


_PULSE_BITS = bytes((byte & -byte).bit_length() if byte else MAX_PULSE_BITS for byte in range(256))
"""Received byte -> length of the low pulse at the start of the character, in bits."""


def pulse_lengths(data: bytes) -> list[int]:
    """The number of characters that begin with a low pulse of 0, 1, 2 ... bits.

    The last count is that of `MAX_PULSE_BITS` bits and more.

    The last count is of `MAX_PULSE_BITS` bits and any longer.

    >>> pulse_lengths(bytes([0xFF, 0xFE, 0xFE, 0x80, 0x00]))
    [0, 1, 2, 0, 0, 0, 0, 0, 1, 1]
    """
    lengths = data.translate(_PULSE_BITS)
    return [lengths.count(length) for length in range(MAX_PULSE_BITS + 1)]


def log_likelihood(counts: Sequence[int], ratio: float) -> float:
    """The log-likelihood of pulse lengths if a bit of the line takes `ratio` receiver bits."""
    if ratio < _MIN_RATIO:
        return sum(counts) * math.log(1 / MAX_PULSE_BITS)
    chances = [_OUTLIER_SHARE / MAX_PULSE_BITS] * (MAX_PULSE_BITS + 1)
    for bits in range(1, MAX_PULSE_BITS + 1):
        share = (1 - _ZERO_SHARE) / 2**bits if bits < MAX_PULSE_BITS else _ZERO_SHARE
        chances[min(math.floor(bits * ratio + 0.5), MAX_PULSE_BITS)] += (1 - _OUTLIER_SHARE) * share
    return sum(count * math.log(chance) for count, chance in zip(counts, chances, strict=True))


def _line(baud: int, format_: tuple[int, str, float]) -> Line:
    return Line(baud, *format_)


def listener(mode: str, line: Line) -> _modlens.Session:
    """A session of the core with one bus, number 0, of this framing and settings."""
    core = _modlens.Session(_modlens.Functions(), live=True, tables=())
    core.add_bus("tuning", source="tuning", mode=mode, line=line.settings, clock="utc")
    return core


def evidence(mode: str, core: _modlens.Session) -> str:
    """The evidence for the settings of a session in words; empty if there is not enough."""
    stats = json.loads(core.stats())
    frames = stats["buses"][0]["frames"]["ok"]
    answered = sum(stats["transactions"].get(status, 0) for status in ("ok", "exception"))
    unconfirmed = stats["findings"].get("unconfirmed", 0)
    enough = frames >= _MIN_ASCII_FRAMES if mode == "ascii" else answered >= _MIN_ANSWERED
    if not enough and frames - unconfirmed < _MIN_FRAMES:
        return ""
    requests = "request" if answered == 1 else "requests"
    valid = "frame" if frames == 1 else "frames"
    return f"{frames} valid {valid} and {answered} answered {requests}"
