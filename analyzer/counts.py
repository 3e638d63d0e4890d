"""Numbers with their nouns, in the singular or the plural.

>>> count_of(1, "frame"), count_of(2, "frame"), count_of(0, "byte"), count_of(1200, "retry")
('1 frame', '2 frames', '0 bytes', '1,200 retries')
>>> count_of(2, "address"), count_of(1, "transaction")
('2 addresses', '1 transaction')
"""

from __future__ import annotations

import re

__all__ = ["count_of"]


def count_of(number: int, noun: str) -> str:
    """A number with its noun, which is given in the singular; thousands are separated."""
    return f"{number:,} {noun if number == 1 else _plural(noun)}"


def _plural(noun: str) -> str:
    if re.search(r"[^aeiou]y$", noun):
        return f"{noun[:-1]}ies"
    return f"{noun}{'es' if noun.endswith(('s', 'x', 'ch')) else 's'}"
