"""Addresses as people write them: from 1, with a digit in front; the protocol counts from 0.

Modicon's notation: 0 for coils, 1 for discrete inputs, 3 for input registers, 4 for holding
registers, then the number from 1: four digits (40108) as far as they reach, five (400108) for all
65,536. Not part of the specification (which only says that numbers count from 1, 4.4), but every
manual uses it.

>>> modicon_address(107, "holding_register")
'400108 (40108)'
>>> modicon_address(20000, "coil")
'020001'
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["LEADING_DIGIT", "NOUNS", "five_digit", "modicon_address", "six_digit"]

LEADING_DIGIT: Mapping[str, int] = {
    "coil": 0,
    "discrete_input": 1,
    "input_register": 3,
    "holding_register": 4,
}

NOUNS: Mapping[str, str] = {
    "coil": "coil",
    "discrete_input": "input",
    "input_register": "register",
    "holding_register": "register",
}
"""Register type -> what one item is called in a sentence."""

MAX_FIVE_DIGIT_NUMBER = 9999


def six_digit(address: int, register_type: str) -> str:
    """A wire address in the notation of six digits, which reaches all addresses.

    >>> six_digit(0, "input_register")
    '300001'
    """
    return f"{LEADING_DIGIT[register_type]}{address + 1:05d}"


def five_digit(address: int, register_type: str) -> str | None:
    """A wire address in the notation of five digits; None where that does not reach.

    >>> five_digit(19, "coil"), five_digit(9999, "coil")
    ('00020', None)
    """
    if address >= MAX_FIVE_DIGIT_NUMBER:
        return None
    return f"{LEADING_DIGIT[register_type]}{address + 1:04d}"


def modicon_address(address: int, register_type: str) -> str:
    """A wire address in six digits, followed by five digits in brackets where they suffice."""
    short = five_digit(address, register_type)
    long = six_digit(address, register_type)
    return long if short is None else f"{long} ({short})"
