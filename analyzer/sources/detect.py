r"""Which format a recording has, from its first bytes.

The core scores the formats; what is decided here is when a guess is good enough, and when an order
(`--from`) cannot be meant: binary data is not text, and text of a known form is not the bytes of a
line.

>>> detection = choose(b"01 03 00 6B 00 03 74 17\n", "bus.hex")
>>> detection.format, detection.ordered
('hex', False)
"""

from __future__ import annotations

from dataclasses import dataclass

import _modlens
from analyzer.sources import FORMATS
from dissectors.errors import SourceError, UsageError

__all__ = ["SAMPLE", "Detection", "choose"]

SAMPLE = 64 * 1024
"""Bytes that are looked at."""

SURE = 0.9
"""From this confidence on the core's opinion refuses an order that contradicts it."""

DOUBTFUL = 0.2
"""Below this confidence a format is no finding, only the best of bad ones."""

_ASCII = bytes(range(0x80))
_TEXT_BYTES = bytes([*range(0x20, 0x7F), *b"\t\n\v\f\r\x1b"])


@dataclass(frozen=True, slots=True)
class Detection:
    """The format of a recording, how sure that is (0 to 1), why, and whether it was ordered."""

    format: str
    confidence: float
    reason: str
    ordered: bool


def choose(sample: bytes, name: str, order: str | None = None) -> Detection:
    """The format of a file that begins with `sample`.

    `UsageError` for an unknown format, `SourceError` where the order cannot be meant or no format
    fits.
    """
    scores = _modlens.detect(sample, name)
    if order is not None:
        return _ordered(sample, name, order, scores)
    best, confidence, reason = scores[0]
    if confidence < DOUBTFUL:
        kind = "text, but of no known form" if is_text(sample) else f"of no known form ({reason})"
        raise SourceError(f"{name}: {kind}; see `modlens formats`, or say it by --from")
    return Detection(best, confidence, reason, ordered=False)


def is_text(sample: bytes) -> bool:
    """Whether these bytes can be text at all.

    Hardly any of them are control characters or above ASCII.

    >>> is_text(b"12:00 Rx: 01 03"), is_text(bytes.fromhex("0103006b00037417"))
    (True, False)
    """
    strange = len(sample.translate(None, _TEXT_BYTES))
    high = len(sample.translate(None, _ASCII))
    return strange - high == 0 and high * 3 <= len(sample)


def _ordered(
    sample: bytes, name: str, order: str, scores: list[tuple[str, float, str]]
) -> Detection:
    if order not in FORMATS:
        raise UsageError(f"--from {order}: no such format; there are {', '.join(FORMATS)}")
    best, confidence, reason = scores[0]
    own = next((score for form, score, _ in scores if form == order), 0.0)
    if not FORMATS[order].binary and not is_text(sample):
        raise SourceError(
            f"{name}: binary data, not {order} text; leave --from out, or say --from raw"
        )
    if FORMATS[order].binary and best != order and confidence >= SURE and is_text(sample):
        raise SourceError(
            f"{name}: text ({FORMATS[best].title}: {reason}), not the bytes of a line;"
            f" leave --from out, or say --from {best}"
        )
    return Detection(order, own, "as ordered by --from", ordered=True)
