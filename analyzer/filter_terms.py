"""The terms of a filter while it is compiled, and the blocks of trees that need no syntax."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from typing import Any

from analyzer import addresses
from analyzer.times import DAY_NS

__all__ = [
    "ARITHMETIC_OPERATORS",
    "COMPARISON_OPERATORS",
    "KIND_NAMES",
    "KIND_OF_TYPE",
    "Term",
    "Tree",
    "at_address",
    "at_time_of_day",
    "constant",
    "join",
]

Tree = list[Any]
"""A node of the filter tree: nested JSON lists."""

KIND_OF_TYPE = {
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
KIND_NAMES = {
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
COMPARISON_OPERATORS: dict[type[ast.cmpop], str] = {
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}
ARITHMETIC_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "//",
    ast.Mod: "%",
    ast.BitAnd: "&",
}


@dataclass(frozen=True, slots=True)
class Term:
    """A value in a filter: its kind (a key of `KIND_NAMES`), its filter tree, its syntax node."""

    kind: str
    tree: Tree
    node: ast.expr


def join(word: str, parts: list[Tree]) -> Tree:
    """Join conditions pairwise by `and` or `or`, into a balanced tree.

    A chain of a thousand conditions would otherwise be a thousand levels deep.
    """
    if len(parts) == 1:
        return parts[0]
    middle = (len(parts) + 1) // 2
    return [word, join(word, parts[:middle]), join(word, parts[middle:])]


def constant(node: ast.expr) -> object:
    """The value of a literal; None for every other node."""
    return node.value if isinstance(node, ast.Constant) else None


def at_address(operator: str, column: Tree, address: addresses.Address, *, turned: bool) -> Tree:
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


def at_time_of_day(
    operator: str, column: Tree, wanted_ns: int, offsets: list[tuple[int, int]], *, turned: bool
) -> Tree:
    """The condition for `time >= '12:00:05'`, which holds on every day.

    `offsets` are the offsets of the time's zone, as `utc_offset_changes` gives them. They are
    halved until one is left, so that a zone with summer time costs a few comparisons.
    """
    if len(offsets) == 1:
        shifted = ["arith", "+", column, ["num", offsets[0][1]]]
        pair = [["arith", "%", shifted, ["num", DAY_NS]], ["num", wanted_ns]]
        return ["cmp", operator, *(reversed(pair) if turned else pair)]
    middle = len(offsets) // 2
    change = ["time", offsets[middle][0]]
    before, after = (
        at_time_of_day(operator, column, wanted_ns, part, turned=turned)
        for part in (offsets[:middle], offsets[middle:])
    )
    return [
        "or",
        ["and", ["cmp", "<", column, change], before],
        ["and", ["cmp", ">=", column, change], after],
    ]
