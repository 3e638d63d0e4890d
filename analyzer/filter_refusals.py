"""What a filter is refused with: the message, the place in its text, and what may be meant."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import NoReturn

from analyzer import addresses
from analyzer.filter_terms import KIND_NAMES, KIND_OF_TYPE, Term
from analyzer.filter_words import (
    VOCABULARIES,
    closed_set,
    column_of_word,
    instead_of_column,
    nearest_value,
)
from dissectors.errors import FilterError
from dissectors.function_lookup import similar_name
from dissectors.texts import respelled

__all__ = ["Refusals"]

# The longest set of values that a message lists.
MAX_LISTED = 8


class Refusals:
    """The refusals of one filter text for the rows of `table`.

    `column_types` maps the table's columns to their types. Every refusal is a `FilterError`, which
    names the column of the text. `notes` are what is valid, but may be meant otherwise.
    """

    def __init__(self, text: str, table: str, column_types: Mapping[str, str]) -> None:
        self._text = text
        self._table = table
        self._column_types = column_types
        self.notes: list[str] = []

    def _known_value(self, column: str, text: str, node: ast.expr, *, part: bool = False) -> str:
        """The current spelling of a value of a column; refused where the column never has it.

        With `part` a part of a value will do.
        """
        word = respelled(VOCABULARIES[column], text) if column in VOCABULARIES else text
        known = closed_set(column)
        is_part = part and any(text in one for one in known)
        if not known or word in known or is_part:
            return word
        hint = nearest_value(column, word)
        listed = ", ".join(known) if len(known) <= MAX_LISTED else "listed by `modlens explain`"
        some = "" if hint is not None else f"; its values are {listed}"
        self._refuse(node, f"{column} is never {text!r}{some}", hint)

    def _check_quotes(self, column: ast.expr, word: ast.expr) -> None:
        """Refuse a word without quotes that is compared with a column of texts or times."""
        if not isinstance(column, ast.Name) or not isinstance(word, ast.Name):
            return
        key = respelled("column", column.id)
        kind = KIND_OF_TYPE.get(self._column_types.get(key, ""))
        there = self._column_types.get(respelled("column", word.id))
        if kind == "number" and there is None and f"{key}_name" in self._column_types:
            self._check_number_name(key, word)
        if kind not in ("text", "time") or (there is not None and KIND_OF_TYPE[there] == kind):
            return
        if word.id.lower() in ("none", "null", "nil"):
            return
        known = closed_set(key)
        meant = respelled(VOCABULARIES[key], word.id) if key in VOCABULARIES else word.id
        if known and meant not in known:
            meant = nearest_value(key, meant) or known[0]
        self._refuse(word, f"a text is in quotes: write {meant!r}, not {word.id}")

    def _check_number_name(self, column: str, word: ast.Name) -> None:
        """Refuse the name of a function or exception where its number stands."""
        if instead_of_column(word.id, self._table) is None:
            example = word.id.replace("_", " ").title()
            self._refuse(
                word,
                f"{column} is a number; write its name as `{example!r} in {column}_name`",
            )

    def _note_number(self, node: ast.expr) -> None:
        """Note a decimal number such as 40001, which is a wire address without its quotes.

        Refused where there is no such wire address. In hex it is surely meant as it is written.
        """
        digits = ast.get_source_segment(self._text, node) or ""
        address = addresses.parse(digits) if digits.isdecimal() else None
        if address is None:
            return
        kind = address.register_type.replace("_", " ")
        meant = f"{kind} {digits} of a manual is {digits!r} in quotes, wire address {address.wire}"
        if int(digits) > addresses.LAST_ADDRESS:
            self._refuse(node, f"wire addresses end at {addresses.LAST_ADDRESS}; {meant}")
        self.notes.append(f"{digits} is taken as a wire address, counted from 0; {meant}")

    def _advice(self, a: Term, b: Term) -> str:
        """What to write instead of comparing `a`, a number, with `b`, a text; often empty."""
        if a.tree[0] != "col":
            return "; write times in quotes" if (a.kind, b.kind) == ("number", "time") else ""
        if b.tree[0] != "text":
            return ""
        name = f"{a.tree[1]}_name"
        if b.tree[1].strip().isdecimal():
            return f"; write {b.tree[1].strip()} without quotes"
        return f"; names are in {name}" if name in self._column_types else ""

    def _refuse_name(self, node: ast.Name) -> NoReturn:
        """Refuse a name that no column has, with what may be meant."""
        message = f"{self._table} have no column {node.id!r}"
        found = column_of_word(node.id, self._table)
        if found is not None:
            column, word = found
            whole = f"{word!r} in findings" if column == "findings" else f"{column} == {word!r}"
            self._refuse(node, f"{message}; write `{whole}`")
        instead = instead_of_column(node.id, self._table)
        if instead is not None:
            self._refuse(node, f"{message}; write {instead}")
        words = [word for column in self._column_types for word in closed_set(column)]
        self._refuse(node, message, similar_name(node.id, [*words, *self._column_types]))

    def _refuse_call(self, node: ast.Call) -> NoReturn:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        instead = {
            "len": "; write `quantity > 3`",
            "range": "; write `1 <= unit < 5`",
        }.get(name, "" if name else "; a part of a text is asked by `'Read' in function_name`")
        self._refuse(node, f"the only functions are touches(hr, 107) and writes(hr, 107){instead}")

    def _refuse_bit_operator(self, node: ast.BinOp) -> NoReturn:
        word, sign = ("and", "&") if isinstance(node.op, ast.BitAnd) else ("or", "|")
        self._refuse(node, f"join conditions by `{word}`, not by `{sign}`")

    def _describe(self, term: Term) -> str:
        if term.tree[0] == "col":
            return f"{term.tree[1]} ({KIND_NAMES[term.kind]})"
        return KIND_NAMES[term.kind]

    def _offset_of(self, node: ast.expr) -> int:
        line = self._text.encode().split(b"\n")[node.lineno - 1]
        return len(line[: node.col_offset].decode(errors="replace"))

    def _refuse(self, node: ast.expr, message: str, hint: str | None = None) -> NoReturn:
        raise FilterError(message, text=self._text, column=self._offset_of(node), hint=hint)
