"""The context of a field: the decoded PDU, its direction, and the request it responds to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dissectors.pdu import DecodedField, Pdu
from dissectors.table import Direction, Function

__all__ = ["LAST_ADDRESS", "Context", "Meaning"]

LAST_ADDRESS = 0xFFFF

USER_DEFINED = (range(65, 73), range(100, 111))
"""User-defined function codes (application protocol, section 5)."""


@dataclass(frozen=True, slots=True)
class Meaning:
    """The meaning of a field in words, and whether its value is valid."""

    text: str
    is_valid: bool = True


@dataclass(frozen=True, slots=True)
class Context:
    """The decoded PDU of a field, and the request that it responds to, if that is known.

    `size` is the PDU's length in bytes.
    """

    pdu: Pdu
    size: int
    direction: Direction
    request: Pdu | None = None

    @property
    def row(self) -> Function | None:
        """The row of the table of functions; None where the table has none."""
        return self.pdu.row

    @property
    def request_numbers(self) -> Mapping[str, int]:
        """The numbers in the request that this PDU responds to; empty if it is not known."""
        if self.request is None or self.request.function != self.pdu.function:
            return {}
        return self.request.numbers

    def title(self, *, guessed: bool) -> Meaning:
        """The meaning of the function code."""
        code, row = self.pdu.function, self.row
        if row is None:
            own = any(code in span for span in USER_DEFINED)
            name = f"function {code}{', user-defined' if own else ''}, not in the table"
        else:
            name = row.name if row.label == row.name else f"{row.name} ({row.label})"
        if self.pdu.exception is not None:
            return Meaning(f"{name}: exception response")
        if row is not None and not row.has_response and self.direction == "response":
            return Meaning(f"{name}: response, but this function has no response", is_valid=False)
        return Meaning(f"{name}, {self.direction}{' by its layout' if guessed else ''}")

    def bytes_after(self, part: DecodedField) -> int | None:
        """The number of bytes after a field; None for a field inside a group."""
        inside = part.path != part.name
        return None if inside else self.size - part.offset - part.length

    def register_block(self, name: str) -> tuple[str | None, int | None, int | None]:
        """Register type, first address and quantity that a field belongs to, as far as known.

        `name` is the field's name; a prefix such as `write_` chooses between the two blocks of
        function 23.
        """
        if self.row is None or self.row.register_type is None:
            return None, None, None
        prefix = name[: name.rfind("_") + 1]
        known = self.pdu.numbers if self.direction == "request" else self.request_numbers
        if f"{prefix}address" not in known:
            known = self.pdu.numbers
        start, quantity = known.get(f"{prefix}address"), known.get(f"{prefix}quantity")
        return self.row.register_type, start, quantity
