"""Addresses of registers and bits as people write them, and as they go over the wire.

On the wire an address counts from 0 and says nothing of the type; handbooks count from 1 and put
the type in front: wire address 107 of the holding registers is `40108` (five digits), `400108`
(six) or `4x006B` (the wire address in hex, after the type).

>>> parse("40108")
Address(register_type='holding_register', wire=107)
>>> parse("4x006B").wire
107
>>> render(107, "holding_register", "5digit"), render(107, "holding_register", "hex")
('40108', '0x006B')
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from dissectors.address import LEADING_DIGIT, five_digit, six_digit

__all__ = [
    "BASES",
    "LAST_ADDRESS",
    "REGISTER_TYPES",
    "SHORT",
    "Address",
    "parse",
    "register_type",
    "render",
]

REGISTER_TYPES = tuple(LEADING_DIGIT)

SHORT = {
    "coil": "co",
    "discrete_input": "di",
    "input_register": "ir",
    "holding_register": "hr",
}
"""Register type -> its short name in filters and narrow tables."""

BASES = ("wire", "5digit", "6digit", "hex")
"""The notations in which `--address` shows addresses."""

LAST_ADDRESS = 0xFFFF
"""The highest wire address."""

_TYPE = {str(digit): name for name, digit in LEADING_DIGIT.items()}
# Compiled where they are first asked for (`re` keeps them): most commands ask for no address.
_NUMBERED_FROM_1 = r"([0134])(\d{4}|\d{5})"
_HEX = r"([0134])x([0-9A-Fa-f]{1,4})"


@dataclass(frozen=True, slots=True)
class Address:
    """A register or bit: its type and its address on the wire (0 to 65535)."""

    register_type: str
    wire: int


def parse(text: str) -> Address | None:
    """Parse `40108`, `400108` or `4x006B`; None if the text is not an address literal."""
    match = re.fullmatch(_HEX, text)
    if match:
        return Address(_TYPE[match[1]], int(match[2], 16))
    match = re.fullmatch(_NUMBERED_FROM_1, text)
    if not match:
        return None
    wire = int(match[2]) - 1  # handbooks count from 1
    return Address(_TYPE[match[1]], wire) if 0 <= wire <= LAST_ADDRESS else None


def register_type(name: str) -> str | None:
    """The register type of a short or full name (`hr`, `holding_register`).

    None for other words.
    """
    if name in REGISTER_TYPES:
        return name
    return next((full for full, short in SHORT.items() if short == name), None)


def render(wire: int, kind: str | None, base: str) -> str:
    """Write a wire address in one of the notations of `BASES`.

    Where the register type is unknown, the wire address is written as it is. Five digits reach up
    to number 9999; above that, six digits are used.
    """
    if base == "hex":
        return f"0x{wire:04X}"
    if base == "wire" or kind is None:
        return str(wire)
    short = five_digit(wire, kind) if base == "5digit" else None
    return short or six_digit(wire, kind)
