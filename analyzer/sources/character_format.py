"""What the characters of a line look like, once its rate is known: data bits, parity, stop bits.

Three shapes are listened with while the rate is searched. Eleven bits (8E1): 8O1 and 8N2 come
through it whole, with marks where the driver checks parity. Ten bits (8N1): 7E1, 7O1 and 7N2 come
with their parity in bit 7. Nine bits: 7N1. When frames come through, `CharacterFormatSearch` tries
the shapes that could also give these bytes, until one comes without line errors.

>>> trial = Trial(Line(9600, 8, "N", 1))
>>> CharacterFormatSearch(trial, "rtu", marks_errors=False).line
Line(baud=9600, data_bits=8, parity='N', stop_bits=1)
"""

from __future__ import annotations

from dataclasses import dataclass, field

from analyzer.line import Line
from analyzer.sources.serial import Chunk

__all__ = ["CHARACTER_FORMATS", "ELEVEN_BITS", "CharacterFormatSearch", "Trial"]

ELEVEN_BITS, TEN_BITS, NINE_BITS = (8, "E", 1.0), (8, "N", 1.0), (7, "N", 1.0)
CHARACTER_FORMATS = (ELEVEN_BITS, TEN_BITS, NINE_BITS)

EVEN, MARK, NONE, ODD = (8, "E", 1.0), (8, "M", 1.0), (8, "N", 1.0), (8, "O", 1.0)
CANDIDATES = (EVEN, MARK, NONE, ODD)
"""In this order: two stop bits pass as a parity bit that is always 1, and as one stop bit."""

CONFIRM_BYTES, FIRST_BURST_BYTES = 20, 40
"""Bytes without an error that are believed; bytes after which a start in the middle is over."""

MAX_BYTES_WITHOUT_FRAME = 72
"""Bytes without a frame after which a shape is left, where the driver marks nothing."""

_MAX_ERROR_SHARE, _ALWAYS_0_SHARE, _ALWAYS_1_SHARE, _TEXT_SHARE = 0.03, 0.1, 0.9, 0.9
_NEWEST_BYTES = 24
_GAP_CHARS = 5
_GAP_NS = 3_000_000
_ASCII_FRAME_BYTES = frozenset(b":0123456789ABCDEFabcdef\r\n")
_NS_PER_S = 1_000_000_000


@dataclass(slots=True)
class Trial:
    """What was heard with one setting.

    The first burst may have begun in the middle: `settled_bytes` and `settled_errors` count what
    came behind it.
    """

    line: Line
    chunks: list[tuple[int, Chunk]] = field(default_factory=list)
    data: bytearray = field(default_factory=bytearray)
    marked_bytes: int = 0
    settled_bytes: int = 0
    settled_errors: int = 0
    last_ns: int = 0
    bursts: int = 0
    bursts_ending_in_zero: int = 0

    def add(self, port: int, chunk: Chunk) -> None:
        """A read of that port."""
        gap = round(_GAP_CHARS * _NS_PER_S * self.line.char_bits / self.line.baud) + _GAP_NS
        if self.last_ns and chunk.time_ns - self.last_ns > gap:
            self.bursts += 1
            self.bursts_ending_in_zero += self.data[-1] == 0
        if self.bursts or len(self.data) >= FIRST_BURST_BYTES:
            self.settled_bytes += len(chunk.data)
            self.settled_errors += len(chunk.errors)
        self.last_ns = chunk.time_ns
        self.chunks.append((port, chunk))
        self.data += chunk.data
        self.marked_bytes += len(chunk.errors)

    def looks_like_text(self) -> bool:
        """Whether these are characters of ASCII frames, whatever bit 7 is.

        The newest count only: who begins to listen within a burst hears nonsense to its end.
        """
        newest = self.data[-_NEWEST_BYTES:]
        return sum(byte & 0x7F in _ASCII_FRAME_BYTES for byte in newest) >= _TEXT_SHARE * len(
            newest
        )


class CharacterFormatSearch:
    """From a trial in which frames came through to the line's settings.

    `line` are the settings once they are known; until then, `candidate` says what to listen with
    and `evaluate` takes what came. `error_shares` says what spoke for them, in words.
    """

    def __init__(self, trial: Trial, mode: str, *, marks_errors: bool) -> None:
        self.mode = mode
        self.line: Line | None = None
        self.error_shares = ""
        self._marks_errors = marks_errors
        self._bit_7 = _bit_7_of(trial) if mode == "ascii" else ""
        self._fallback = trial.line
        format_ = _format_of(trial.line)
        others = (
            (NONE,) if not marks_errors else CANDIDATES if format_ == ELEVEN_BITS else (MARK, NONE)
        )
        self._candidates = [Line(trial.line.baud, *other) for other in others]
        self.candidate = self._candidates.pop(0)
        if format_ == NINE_BITS or (
            format_ == ELEVEN_BITS and marks_errors and not trial.marked_bytes
        ):
            self._settle(trial.line)
        elif not marks_errors and format_ == TEN_BITS:
            self._settle(trial.line)
        elif not marks_errors:
            self.error_shares = (
                "the port does not tell them, so that even and odd parity look alike"
            )

    def evaluate(self, trial: Trial, *, fits: bool) -> bool:
        """Whether something new follows from what came: settings, or others to try."""
        if not self._marks_errors:
            if not fits and len(trial.data) < MAX_BYTES_WITHOUT_FRAME:
                return False
            self._settle(trial.line if fits else self._fallback)
            return True
        if trial.settled_bytes < CONFIRM_BYTES:
            return False
        share = trial.settled_errors / trial.settled_bytes
        self.error_shares += f"{', ' if self.error_shares else ''}{share:.0%} at {trial.line}"
        if share <= _MAX_ERROR_SHARE or not self._candidates:
            self._settle(trial.line)
        else:
            self.candidate = self._candidates.pop(0)
        return True

    def _settle(self, clean: Line) -> None:
        """The settings whose characters come without errors through `clean`."""
        format_ = _format_of(clean)
        if self._bit_7 and format_[0] == ELEVEN_BITS[0]:
            stop = 1 if format_ == TEN_BITS and self._bit_7 != "N" else 2
            self.line = Line(clean.baud, 7, self._bit_7, stop)
        elif format_ == MARK:
            self.line = Line(clean.baud, 8, "N", 2)
        else:
            self.line = clean


def _format_of(line: Line) -> tuple[int, str, float]:
    return (line.data_bits, line.parity, float(line.stop_bits))


def _bit_7_of(trial: Trial) -> str:
    """What bit 7 of characters of seven bits was: parity, a stop bit; "" for a data bit."""
    sound = trial.data[-trial.settled_bytes :] if trial.settled_bytes else trial.data
    text = [byte for byte in sound if byte & 0x7F in _ASCII_FRAME_BYTES]
    high = sum(byte >> 7 for byte in text) / max(len(text), 1)
    odd = sum(byte.bit_count() & 1 for byte in text)
    if high < _ALWAYS_0_SHARE:
        return ""
    if high > _ALWAYS_1_SHARE:
        return "N"
    return "O" if 2 * odd > len(text) else "E"
