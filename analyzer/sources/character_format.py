"""What the characters of a line look like, once its rate is known: data bits, parity, stop bits.

Three shapes are listened with while the rate is searched. Eleven bits (8E1): 8O1 and 8N2 come
through it whole, with marks where the driver checks parity. Ten bits (8N1): 7E1, 7O1 and 7N2
come with their parity in bit 7. Nine bits: 7N1. When frames come through, `Shaping` tries the
shapes that could also give these bytes, until one comes without line errors.

>>> trial = Trial(Line(9600, 8, "N", 1))
>>> Shaping(trial, "rtu", marks=False).line
Line(baud=9600, data_bits=8, parity='N', stop_bits=1)
"""

from __future__ import annotations

from dataclasses import dataclass, field

from analyzer.line import Line
from analyzer.sources.serial import Chunk

__all__ = ["SHAPES", "WIDE", "Shaping", "Trial"]

WIDE, NARROW, SEVEN = (8, "E", 1.0), (8, "N", 1.0), (7, "N", 1.0)
SHAPES = (WIDE, NARROW, SEVEN)

EVEN, MARK, NONE, ODD = (8, "E", 1.0), (8, "M", 1.0), (8, "N", 1.0), (8, "O", 1.0)
TRIED = (EVEN, MARK, NONE, ODD)
"""In this order: two stop bits pass as a parity bit that is always 1, and as one stop bit."""

CONFIRM, SETTLE = 20, 40
"""Bytes without an error that are believed; bytes after which a start in the middle is over."""

VAIN = 72
"""Bytes without a frame after which a shape is left, where the driver marks nothing."""

_CLEAN, _FEW, _MOST, _TEXT = 0.03, 0.1, 0.9, 0.9
_NEWEST = 24
_GAP_CHARS = 5
_GAP_NS = 3_000_000
_ALPHABET = frozenset(b":0123456789ABCDEFabcdef\r\n")
_NS_PER_S = 1_000_000_000


@dataclass(slots=True)
class Trial:
    """What was heard with one setting.

    The first burst may have begun in the middle: `settled` and `errors` count what came behind it.
    """

    line: Line
    chunks: list[tuple[int, Chunk]] = field(default_factory=list)
    data: bytearray = field(default_factory=bytearray)
    marked: int = 0
    settled: int = 0
    errors: int = 0
    last_ns: int = 0
    bursts: int = 0
    bursts_to_zero: int = 0

    def add(self, port: int, chunk: Chunk) -> None:
        """A read of that port."""
        gap = round(_GAP_CHARS * _NS_PER_S * self.line.char_bits / self.line.baud) + _GAP_NS
        if self.last_ns and chunk.time_ns - self.last_ns > gap:
            self.bursts += 1
            self.bursts_to_zero += self.data[-1] == 0
        if self.bursts or len(self.data) >= SETTLE:
            self.settled += len(chunk.data)
            self.errors += len(chunk.errors)
        self.last_ns = chunk.time_ns
        self.chunks.append((port, chunk))
        self.data += chunk.data
        self.marked += len(chunk.errors)

    def looks_like_text(self) -> bool:
        """Whether these are characters of ASCII frames, whatever bit 7 is.

        The newest count only: who begins to listen within a burst hears nonsense to its end.
        """
        newest = self.data[-_NEWEST:]
        return sum(byte & 0x7F in _ALPHABET for byte in newest) >= _TEXT * len(newest)


class Shaping:
    """From a trial in which frames came through to the line's settings.

    `line` are the settings once they are known; until then, `trying` says what to listen with and
    `judge` takes what came. `seen` says what spoke for them, in words.
    """

    def __init__(self, trial: Trial, mode: str, *, marks: bool) -> None:
        self.mode = mode
        self.line: Line | None = None
        self.seen = ""
        self._marks = marks
        self._seventh = _seventh(trial) if mode == "ascii" else ""
        self._fallback = trial.line
        shape = _shape(trial.line)
        others = (NONE,) if not marks else TRIED if shape == WIDE else (MARK, NONE)
        self._left = [Line(trial.line.baud, *other) for other in others]
        self.trying = self._left.pop(0)
        if shape == SEVEN or (shape == WIDE and marks and not trial.marked):
            self._settle(trial.line)
        elif not marks and shape == NARROW:
            self._settle(trial.line)
        elif not marks:
            self.seen = "the port does not tell them, so that even and odd parity look alike"

    def judge(self, trial: Trial, *, fits: bool) -> bool:
        """Whether something new follows from what came: settings, or others to try."""
        if not self._marks:
            if not fits and len(trial.data) < VAIN:
                return False
            self._settle(trial.line if fits else self._fallback)
            return True
        if trial.settled < CONFIRM:
            return False
        share = trial.errors / trial.settled
        self.seen += f"{', ' if self.seen else ''}{share:.0%} at {trial.line}"
        if share <= _CLEAN or not self._left:
            self._settle(trial.line)
        else:
            self.trying = self._left.pop(0)
        return True

    def _settle(self, clean: Line) -> None:
        """The settings whose characters come without errors through `clean`."""
        shape = _shape(clean)
        if self._seventh and shape[0] == WIDE[0]:
            stop = 1 if shape == NARROW and self._seventh != "N" else 2
            self.line = Line(clean.baud, 7, self._seventh, stop)
        elif shape == MARK:
            self.line = Line(clean.baud, 8, "N", 2)
        else:
            self.line = clean


def _shape(line: Line) -> tuple[int, str, float]:
    return (line.data_bits, line.parity, float(line.stop_bits))


def _seventh(trial: Trial) -> str:
    """What bit 7 of characters of seven bits was: parity, a stop bit; "" for a data bit."""
    sound = trial.data[-trial.settled :] if trial.settled else trial.data
    text = [byte for byte in sound if byte & 0x7F in _ALPHABET]
    high = sum(byte >> 7 for byte in text) / max(len(text), 1)
    odd = sum(byte.bit_count() & 1 for byte in text)
    if high < _FEW:
        return ""
    if high > _MOST:
        return "N"
    return "O" if 2 * odd > len(text) else "E"
