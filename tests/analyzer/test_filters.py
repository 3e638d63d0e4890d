"""The filter language: syntax, meaning, and error messages."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import _modlens
from analyzer import FilterError, UsageError, filters
from analyzer.filters import Tree

UNIT: Tree = ["col", "unit"]
ADDRESS: Tree = ["col", "address"]
HOLDING: Tree = ["cmp", "==", ["col", "register_type"], ["text", "holding_register"]]

MEANINGS: list[tuple[str, Tree]] = [
    ("unit == 1", ["cmp", "==", UNIT, ["num", 1]]),
    ("1 != unit", ["cmp", "!=", ["num", 1], UNIT]),
    ("unit < -1.5", ["cmp", "<", UNIT, ["num", -1.5]]),
    (
        "0 < unit <= 9",
        ["and", ["cmp", "<", ["num", 0], UNIT], ["cmp", "<=", UNIT, ["num", 9]]],
    ),
    ("not unit == 1", ["not", ["cmp", "==", UNIT, ["num", 1]]]),
    ("unit in (1, 2)", ["in", UNIT, ["list", [["num", 1], ["num", 2]]]]),
    (
        "unit not in [1]",
        ["and", ["not", ["is_none", UNIT]], ["not", ["in", UNIT, ["list", [["num", 1]]]]]],
    ),
    ("'retry' in findings", ["in", ["text", "retry"], ["col", "findings"]]),
    ("5 in data", ["in", ["num", 5], ["col", "data"]]),
    ("'Read' in function_name", ["in", ["text", "Read"], ["col", "function_name"]]),
    ("exception is None", ["is_none", ["col", "exception"]]),
    ("exception is not None", ["not", ["is_none", ["col", "exception"]]]),
    ("fields is None", ["is_none", ["col", "fields"]]),
    (
        "function & 1 == 1",
        ["cmp", "==", ["arith", "&", ["col", "function"], ["num", 1]], ["num", 1]],
    ),
    (
        "-unit + 2 * 3 > unit // 2",
        [
            "cmp",
            ">",
            ["arith", "+", ["neg", UNIT], ["arith", "*", ["num", 2], ["num", 3]]],
            ["arith", "//", UNIT, ["num", 2]],
        ],
    ),
    (
        "request_hex in ('01 03', 'AB')",
        ["in", ["col", "request_hex"], ["list", [["text", "0103"], ["text", "ab"]]]],
    ),
    ("address == '40108'", ["and", ["cmp", "==", ADDRESS, ["num", 107]], HOLDING]),
    ("address == '400108'", ["and", ["cmp", "==", ADDRESS, ["num", 107]], HOLDING]),
    ("'4x006B' <= address", ["and", ["cmp", "<=", ["num", 107], ADDRESS], HOLDING]),
    (
        "address != '40108'",
        [
            "and",
            ["not", ["is_none", ADDRESS]],
            [
                "or",
                ["cmp", "!=", ADDRESS, ["num", 107]],
                ["cmp", "!=", ["col", "register_type"], ["text", "holding_register"]],
            ],
        ],
    ),
    (
        "address in ('40108', 5)",
        [
            "or",
            ["and", ["cmp", "==", ADDRESS, ["num", 107]], HOLDING],
            ["cmp", "==", ADDRESS, ["num", 5]],
        ],
    ),
    ("touches(hr, 107)", ["touches", "holding_register", 107, 107]),
    ("touches(coil, range(0, 65536))", ["touches", "coil", 0, 65535]),
    ("writes(holding_register, '40108')", ["writes", "holding_register", 107, 107]),
    ("writes('ir', range('30001', 10))", ["writes", "input_register", 0, 9]),
    (
        "time >= '2023-10-11T14:00:00.5+02:00'",
        ["cmp", ">=", ["col", "time"], ["time", 1697025600500000000]],
    ),
    ("request_hex == '01 03 AB'", ["cmp", "==", ["col", "request_hex"], ["text", "0103ab"]]),
]

MISTAKES = [
    ("untis == 3", "transactions have no column 'untis' (column 1 of", "did you mean 'unit'?"),
    ("unit == 'a'", "unit (a number) cannot be compared with a text (column 9 of", ""),
    ("unit", "a number is not a condition", "column 1 of"),
    ("1", "a number is not a condition", ""),
    ("unit == None", "`is None`", "column 9 of"),
    ("unit is 1", "use `==`", ""),
    ("unit ==", "not an expression", ""),
    ("unit = 1", "write `==` to compare, not `=`", "column 6 of"),
    ("", "an empty filter", ""),
    ("__import__('os')", "the only functions are touches", ""),
    ("unit.__class__ == 1", "not part of the filter language", ""),
    ("unit[0] == 1", "not part of the filter language", ""),
    ("[u for u in data] == 1", "not part of the filter language", ""),
    ("(lambda: 1) == 1", "not part of the filter language", ""),
    ("unit ** 9 == 1", "not part of the filter language", ""),
    ("f'{unit}' == 'a'", "not part of the filter language", ""),
    ("unit == b'a'", "a literal is a number or a text", ""),
    ("unit == 1e999", "too large", ""),
    ("unit == 99999999999999999999", "more than 64 bits", ""),
    ("fields == 'a'", "fields (a map) cannot be compared", ""),
    ("data == 1", "cannot be compared; use `in`", ""),
    ("'a' in data", "data (a list of numbers) holds numbers, not a text", ""),
    ("1 in unit", "unit (a number) has no items", ""),
    ("1 in (unit, 2)", "a list holds numbers and texts", ""),
    ("'a' + 'b' == 'ab'", "a text is not a number", ""),
    ("address == '40000'", "not an address", "column 12 of"),
    ("address == 'forty'", "not an address", ""),
    ("time > 'noon'", "not a time", ""),
    ("time > 5", "cannot be compared", ""),
    ("time in ()", "an empty list", ""),
    ("unit in []", "an empty list", ""),
    ("touches(hr)", "takes a register type and an address", ""),
    ("touches(xx, 1)", "one of co, di, ir, hr", ""),
    ("touches(hr, 65536)", "0 to 65535", ""),
    ("touches(hr, True)", "0 to 65535", ""),
    ("touches(hr, range(5))", "range(first, last + 1)", ""),
    ("touches(hr, range(5, 5))", "an empty range", ""),
    ("touches(hr, '30001')", "an address of a input_register", ""),
    ("not " * 100 + "unit == 1", "more than 60 levels", ""),
    (" + ".join(["unit"] * 200) + " == 1", "more than 60 levels", ""),
    ("(" * 5000 + "1" + ")" * 5000, "at most 4096 characters", ""),
    ("(" * 1000 + "1" + ")" * 1000, "not an expression", ""),
    ("unit == 1\0", "not an expression", ""),
]


@pytest.mark.parametrize(("text", "tree"), MEANINGS)
def test_an_expression_is_this_tree(text: str, tree: Tree) -> None:
    """Every node of the language, as the core gets it."""
    assert filters.parse(text).tree == tree


@pytest.mark.parametrize(("text", "tree"), MEANINGS)
def test_a_filter_says_itself_back(text: str, tree: Tree) -> None:
    """`str()` of a filter means the same, and does not change any more."""
    said = str(filters.parse(text))
    assert filters.parse(said).tree == tree
    assert str(filters.parse(said)) == said


@pytest.mark.parametrize(("text", "tree"), MEANINGS)
def test_the_core_takes_the_tree(text: str, tree: Tree) -> None:
    """Nothing of the language is unknown to the core."""
    assert isinstance(_modlens.Predicate("transactions", json.dumps(tree)), _modlens.Predicate)


@pytest.mark.parametrize(("text", "message", "more"), MISTAKES)
def test_a_mistake_is_reported(text: str, message: str, more: str) -> None:
    """What is wrong, where, and what may be meant; on one line."""
    with pytest.raises(FilterError) as caught:
        filters.parse(text)
    assert message in str(caught.value)
    assert more in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_column_counts_characters_not_bytes() -> None:
    """Letters outside of ASCII take one column each."""
    with pytest.raises(FilterError) as caught:
        filters.parse("'äöü' in function_name and nope == 1")
    assert caught.value.column == len("'äöü' in function_name and ")


def test_other_tables_have_other_columns() -> None:
    """Frames have a verdict and no address; a table that does not exist is wrong use."""
    assert filters.parse("unconfirmed", "frames").tree == [
        "cmp", "==", ["col", "unconfirmed"], ["num", 1],
    ]  # fmt: skip
    with pytest.raises(FilterError, match=r"writes\(\) needs registers, which frames do not"):
        filters.parse("writes(hr, 1)", "frames")
    with pytest.raises(UsageError, match="the tables are"):
        filters.parse("unit == 1", "frame")


def test_a_long_or_is_no_deep_tree() -> None:
    """Hundreds of terms stay within what a reader of JSON nests."""
    tree = filters.parse(" or ".join(f"unit == {unit}" for unit in range(240))).tree

    def depth(node: object) -> int:
        return 1 + max(map(depth, node), default=0) if isinstance(node, list) else 0

    assert depth(tree) < 16
    _modlens.Predicate("transactions", json.dumps(tree))


@given(st.text(max_size=60))
def test_any_text_is_a_filter_or_a_filter_error(text: str) -> None:
    """Any text is parsed, or raises `FilterError` and nothing else."""
    try:
        found = filters.parse(text)
    except FilterError:
        return
    assert filters.parse(str(found)).tree == found.tree


NAMES = st.sampled_from(["unit", "address", "response_time_us", "data", "time", "'a'", "1", "None"])
OPERATORS = st.sampled_from(["==", "<", "in", "not in", "is", "+", "and", "or", "&", "//"])


@given(st.lists(st.tuples(NAMES, OPERATORS), min_size=1, max_size=8), NAMES)
def test_any_expression_is_a_filter_or_a_filter_error(
    parts: list[tuple[str, str]], last: str
) -> None:
    """Expressions that parse, with and without sense; what compiles, the core takes."""
    text = " ".join(f"{name} {operator}" for name, operator in parts) + f" {last}"
    try:
        found = filters.parse(text)
    except FilterError:
        return
    assert filters.parse(str(found)).tree == found.tree
    found.predicate()
