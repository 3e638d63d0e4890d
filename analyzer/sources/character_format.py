"""Finds data bits, parity and stop bits of a line whose baud rate is known.

While the rate is searched, three character formats are tried. 8E1 has eleven bits: 8O1 and 8N2 can
be received with it, too, with line errors where the driver checks parity. 8N1 has ten bits: 7E1,
7O1 and 7N2 can be received with it, with their parity or stop bit in bit 7. 7N1 has nine bits. Once
frames are received, `CharacterFormatSearch` tries the formats that could also have given these
bytes, until one is received without line errors.

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
"""The formats of eleven bits and of ten, in the order in which they are tried.

8M1 is the same on the line as 8N2: the first of two stop bits is a parity bit that is always 1.
"""

CONFIRM_BYTES, FIRST_BURST_BYTES = 20, 40
"""Bytes needed to confirm a format; bytes after which the first burst is over in any case.

The first burst may have begun in the middle of a frame, so its line errors prove nothing.
"""

MAX_BYTES_WITHOUT_FRAME = 72
"""Bytes without a frame after which a format is given up, where the driver marks no errors."""

_MAX_ERROR_SHARE, _ALWAYS_0_SHARE, _ALWAYS_1_SHARE, _TEXT_SHARE = 0.03, 0.1, 0.9, 0.9
_NEWEST_BYTES = 24
_GAP_CHARS = 5
_GAP_NS = 3_000_000
_ASCII_FRAME_BYTES = frozenset(b":0123456789ABCDEFabcdef\r\n")
_NS_PER_S = 1_000_000_000


@dataclass(slots=True)
class Trial:
    """What was received with one line setting.

    `settled_bytes` and `settled_errors` count bytes and line errors after the first burst, which
    may have begun in the middle of a character. `bursts_ending_in_zero` hints at swapped wires.
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
        """Add a read of the port with this number."""
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
        """Whether the newest bytes are characters of Modbus ASCII frames, ignoring bit 7.

        Only the newest bytes count, because a receiver that starts inside a burst reads garbage up
        to its end.
        """
        newest = self.data[-_NEWEST_BYTES:]
        return sum(byte & 0x7F in _ASCII_FRAME_BYTES for byte in newest) >= _TEXT_SHARE * len(
            newest
        )


class CharacterFormatSearch:
    """Finds the character format, from a trial at the right rate in which frames were received.

    `line` are the settings once they are known. Until then `candidate` are the settings to listen
    with next, and `evaluate` takes what was received. `error_shares` is the evidence in words.
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
                "not reported by the port, so even and odd parity cannot be told apart"
            )

    def evaluate(self, trial: Trial, *, fits: bool) -> bool:
        """Evaluate a trial; True if `line` is known now or `candidate` has changed.

        `fits` says whether frames with valid checksums were received in the trial.
        """
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
        """Set `line`: the settings whose characters are received without errors as `clean`."""
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
    """What bit 7 is in a trial of Modbus ASCII: parity `E` or `O`, a stop bit `N`, data ""."""
    sound = trial.data[-trial.settled_bytes :] if trial.settled_bytes else trial.data
    text = [byte for byte in sound if byte & 0x7F in _ASCII_FRAME_BYTES]
    high = sum(byte >> 7 for byte in text) / max(len(text), 1)
    odd = sum(byte.bit_count() & 1 for byte in text)
    if high < _ALWAYS_0_SHARE:
        return ""
    if high > _ALWAYS_1_SHARE:
        return "N"
    return "O" if 2 * odd > len(text) else "E"
