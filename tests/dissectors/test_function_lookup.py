"""What people call a function."""

from __future__ import annotations

import pytest

import _modlens
from dissectors.errors import UsageError
from dissectors.function_lookup import (
    FunctionChoice,
    find_function,
    function_names,
    parse_number,
    similar_name,
)


@pytest.mark.parametrize(
    "word",
    [3, "3", "0x03", "03h", "fc3", "FC 3", "function 3", "function code 0x3",
     "Read Holding Registers", "read_holding_registers", "READ-HOLDING-REGISTERS"],
)  # fmt: skip
def test_one_function_has_many_names(word: int | str) -> None:
    """Codes in any base, names in any case and with any punctuation."""
    assert find_function(word) == FunctionChoice(3)


def test_sub_functions_have_names_too() -> None:
    """A name that says more than the code sets the leading field."""
    assert find_function("Force Listen Only Mode") == FunctionChoice(8, {"sub_function": 4})
    assert find_function("return bus message count") == FunctionChoice(8, {"sub_function": 11})
    assert find_function("Diagnostics") == FunctionChoice(8)
    assert find_function("CANopen General Reference") == FunctionChoice(43, {"mei_type": 13})


def test_vendors_names_come_with_their_rows() -> None:
    """Vendors' names are unknown until their rows are loaded."""
    table = _modlens.Functions()
    table.load_vendor("huawei")
    assert find_function("Login Challenge", source=table) == FunctionChoice(
        0x41, {"sub_function": 0x24}
    )
    with pytest.raises(UsageError):
        find_function("Login Challenge")


@pytest.mark.parametrize("word", [0, 128, "0x83", "fc 200"])
def test_codes_have_a_range(word: int | str) -> None:
    """Codes are 1 to 127; the next bit marks exception responses."""
    with pytest.raises(UsageError, match="from 1 to 127"):
        find_function(word)


def test_wrong_names_get_a_hint() -> None:
    """A wrong name is reported with a similar one, if there is one."""
    with pytest.raises(UsageError, match="did you mean 'Read Input Registers'"):
        find_function("read input register")
    with pytest.raises(UsageError, match="explain"):
        find_function("xyzzy")
    assert similar_name("zzz", function_names()) is None


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("107", 107),
        ("0x6B", 107),
        ("6bh", 107),
        ("1_000", 1000),
        ("six", None),
        ("", None),
        ("-1", None),
    ],
)
def test_numbers(text: str, value: int | None) -> None:
    """Numbers are decimal, 0x6B, or 6Bh."""
    assert parse_number(text) == value
