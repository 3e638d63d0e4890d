"""How far the reading of recordings has come, in one line that is drawn again and again.

It appears on standard error after two seconds, if that is a terminal, and is wiped away before
anything else is printed there and at the end.
"""

from __future__ import annotations

import os
import sys
import time

from analyzer.counts import bytes_of
from analyzer.views.screen import fit

__all__ = ["ProgressLine"]

FIRST_S = 2.0
INTERVAL_S = 0.25
_WIPE = "\r\x1b[K"
_CERTAIN_SHARE = 0.005
"""Of the whole: the time that is left is not told from less."""


class ProgressLine:
    """Draws the line; `advance` is informed of every block that has been decoded.

    Where `shown` is False, and on anything but a terminal, nothing is drawn.
    """

    def __init__(self, *, shown: bool = True) -> None:
        self.is_drawn = False
        self._shown = shown and sys.stderr.isatty() and os.environ.get("TERM", "dumb") != "dumb"
        self._start_s = time.monotonic()
        self._next_s = self._start_s + FIRST_S

    def advance(self, done: int, total: int | None) -> None:
        """So many bytes have been read, of so many; None where nobody knows how many there are."""
        now = time.monotonic()
        if self._shown and now >= self._next_s:
            self._next_s = now + INTERVAL_S
            self._write(_WIPE + fit(line(done, total, now - self._start_s), _width()).rstrip())
            self.is_drawn = True

    def wipe(self) -> None:
        """Take the line away; the next block draws it again."""
        if self.is_drawn:
            self.is_drawn = False
            self._write(_WIPE)

    def _write(self, text: str) -> None:
        try:
            sys.stderr.write(text)
            sys.stderr.flush()
        except OSError:
            self._shown = False


def line(done: int, total: int | None, seconds: float) -> str:
    """The line's text.

    >>> line(30_000_000, 120_000_000, 3.0)
    '25 % of 120 MB, 10.0 MB/s, 9 s left'
    >>> line(30_000_000, None, 3.0), line(1_000, 10_000_000, 3.0)
    ('30.0 MB read, 10.0 MB/s', '0 % of 10.0 MB, 333 B/s')
    """
    rate = done / seconds
    speed = f"{bytes_of(rate)}/s"
    if not total:
        return f"{bytes_of(done)} read, {speed}"
    share = min(done / total, 1.0)
    text = f"{100 * share:.0f} % of {bytes_of(total)}, {speed}"
    if share < _CERTAIN_SHARE:
        return text
    return f"{text}, {_duration((total - done) / rate)} left"


def _duration(seconds: float) -> str:
    """A time in words.

    >>> _duration(9.2), _duration(192), _duration(7300), _duration(-1)
    ('9 s', '3 min 12 s', '2 h 1 min', '0 s')
    """
    whole = max(round(seconds), 0)
    if whole < 60:  # noqa: PLR2004
        return f"{whole} s"
    if whole < 3600:  # noqa: PLR2004
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole // 60 % 60} min"


def _width() -> int:
    try:
        return (os.get_terminal_size(2).columns or 80) - 1
    except OSError:
        return 79
