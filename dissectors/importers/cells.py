"""Parses the cells of a row that describe a value: order, scale, labels, access, sentinels.

A cell that is not understood becomes a note with its line.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from dissectors.function_lookup import normalized
from dissectors.importers.profile_builder import (
    ProfileBuilder,
    compose_orders,
    parse_decimal,
    parse_row_order,
)

__all__ = ["RowCells"]

_YES = ("t", "true", "yes", "y", "1", "x", "mixed")
_NO = ("", "f", "false", "no", "n", "0")
_WRITES = (*_YES, "rw", "rdwr", "readwrite", "rorw", "write", "writable", "writeable")
_WRITES_ONLY = ("w", "wo", "writeonly")
_READS = (*_NO, "r", "ro", "read", "readonly", "rd")
_LIMITS = ("rawlow", "rawhigh", "scaledlow", "scaledhigh")

_ScaleAndOffset = tuple[int | float | None, int | float | None]
"""Scale and offset."""

_RAW = r"[\"']?(-?(?:0[xX][0-9a-fA-F]{1,16}|\d{1,20}))[\"']?\s*[=:]"
_LABEL = re.compile(rf"\s*{_RAW}\s*[\"']?(.*?)[\"']?[\s,;|]*", re.DOTALL)
_BETWEEN_LABELS = re.compile(rf"[,;|\n]\s*(?={_RAW.replace('(-', '(?:-', 1)})")

_NUMBER = r"-?(?:0[xX][0-9a-fA-F]{1,16}|\d{1,20}(?:[.,]\d{1,20})?)"
_RANGE = re.compile(rf"{_NUMBER}\s*(?:~|-|\u2013|\.\.\.?|to)\s*{_NUMBER}\s*%?")
"""Limits of the values, such as `0~100%`, where other rows have labels."""


@dataclass(frozen=True, slots=True)
class RowCells:
    """A row of a table: its cells by key.

    `where` is its line and name, for the notes, which `builder` takes.
    """

    row: Mapping[str, str]
    where: str
    builder: ProfileBuilder

    def get(self, key: str) -> str:
        """The text of a cell; empty where the table has no such column."""
        return self.row.get(key, "")

    def note(self, text: str) -> None:
        """Add a note on this row."""
        self.builder.notes.append(f"{self.where}: {text}")

    def order(self) -> str | None:
        """The order of bytes and words, such as `CDAB`; `NotConvertible` for an unknown word."""
        of_bytes, of_words = normalized(self.get("order")), normalized(self.get("words"))
        if not of_words or of_bytes in ("abcd", "cdab", "badc", "dcba"):
            if of_bytes in _YES + _NO:
                return "CDAB" if of_bytes in _YES else None
            return parse_row_order(self.row.get("order"))
        words_swapped = of_words in _YES or (
            of_words not in _NO and parse_row_order(self.row["words"]) in ("CDAB", "DCBA")
        )
        bytes_swapped = of_bytes in _YES or (
            of_bytes not in _NO and parse_row_order(self.row["order"]) in ("BADC", "DCBA")
        )
        return compose_orders("CDAB" if words_swapped else None, "BADC" if bytes_swapped else None)

    def scale_and_offset(self) -> _ScaleAndOffset:
        """Scale and offset: of their columns, of Kepware's limits, or of VOLTTRON's transform."""
        scaling = self.row.get("scaling", "linear").strip().lower() or "none"
        if transform := self.get("transform").strip():
            match = re.fullmatch(r"scale(?:_int)?\(([^()]+)\)", transform)
            return self._factors(match[1] if match else transform, "")
        scale, offset = self.get("scale"), self.get("offset")
        limits = [parse_decimal(self.get(key)) for key in _LIMITS]
        if scale or offset or scaling == "none":
            if any(limits) and scaling != "none":
                self.note("scale and offset count; the four limits beside them are ignored")
            return self._factors(scale, offset)
        if scaling != "linear":
            self.note(f"scaling {self.row['scaling']!r} is not linear; skipped")
            return None, None
        low, high, down, up = limits
        if low is None or high is None or down is None or up is None or low == high:
            if self.get("scaling") or any(limits):
                self.note("scaling without its four limits; skipped")
            return None, None
        factor = (up - down) / (high - low)
        if self.get("negatevalue").lower() in _YES:
            factor, down = -factor, -down
        clamps = [key for key in ("clamplow", "clamphigh") if self.get(key).lower() in _YES]
        self.builder.note_dropped(clamps)
        return self._factors(repr(round(factor, 12)), repr(round(down - low * factor, 9)))

    def _factors(self, scale: str, offset: str) -> _ScaleAndOffset:
        factor, shift = parse_decimal(scale), parse_decimal(offset)
        if scale and factor in (None, 0):
            self.note(f"scale {scale!r} is not a usable number; skipped")
        if offset and shift is None:
            self.note(f"offset {offset!r} is not a number; skipped")
        return None if factor in (0, 1) else factor, None if shift == 0 else shift

    def sentinels(self) -> list[int | float]:
        """The raw values that stand for "no value", which are separated by semicolons."""
        found = [(part, _signed(part)) for part in self.get("nan").split(";") if part.strip()]
        for part, value in found:
            if value is None:
                self.note(f"no value {part!r} is not a number; skipped")
        return [value for _, value in found if value is not None]

    def access(self) -> str | None:
        """The access (`rw`, `w` or None) in the words of profiles."""
        word = normalized(self.get("access"))
        if word in _WRITES_ONLY:
            return "w"
        if word not in _WRITES + _READS:
            self.note(f"access {self.row['access']!r} is not known; skipped")
        return "rw" if word in _WRITES else None

    def labels(self) -> dict[str, str]:
        r"""`0=off;1=on`, `0: off, 1: on` or `{"0": "off"}`."""
        text = self.get("enum").strip().strip("{}")
        if _RANGE.fullmatch(text):
            self.builder.note_dropped(["a range of values"])
            return {}
        labels = {}
        for part in _BETWEEN_LABELS.split(text) if text else []:
            match = _LABEL.fullmatch(part)
            raw = match and _signed(match[1])
            if not match or not isinstance(raw, int) or not -(2**63) <= raw < 2**63:
                self.note(f"labels {part!r} are not understood; skipped")
            elif match[2].strip():
                labels[str(raw)] = match[2].strip()
        return labels


def _signed(text: str) -> int | float | None:
    text = text.strip()
    value = parse_decimal(text.removeprefix("-"))
    return -value if value is not None and text.startswith("-") else value
