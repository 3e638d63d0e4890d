"""Compiles Python's syntax tree of a filter into the filter tree of filters.py.

Only the nodes that a method below handles are allowed; everything else is refused. A comparison
that can never be true (a number with a text) is an error, not a filter that selects nothing.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from math import isfinite

from analyzer import addresses
from analyzer.filter_registers import RegisterQuestions
from analyzer.filter_terms import (
    ARITHMETIC_OPERATORS,
    COMPARISON_OPERATORS,
    KIND_NAMES,
    KIND_OF_TYPE,
    Term,
    Tree,
    at_address,
    at_time_of_day,
    join,
)
from analyzer.filter_words import (
    closed_set,
    column_of_word,
    instead_of_column,
    operations_of_word,
)
from analyzer.times import parse_ns, parse_time_of_day, utc_offset_changes
from dissectors.texts import respelled
from dissectors.vocabulary import findings

__all__ = ["Compiler", "Tree"]

# The deepest nesting of a filter.
MAX_DEPTH = 60

_ADDRESS_COLUMNS: list[Tree] = [["col", "address"], ["col", "write_address"]]

# Columns that (nearly) every row has a value in: alone they would select everything.
_ALWAYS_THERE = frozenset(
    "unit function bus mode status verdict direction delimited_by confidence byte_offset"
    " byte_length elapsed_us time source hex operation raw value_text code severity detail impact"
    " advice client_port requests answered in_flight_max retransmitted_segments".split()
)
_NUMBERS_OF_ROWS = (
    ("transactions", "txn"),
    ("frames", "frame"),
    ("readings", "txn"),
    ("connections", "connection"),
)


class Compiler(RegisterQuestions):
    """Compiles one filter text for the rows of `table`.

    `column_types` maps the table's columns to their types. All methods raise `FilterError`, which
    names the column of the text.
    """

    def __init__(self, text: str, table: str, column_types: Mapping[str, str]) -> None:
        super().__init__(text, table, column_types)
        self._depth = 0

    def condition(self, node: ast.expr) -> Tree:
        """The filter tree of a condition."""
        self._descend(node)
        tree = self._condition(node)
        self._depth -= 1
        return tree

    def _condition(self, node: ast.expr) -> Tree:
        """The tree of a condition, by the type of its syntax node."""
        if isinstance(node, ast.BoolOp):
            word = "and" if isinstance(node.op, ast.And) else "or"
            return join(word, [self.condition(value) for value in node.values])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return ["not", self.condition(node.operand)]
        if isinstance(node, ast.Compare):
            return self._comparisons(node)
        if isinstance(node, ast.Call):
            return self._function_call(node)
        if isinstance(node, ast.Tuple):
            self._refuse(
                node.elts[-1] if node.elts else node,
                "join conditions by `and` or `or`, not by commas; a list is in brackets, as in"
                " `unit in (1, 2)`",
            )
        if isinstance(node, ast.Name):
            return self._word_alone(node)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd | ast.BitOr):
            self._refuse_bit_operator(node)
        term = self._term(node)
        self._refuse(
            node,
            f"{KIND_NAMES[term.kind]} is not a condition; compare it, as in"
            f" `{self._condition_with(term)}`",
        )

    def _condition_with(self, term: Term) -> str:
        """An example of a condition that a term alone may be meant for."""
        if term.kind != "text":
            return "unit in (1, 2)" if term.tree[0] == "num" else "unit == 1"
        found = column_of_word(str(term.tree[1]), self._table)
        if found is not None and found[0] == "findings":
            return f"{found[1]!r} in findings"
        return "status in ('ok', 'exception')"

    def _word_alone(self, node: ast.Name) -> Tree:
        """The condition that a word alone is: a column that is not empty, a status, a finding."""
        key = respelled("column", node.id)
        if key in self._column_types:
            return self._column_alone(node, key)
        found = column_of_word(node.id, self._table)
        if found is None:
            self._refuse_name(node)
        column, word = found
        if column == "findings":
            return ["in", ["text", word], ["col", column]]
        if column == "operation":
            operations, codes = operations_of_word(word)
            wanted: list[Tree] = [
                ["cmp", "==", ["col", column], ["text", one]] for one in operations
            ]
            wanted += [["cmp", "==", ["col", "function"], ["num", code]] for code in codes]
            return join("or", wanted)
        return ["cmp", "==", ["col", column], ["text", word]]

    def _column_alone(self, node: ast.Name, key: str) -> Tree:
        """The condition that a column alone is; for `findings`, that there is one at least."""
        kind = KIND_OF_TYPE[self._column_types[key]]
        if kind == "flag":
            return ["cmp", "==", ["col", key], ["num", 1]]
        if key == "findings":
            codes = [["in", ["text", one.code], ["col", key]] for one in findings()]
            return join("or", codes)
        if key in _ALWAYS_THERE or (self._table, key) in _NUMBERS_OF_ROWS:
            words = closed_set(key)
            example = f"{key} == {words[-1]!r}" if words else "unit == 1"
            self._refuse(
                node, f"{KIND_NAMES[kind]} is not a condition; compare it, as in `{example}`"
            )
        return ["not", ["is_none", ["col", key]]]

    def _comparisons(self, node: ast.Compare) -> Tree:
        parts = []
        left = node.left
        for between in node.comparators[:-1]:
            # `unit == 1 & function == 3` is the chain `unit == (1 & function) == 3` in Python.
            if isinstance(between, ast.BinOp) and isinstance(between.op, ast.BitAnd | ast.BitOr):
                self._refuse_bit_operator(between)
        for operator, right in zip(node.ops, node.comparators, strict=True):
            parts.append(self._comparison(left, operator, right))
            left = right
        return join("and", parts)

    def _comparison(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> Tree:
        """The tree of one comparison; `in` and `not in` are tests for membership."""
        self._check_quotes(left, right)
        self._check_quotes(right, left)
        if isinstance(operator, ast.Is | ast.IsNot):
            return self._is_none(left, operator, right)
        a, b = self._term(left), self._term(right)
        for term in (a, b):
            if term.kind == "none":
                self._refuse(term.node, "compare with None by `is None` or `is not None`")
        if isinstance(operator, ast.In | ast.NotIn):
            found = self._membership(a, b)
            if isinstance(operator, ast.In):
                return found
            # Comparisons with null are false, `not in` too: it needs an explicit test for null.
            null = b if b.tree[0] == "col" else a
            return ["and", ["not", ["is_none", null.tree]], ["not", found]]
        return self._compare(COMPARISON_OPERATORS[type(operator)], a, b)

    def _is_none(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> Tree:
        if self._term(right).kind != "none":
            self._refuse(right, "`is` works only with None; use `==`")
        tree = ["is_none", self._term(left).tree]
        return tree if isinstance(operator, ast.Is) else ["not", tree]

    def _compare(self, operator: str, a: Term, b: Term) -> Tree:
        """The tree of a comparison by one of `== != < <= > >=`.

        An address column compared with an address literal becomes a comparison of wire address and
        register type; a time column makes a text a moment.
        """
        for one, other in ((a, b), (b, a)):
            self._note_address(one, other)
            address = self._address(one, other)
            if address is not None:
                return at_address(operator, one.tree, address, turned=one is b)
            clock = parse_time_of_day(str(other.tree[1])) if _is_time(one, other) else None
            if clock is not None:
                wanted_ns, zone = clock
                changes = utc_offset_changes("utc" if zone == "Z" else zone)
                return at_time_of_day(operator, one.tree, wanted_ns, changes, turned=one is b)
        a, b = self._as_time(a, b), self._as_time(b, a)
        for term in (a, b):
            if term.kind not in ("number", "flag", "text", "time"):
                self._refuse(term.node, f"{self._describe(term)} cannot be compared; use `in`")
        if a.kind.replace("flag", "number") != b.kind.replace("flag", "number"):
            advice = self._advice(a, b) or self._advice(b, a)
            self._refuse(
                b.node,
                f"{self._describe(a)} cannot be compared with {self._describe(b)}{advice}",
            )
        return [
            "cmp",
            operator,
            self._spelling(a, b),
            self._spelling(b, a),
        ]

    def _membership(self, item: Term, where: Term) -> Tree:
        """The tree of `item in where`.

        A list of items of the same kind stays a list; otherwise it becomes comparisons joined by
        `or`, so that literals such as '40108' are compared as addresses.
        """
        if where.kind == "list":
            items = where.node.elts if isinstance(where.node, ast.List | ast.Tuple) else []
            choices = [
                Term(kind, tree, node)
                for (kind, tree), node in zip(where.tree[1], items, strict=True)
            ]
            if not choices:
                self._refuse(where.node, "an empty list")
            for choice in choices:
                self._note_address(item, choice)
            if {choice.kind for choice in choices} == {item.kind}:
                same = [self._spelling(choice, item) for choice in choices]
                return ["in", item.tree, ["list", same]]
            return join("or", [self._compare("==", item, choice) for choice in choices])
        wanted = {"numbers": "number", "texts": "text", "text": "text"}.get(where.kind)
        if wanted is None:
            advice = (
                "; write `unit in (1, 2)` or `1 <= unit <= 5`" if where.kind == "number" else ""
            )
            self._refuse(where.node, f"{self._describe(where)} has no items for `in`{advice}")
        if item.kind != wanted:
            holds = f"{self._describe(where)} holds {KIND_NAMES[wanted][2:]}s"
            self._refuse(item.node, f"{holds}, not {self._describe(item)}")
        is_part = where.kind == "text"
        return ["in", self._spelling(item, where, part=is_part), where.tree]

    def _term(self, node: ast.expr) -> Term:
        self._descend(node)
        term = self._value(node)
        self._depth -= 1
        return term

    def _value(self, node: ast.expr) -> Term:
        """The value of a syntax node: a column, a literal, a list, arithmetic."""
        if isinstance(node, ast.Name):
            return self._column(node)
        if isinstance(node, ast.Constant):
            return self._literal(node)
        if isinstance(node, ast.List | ast.Tuple):
            items = [self._literal_item(item) for item in node.elts]
            return Term("list", ["list", items], node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            operand = self._number(node.operand)
            if operand.tree[0] == "num":
                return Term("number", ["num", -operand.tree[1]], node)
            return Term("number", ["neg", operand.tree], node)
        if isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC_OPERATORS:
            a, b = self._number(node.left), self._number(node.right)
            return Term(
                "number", ["arith", ARITHMETIC_OPERATORS[type(node.op)], a.tree, b.tree], node
            )
        if isinstance(node, ast.Call):
            self._refuse_call(node)
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
            self._refuse_bit_operator(node)
        if isinstance(node, ast.Subscript):
            self._refuse(node, "not part of the filter language; an item is asked by `5 in data`")
        if isinstance(node, ast.Attribute):
            advice = instead_of_column(node.attr, self._table)
            there = "" if advice is None else f"; write {advice}"
            self._refuse(node, f"not part of the filter language{there}")
        self._refuse(node, "not part of the filter language")

    def _number(self, node: ast.expr) -> Term:
        if isinstance(node, ast.Compare | ast.BoolOp):
            self._refuse(node, "a condition is not a number; join conditions by `and` or `or`")
        term = self._term(node)
        if term.kind in ("number", "flag"):
            return term
        self._refuse(node, f"{self._describe(term)} is not a number")

    def _column(self, node: ast.Name) -> Term:
        key = respelled("column", node.id)
        if key not in self._column_types:
            self._refuse_name(node)
        return Term(KIND_OF_TYPE[self._column_types[key]], ["col", key], node)

    def _literal(self, node: ast.Constant) -> Term:
        """The value of a constant; the core takes integers of 64 bits and finite floats."""
        value = node.value
        if value is None:
            return Term("none", ["none"], node)
        if isinstance(value, bool):
            return Term("number", ["num", int(value)], node)
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            self._refuse(node, "a number of more than 64 bits")
        if isinstance(value, float) and not isfinite(value):
            self._refuse(node, "a number that is too large")
        if isinstance(value, int | float):
            return Term("number", ["num", value], node)
        if isinstance(value, str):
            return Term("text", ["text", value], node)
        self._refuse(node, "a literal is a number or a text")

    def _literal_item(self, node: ast.expr) -> tuple[str, Tree]:
        term = self._term(node)
        if term.tree[0] not in ("num", "text"):
            self._refuse(node, "a list holds numbers and texts")
        return term.kind, term.tree

    def _address(self, column: Term, literal: Term) -> addresses.Address | None:
        if column.tree not in _ADDRESS_COLUMNS or literal.kind != "text":
            return None
        address = addresses.parse(literal.tree[1]) if literal.tree[0] == "text" else None
        if address is None:
            self._refuse(literal.node, "not an address; write 107, '40108', '400108' or '4x006B'")
        return address

    def _note_address(self, column: Term, literal: Term) -> None:
        """Note a number that is written like the number of a register in a handbook."""
        if column.tree in _ADDRESS_COLUMNS and literal.tree[0] == "num":
            self._note_number(literal.node)

    def _as_time(self, term: Term, other: Term) -> Term:
        if other.kind != "time" or term.tree[0] != "text":
            return term
        moment = parse_ns(term.tree[1])
        if moment is None:
            self._refuse(term.node, "not a time; write '2023-10-11T14:00:00Z' or '14:00:00'")
        return Term("time", ["time", moment], term.node)

    def _spelling(self, term: Term, other: Term, *, part: bool = False) -> Tree:
        """A text that is compared with a column, as the column spells it.

        Bytes in lower-case hex, and statuses and findings in their current spelling. A word that
        the column never has is refused.
        """
        if term.tree[0] != "text" or other.tree[0] != "col":
            return term.tree
        column, text = other.tree[1], term.tree[1]
        if self._column_types[column] == "hex":
            return ["text", "".join(text.split()).lower()]
        return ["text", self._known_value(column, text, term.node, part=part)]

    def _descend(self, node: ast.expr) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._refuse(node, f"nested more than {MAX_DEPTH} levels deep")


def _is_time(column: Term, literal: Term) -> bool:
    return column.kind == "time" and column.tree[0] == "col" and literal.tree[0] == "text"
