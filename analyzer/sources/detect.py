r"""Detects the format of a recording from its first bytes.

The core scores the formats. Here it is decided when a score is good enough, and when a format
forced by `--from` must be wrong: binary data is not text, and text of a known format is not a
recording of raw bytes.

>>> detection = detect_format(b"01 03 00 6B 00 03 74 17\n", "bus.hex")
>>> detection.format, detection.forced
('hex', False)
"""

from __future__ import annotations

from dataclasses import dataclass

import _modlens
from analyzer.sources import BINARY, all_formats, is_binary
from analyzer.sources.encodings import is_utf8
from dissectors.errors import SourceError, UsageError

__all__ = ["SAMPLE_BYTES", "Detection", "detect_format"]

SAMPLE_BYTES = 64 * 1024
"""Bytes at the beginning of a recording by which its format is detected."""

MIN_CERTAIN = 0.9
"""Confidence (0 to 1) from which on a detected format refuses a contradicting `--from`."""

MIN_CONFIDENCE = 0.2
"""Below this confidence (0 to 1) no format is taken as detected."""

_MAX_STRAY_PER = 50
"""A text has at most one control character in so many bytes."""

_ASCII = bytes(range(0x80))
_TEXT_BYTES = bytes([*range(0x20, 0x7F), *b"\t\n\v\f\r\x1b"])


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
    scores = table.detect(sample, name)
    if forced_format is not None:
        return _forced(sample, name, forced_format, scores, table)
    best, confidence, reason = scores[0]
    if confidence < MIN_CONFIDENCE:
        raise SourceError(f"{name}: {_refusal(sample, best, reason)}")
    return Detection(best, confidence, reason, forced=False)


def _refusal(sample: bytes, best: str, reason: str) -> str:
    """The error text for a file of which no format was detected: why, and what to do."""
    if best != "raw":
        return (
            f"no Modbus found: looks like {best}, but {reason};"
            f" use --from {best} to decode it anyway"
        )
    kind = "text in an unknown format" if is_text(sample) else f"unknown format ({reason})"
    if is_text(sample) and "hex" in reason:
        kind = f"{kind}: {reason}"
    return f"{kind}; see `modlens formats`, or choose one with --from"


def is_text(sample: bytes) -> bool:
    """Whether these bytes can be text: hardly any control characters, and UTF-8 or mostly ASCII.

    A bell, an end-of-file mark or the zeros after a log that lost power do not make it binary.

    >>> is_text(b"12:00 Rx: 01 03"), is_text(bytes.fromhex("0103006b00037417"))
    (True, False)
    """
    text = sample.rstrip(b"\0")
    high = len(text.translate(None, _ASCII))
    controls = len(text.translate(None, _TEXT_BYTES)) - high
    if (sample and not text) or controls * _MAX_STRAY_PER > len(text):
        return False
    return high * 3 <= len(text) or is_utf8(text)


def _forced(
    sample: bytes,
    name: str,
    forced_format: str,
    scores: list[tuple[str, float, str]],
    table: _modlens.Dialects,
) -> Detection:
    """The detection for a format forced by `--from`; errors as those of `detect_format`."""
    for part in forced_format.split("+"):
        if part not in BINARY and part not in (known := all_formats(table)):
            import difflib  # noqa: PLC0415 - for a message only

            hints = difflib.get_close_matches(part, known, 1)
            question = f"did you mean {hints[0]!r}?" if hints else "see `modlens formats`"
            raise UsageError(f"--from {forced_format}: no such format; {question}")
    best, confidence, reason = scores[0]
    own = next((score for form, score, _ in scores if form == forced_format), 0.0)
    if not is_binary(forced_format) and not is_text(sample):
        raise SourceError(
            f"{name}: binary data, not {forced_format} text; leave --from out, or use --from raw"
        )
    if (
        is_binary(forced_format)
        and best != forced_format
        and confidence >= MIN_CERTAIN
        and is_text(sample)
    ):
        raise SourceError(
            f"{name}: text ({best}: {reason}), not the bytes of a line;"
            f" leave --from out, or use --from {best}"
        )
    return Detection(forced_format, own, "as named by --from", forced=True)
