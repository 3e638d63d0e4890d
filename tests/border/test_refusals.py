"""What the core refuses in a user's table, and that it says what would be right."""

from __future__ import annotations

import pytest

import _modlens

GOOD = """
format = 1

[[function]]
code = 0x46
name = "Own Function"
section = "vendor"
summary = "does something"
request = ["first:u16", "rest:bytes"]
response = ["first:u16"]
example = { request = "46 0001 02", response = "46 0001" }
"""

WORDS = ("u8", "u16", "len8", "len16", "count8", "count16", "bits", "u8[]", "u16[]", "bytes")


def test_a_good_row_is_taken() -> None:
    """A user's row decodes and encodes like the embedded ones."""
    functions = _modlens.Functions()
    functions.load(GOOD, "own.toml")
    assert functions.encode(0x46, "request", '{"first": 1, "rest": "02"}').hex() == "46000102"


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ('"first:u16", "rest:bytes"', '"first:u24", "rest:bytes"', WORDS),
        ("summary =", "sumary =", ("sumary", "summary")),
        ('example = { request = "46 0001 02", response = "46 0001" }', "", ("example",)),
        ("format = 1", "format = 2", ("format = 1",)),
        ("format = 1", "", ("format = 1",)),
        ("code = 0x46", "code = 0xC6", ("code", "127")),
        ("code = 0x46", "when = { second = 1 }\ncode = 0x46", ("second", "first")),
        ('name = "Own Function"', "", ("name",)),
        ("code = 0x46", 'operation = "delete"\ncode = 0x46', ("delete", "read_write")),
        ("code = 0x46", 'register_type = "coils"\ncode = 0x46', ("coils", "coil")),
        ("code = 0x46", "limits = { first = [2, 1] }\ncode = 0x46", ("limits", "lowest")),
        ("[[function]]", "[[functions]]", ("function",)),
    ],
)
def test_a_wrong_row_is_refused_with_what_would_be_right(
    right: str, wrong: str, said: tuple[str, ...]
) -> None:
    """The message names the file, the row, the key, and the known words."""
    functions = _modlens.Functions()
    before = functions.rows()
    with pytest.raises(ValueError, match=r"own\.toml") as raised:
        functions.load(GOOD.replace(right, wrong), "own.toml")
    message = str(raised.value)
    assert "\n" not in message
    assert all(word in message for word in said), message
    assert functions.rows() == before


def test_an_unknown_vendor_is_refused_with_the_known_names() -> None:
    """An unknown vendor is refused; the message lists the known ones."""
    with pytest.raises(ValueError, match=r"huawei.*pace.*sungrow"):
        _modlens.Functions().load_vendor("nobody")


@pytest.mark.parametrize(
    ("function", "direction", "values", "said"),
    [
        (3, "request", '{"address": 70000, "quantity": 1}', "address"),
        (3, "request", '{"address": 7}', "quantity"),
        (3, "request", '{"adress": 7, "quantity": 1}', "adress"),
        (16, "request", '{"address": 7, "registers": [70000]}', "registers"),
        (15, "request", '{"address": 7, "coils": [2]}', "coils"),
        (20, "request", '{"groups": [1]}', "groups"),
        (23, "request", '{"address": 1, "write_address": 2, "write_registers": [3]}', "quantity"),
        (8, "response", '{"sub_function": 4, "data": 0}', "has no response"),
        (0x5A, "request", "{}", "not public"),
        (99, "request", "{}", "99"),
    ],
)
def test_values_that_cannot_be_are_refused_by_name(
    function: int, direction: str, values: str, said: str
) -> None:
    """The message names the field and what it takes."""
    with pytest.raises(ValueError, match=said):
        _modlens.Functions().encode(function, direction, values)
