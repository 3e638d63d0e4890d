"""Addresses of registers and bits as people write them, and as they go over the wire.

On the wire an address counts from 0 and says nothing of the type; handbooks count from 1 and put
the type in front: wire address 107 of the holding registers is `40108` (five digits), `400108`
(six) or `4x006B` (the wire address in hex, after the type).

>>> render(107, "holding_register", "5digit"), render(107, "holding_register", "hex")
('40108', '0x006B')
"""

from __future__ import annotations

import _modlens

__all__ = [
    "BASES",
    "SHORT",
    "render",
]

SHORT = {
    "coil": "co",
    "discrete_input": "di",
    "input_register": "ir",
    "holding_register": "hr",
}
"""Register type -> its short name in filters and narrow tables."""

BASES = ("wire", "5digit", "6digit", "hex")
"""The notations in which `--address` shows addresses."""


def render(wire: int, kind: str | None, base: str) -> str:
    """Write a wire address in one of the notations of `BASES`.

    Where the register type is unknown, the wire address is written as it is. Five digits reach up
    to number 9999; above that, six digits are used.
    """
    return _modlens.register_number(wire, kind, base)
