r"""Detects the format of a recording from its first bytes.

The core scores the formats and decides; the page in a browser asks it the same. Here its refusals
become errors.

>>> detection = detect_format(b"01 03 00 6B 00 03 74 17\n", "bus.hex")
>>> detection.format, detection.forced
('hex', False)
"""

from __future__ import annotations

from dataclasses import dataclass

import _modlens
from analyzer.sources import all_formats
from dissectors.errors import SourceError, UsageError

__all__ = ["SAMPLE_BYTES", "Detection", "detect_format"]

SAMPLE_BYTES = 64 * 1024
"""Bytes at the beginning of a recording by which its format is detected."""


@dataclass(frozen=True, slots=True)
class Detection:
    """The format of a recording, the confidence (0 to 1), the reason, whether it was forced."""

    format: str
    confidence: float
    reason: str
    forced: bool


def detect_format(
    sample: bytes,
    name: str,
    forced_format: str | None = None,
    dialects: _modlens.Dialects | None = None,
) -> Detection:
    """Detect the format of a file that begins with `sample`; `dialects` are the text formats.

    `forced_format` is the value of `--from`. `UsageError` for an unknown format, `SourceError`
    where the forced format cannot be right, no format fits, or nothing in a text proves to be
    Modbus.
    """
    table = dialects or _modlens.Dialects()
    try:
        found = table.decide(sample, name, forced_format)
    except LookupError as error:
        raise UsageError(f"--from {forced_format}: {_no_such(str(error.args[0]), table)}") from None
    except ValueError as error:
        raise SourceError(f"{name}: {error}") from None
    return Detection(*found, forced=forced_format is not None)


def _no_such(part: str, table: _modlens.Dialects) -> str:
    import difflib  # noqa: PLC0415 - for a message only

    hints = difflib.get_close_matches(part, all_formats(table), 1)
    return f"no such format; {f'did you mean {hints[0]!r}?' if hints else 'see `modlens formats`'}"
