"""Numbers with their nouns, in the singular or the plural.

>>> count_of(1, "frame"), count_of(2, "frame"), count_of(0, "byte"), count_of(1200, "retry")
('1 frame', '2 frames', '0 bytes', '1,200 retries')
>>> count_of(2, "address"), count_of(1, "transaction")
('2 addresses', '1 transaction')
"""

from __future__ import annotations

__all__ = ["bytes_of", "count_of"]


def count_of(number: int, noun: str) -> str:
    """A number with its noun, which is given in the singular; thousands are separated."""
    return f"{number:,} {noun if number == 1 else _plural(noun)}"


def _plural(noun: str) -> str:
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{noun[:-1]}ies"
    return f"{noun}{'es' if noun.endswith(('s', 'x', 'ch')) else 's'}"


def bytes_of(number: float) -> str:
    """A number of bytes with a decimal unit.

    >>> bytes_of(999), bytes_of(30_000_000), bytes_of(120_000_000), bytes_of(2.5e9)
    ('999 B', '30.0 MB', '120 MB', '2.5 GB')
    """
    for unit in ("B", "kB", "MB", "GB"):
        if number < 1000 or unit == "GB":  # noqa: PLR2004
            break
        number /= 1000
    return f"{number:.{int(unit != 'B' and number < 100)}f} {unit}"  # noqa: PLR2004
