"""Compiles Python's syntax tree of a filter into the filter tree of filters.py.

Only the nodes that a method below handles are allowed; everything else is refused. A comparison
that can never be true (a number with a text) is an error, not a filter that selects nothing.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any, NoReturn

from analyzer import addresses
from analyzer.times import parse_ns
from dissectors.errors import FilterError
from dissectors.function_lookup import similar_name
from dissectors.vocabulary import Vocabulary, respelled

__all__ = ["Compiler", "Tree"]

Tree = list[Any]
"""A node of the filter tree: nested JSON lists."""

# The number of arguments of touches(), writes() and range().
ARGUMENTS = 2
# The deepest nesting of a filter.
MAX_DEPTH = 60

_KIND_OF_TYPE = {
    "int": "number",
    "us": "number",
    "float": "number",
    "bool": "flag",
    "time": "time",
    "text": "text",
    "hex": "text",
    "ints": "numbers",
    "texts": "texts",
    "map": "map",
}
_KIND_NAMES = {
    "number": "a number",
    "flag": "true or false",
    "time": "a time",
    "text": "a text",
    "numbers": "a list of numbers",
    "texts": "a list of texts",
    "map": "a map",
    "list": "a list",
    "none": "None",
}
_COMPARISON_OPERATORS: dict[type[ast.cmpop], str] = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}
_ARITHMETIC_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "//",
    ast.Mod: "%",
    ast.BitAnd: "&",
}


_VOCABULARIES: dict[str, Vocabulary] = {
    "status": "status",
    "findings": "finding",
    "code": "finding",
}
"""Columns whose words may be given in their former spelling."""

_ADDRESS_COLUMNS: list[Tree] = [["col", "address"], ["col", "write_address"]]


@dataclass(frozen=True, slots=True)
class _Term:
    """A value in a filter: its kind (a key of `_KIND_NAMES`), its filter tree, its syntax node."""

    kind: str
    tree: Tree
    node: ast.expr


class Compiler:
    """Compiles one filter text for the rows of `table`.

    `column_types` maps the table's columns to their types. All methods raise `FilterError`, which
    names the column of the text.
    """

    def __init__(self, text: str, table: str, column_types: Mapping[str, str]) -> None:
        self._text = text
        self._table = table
        self._column_types = column_types
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
            return _join(word, [self.condition(value) for value in node.values])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return ["not", self.condition(node.operand)]
        if isinstance(node, ast.Compare):
            return self._comparisons(node)
        if isinstance(node, ast.Call):
            return self._function_call(node)
        term = self._term(node)
        if term.kind == "flag":
            return ["cmp", "==", term.tree, ["num", 1]]
        self._refuse(
            node, f"{_KIND_NAMES[term.kind]} is not a condition; compare it, as in `unit == 1`"
        )

    def _comparisons(self, node: ast.Compare) -> Tree:
        parts = []
        left = node.left
        for operator, right in zip(node.ops, node.comparators, strict=True):
            parts.append(self._comparison(left, operator, right))
            left = right
        return _join("and", parts)

    def _comparison(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> Tree:
        """The tree of one comparison; `in` and `not in` are tests for membership."""
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
        return self._compare(_COMPARISON_OPERATORS[type(operator)], a, b)

    def _is_none(self, left: ast.expr, operator: ast.cmpop, right: ast.expr) -> Tree:
        if self._term(right).kind != "none":
            self._refuse(right, "`is` works only with None; use `==`")
        tree = ["is_none", self._term(left).tree]
        return tree if isinstance(operator, ast.Is) else ["not", tree]

    def _compare(self, operator: str, a: _Term, b: _Term) -> Tree:
        """The tree of a comparison by one of `== != < <= > >=`.

        An address column compared with an address literal becomes a comparison of wire address and
        register type; a time column makes a text a moment.
        """
        for one, other in ((a, b), (b, a)):
            address = self._address(one, other)
            if address is not None:
                return _at_address(operator, one.tree, address, turned=one is b)
        a, b = self._as_time(a, b), self._as_time(b, a)
        for term in (a, b):
            if term.kind not in ("number", "flag", "text", "time"):
                self._refuse(term.node, f"{self._describe(term)} cannot be compared; use `in`")
        if a.kind.replace("flag", "number") != b.kind.replace("flag", "number"):
            self._refuse(b.node, f"{self._describe(a)} cannot be compared with {self._describe(b)}")
        return [
            "cmp",
            operator,
            _column_spelling(a, b, self._column_types),
            _column_spelling(b, a, self._column_types),
        ]

    def _membership(self, item: _Term, where: _Term) -> Tree:
        """The tree of `item in where`.

        A list of items of the same kind stays a list; otherwise it becomes comparisons joined by
        `or`, so that literals such as '40108' are compared as addresses.
        """
        if where.kind == "list":
            choices = [_Term(kind, tree, where.node) for kind, tree in where.tree[1]]
            if not choices:
                self._refuse(where.node, "an empty list")
            if {choice.kind for choice in choices} == {item.kind}:
                same = [_column_spelling(choice, item, self._column_types) for choice in choices]
                return ["in", item.tree, ["list", same]]
            return _join("or", [self._compare("==", item, choice) for choice in choices])
        wanted = {"numbers": "number", "texts": "text", "text": "text"}.get(where.kind)
        if wanted is None:
            self._refuse(where.node, f"{self._describe(where)} has no items for `in`")
        if item.kind != wanted:
            holds = f"{self._describe(where)} holds {_KIND_NAMES[wanted][2:]}s"
            self._refuse(item.node, f"{holds}, not {self._describe(item)}")
        return ["in", _column_spelling(item, where, self._column_types), where.tree]

    def _function_call(self, node: ast.Call) -> Tree:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in ("touches", "writes"):
            self._refuse(node, "the only functions are touches(hr, 107) and writes(hr, 107)")
        if "address" not in self._column_types:
            self._refuse(node, f"{name}() needs registers, which {self._table} do not have")
        if len(node.args) != ARGUMENTS or node.keywords:
            self._refuse(node, f"{name}() takes a register type and an address: {name}(hr, 107)")
        kind = self._register_type(node.args[0])
        first, last = self._span(node.args[1], kind)
        return [name, kind, first, last]

    def _register_type(self, node: ast.expr) -> str:
        word = node.id if isinstance(node, ast.Name) else _constant(node)
        kind = addresses.register_type(word) if isinstance(word, str) else None
        if kind is None:
            self._refuse(node, "a register type is one of co, di, ir, hr")
        return kind

    def _span(self, node: ast.expr, kind: str) -> tuple[int, int]:
        """First and last wire address of the second argument of touches() and writes()."""
        if isinstance(node, ast.Call):
            named_range = isinstance(node.func, ast.Name) and node.func.id == "range"
            if not named_range or len(node.args) != ARGUMENTS or node.keywords:
                self._refuse(node, "a range is range(first, last + 1)")
            first = self._wire(node.args[0], kind)
            behind = self._wire(node.args[1], kind, top=0x10000)
            if behind <= first:
                self._refuse(node, "an empty range; write range(first, last + 1)")
            return first, behind - 1
        wire = self._wire(node, kind)
        return wire, wire

    def _wire(self, node: ast.expr, kind: str, top: int = 0xFFFF) -> int:
        """A wire address from a number, or from text such as '40108' of this register type.

        `top` is the highest number allowed.
        """
        value = _constant(node)
        if isinstance(value, str):
            address = addresses.parse(value)
            if address is None:
                self._refuse(node, f"{value!r} is not an address; write 107, '40108' or '4x006B'")
            if address.register_type != kind:
                self._refuse(node, f"{value!r} is an address of a {address.register_type}")
            return address.wire
        if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= top:
            self._refuse(node, "an address is a number from 0 to 65535, or text such as '40108'")
        return value

    def _term(self, node: ast.expr) -> _Term:
        self._descend(node)
        term = self._value(node)
        self._depth -= 1
        return term

    def _value(self, node: ast.expr) -> _Term:
        """The value of a syntax node: a column, a literal, a list, arithmetic."""
        if isinstance(node, ast.Name):
            return self._column(node)
        if isinstance(node, ast.Constant):
            return self._literal(node)
        if isinstance(node, ast.List | ast.Tuple):
            items = [self._literal_item(item) for item in node.elts]
            return _Term("list", ["list", items], node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            operand = self._number(node.operand)
            if operand.tree[0] == "num":
                return _Term("number", ["num", -operand.tree[1]], node)
            return _Term("number", ["neg", operand.tree], node)
        if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC_OPERATORS:
            a, b = self._number(node.left), self._number(node.right)
            return _Term(
                "number", ["arith", _ARITHMETIC_OPERATORS[type(node.op)], a.tree, b.tree], node
            )
        self._refuse(node, "not part of the filter language")

    def _number(self, node: ast.expr) -> _Term:
        term = self._term(node)
        if term.kind in ("number", "flag"):
            return term
        self._refuse(node, f"{self._describe(term)} is not a number")

    def _column(self, node: ast.Name) -> _Term:
        key = respelled("column", node.id)
        if key not in self._column_types:
            raise FilterError(
                f"{self._table} have no column {node.id!r}",
                text=self._text,
                column=self._offset_of(node),
                hint=similar_name(node.id, list(self._column_types)),
            )
        return _Term(_KIND_OF_TYPE[self._column_types[key]], ["col", key], node)

    def _literal(self, node: ast.Constant) -> _Term:
        """The value of a constant; the core takes integers of 64 bits and finite floats."""
        value = node.value
        if value is None:
            return _Term("none", ["none"], node)
        if isinstance(value, bool):
            return _Term("number", ["num", int(value)], node)
        if isinstance(value, int) and not -(2**63) <= value < 2**63:
            self._refuse(node, "a number of more than 64 bits")
        if isinstance(value, float) and not isfinite(value):
            self._refuse(node, "a number that is too large")
        if isinstance(value, int | float):
            return _Term("number", ["num", value], node)
        if isinstance(value, str):
            return _Term("text", ["text", value], node)
        self._refuse(node, "a literal is a number or a text")

    def _literal_item(self, node: ast.expr) -> tuple[str, Tree]:
        term = self._term(node)
        if term.tree[0] not in ("num", "text"):
            self._refuse(node, "a list holds numbers and texts")
        return term.kind, term.tree

    def _address(self, column: _Term, literal: _Term) -> addresses.Address | None:
        if column.tree not in _ADDRESS_COLUMNS or literal.kind != "text":
            return None
        address = addresses.parse(literal.tree[1]) if literal.tree[0] == "text" else None
        if address is None:
            self._refuse(literal.node, "not an address; write 107, '40108', '400108' or '4x006B'")
        return address

    def _as_time(self, term: _Term, other: _Term) -> _Term:
        if other.kind != "time" or term.tree[0] != "text":
            return term
        moment = parse_ns(term.tree[1])
        if moment is None:
            self._refuse(term.node, "not a time; write '2023-10-11T14:00:00Z'")
        return _Term("time", ["time", moment], term.node)

    def _descend(self, node: ast.expr) -> None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._refuse(node, f"nested more than {MAX_DEPTH} levels deep")

    def _describe(self, term: _Term) -> str:
        if term.tree[0] == "col":
            return f"{term.tree[1]} ({_KIND_NAMES[term.kind]})"
        return _KIND_NAMES[term.kind]

    def _offset_of(self, node: ast.expr) -> int:
        line = self._text.encode().split(b"\n")[node.lineno - 1]
        return len(line[: node.col_offset].decode(errors="replace"))

    def _refuse(self, node: ast.expr, message: str) -> NoReturn:
        raise FilterError(message, text=self._text, column=self._offset_of(node))


def _join(word: str, parts: list[Tree]) -> Tree:
    """Join conditions pairwise by `and` or `or`, into a balanced tree.

    A chain of a thousand conditions would otherwise be a thousand levels deep.
    """
    if len(parts) == 1:
        return parts[0]
    middle = (len(parts) + 1) // 2
    return [word, _join(word, parts[:middle]), _join(word, parts[middle:])]


def _constant(node: ast.expr) -> object:
    return node.value if isinstance(node, ast.Constant) else None


def _at_address(operator: str, column: Tree, address: addresses.Address, *, turned: bool) -> Tree:
    """The condition for `address == '40108'`: wire address 107, and register type holding register.

    `turned` is True where the literal is on the left side.
    """
    value, kind = ["num", address.wire], ["text", address.register_type]
    pair = [value, column] if turned else [column, value]
    where = ["cmp", operator, *pair]
    if operator == "!=":
        other = ["or", where, ["cmp", "!=", ["col", "register_type"], kind]]
        return ["and", ["not", ["is_none", column]], other]
    return ["and", where, ["cmp", "==", ["col", "register_type"], kind]]


def _column_spelling(term: _Term, other: _Term, column_types: Mapping[str, str]) -> Tree:
    """A text that is compared with a column, as the column spells it.

    Bytes in lower-case hex, and statuses and findings in their current spelling.
    """
    if term.tree[0] != "text" or other.tree[0] != "col":
        return term.tree
    column, text = other.tree[1], term.tree[1]
    if column_types[column] == "hex":
        return ["text", "".join(text.split()).lower()]
    if column in _VOCABULARIES:
        return ["text", respelled(_VOCABULARIES[column], text)]
    return term.tree
