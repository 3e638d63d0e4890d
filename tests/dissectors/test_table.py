"""The table as Python sees it."""

from __future__ import annotations

import json

import pytest

import _modlens
from dissectors.table import Field, function, functions


def test_rows_are_the_cores_rows() -> None:
    """The rows are those of the core, not parsed again from the file."""
    rows = json.loads(_modlens.Functions().rows())
    assert [row["code"] for row in rows] == [row.code for row in functions()]
    assert [row["summary"] for row in rows] == [row.summary for row in functions()]
    assert functions() is functions()


def test_a_table_with_a_vendors_rows_is_another_table() -> None:
    """Loading rows into one table does not change the embedded one."""
    table = _modlens.Functions()
    table.load_vendor("huawei")
    assert function(0x41, when=0x25, source=table).label == "Login"
    assert function(0x41, when=0x25, source=table).vendor == "huawei"
    assert function(0x41, when=0x77, source=table).label == "Huawei Private Function"
    with pytest.raises(KeyError):
        function(0x41)


def test_rows_that_are_loaded_later_are_seen() -> None:
    """What was made of the rows before does not hold any more."""
    table = _modlens.Functions()
    assert functions(table) is functions(table)
    with pytest.raises(KeyError):
        function(0x41, source=table)
    table.load_vendor("huawei")
    assert function(0x41, when=0x25, source=table).vendor == "huawei"


def test_groups_have_children() -> None:
    """A group's type is split into the fields of an item."""
    field = Field.parse("objects:group{object_id:u8 length:len8 value:bytes}")
    assert field.field_type == "group"
    assert [str(child) for child in field.children] == [
        "object_id:u8",
        "length:len8",
        "value:bytes",
    ]
    assert str(field) == "objects:group{object_id:u8 length:len8 value:bytes}"


def test_the_row_follows_the_leading_field() -> None:
    """Sub-functions with rows of their own, and the general row for all others."""
    assert function(8, when=0).fields("request")[1].field_type == "bytes"
    assert function(8, when=4).has_response is False
    assert function(8, when=11).when is None
    assert function(8).when is None
    assert function(43, when=14).label == "Read Device Identification"


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (15, {"quantity": "coils"}),
        (16, {"quantity": "registers"}),
        (23, {"write_quantity": "write_registers"}),
        (3, {}),
    ],
)
def test_quantities_that_follow_from_lists(code: int, expected: dict[str, str]) -> None:
    """Quantities follow from lists; a request without a list has none."""
    assert function(code).quantities("request") == expected


def test_rows_can_be_keys() -> None:
    """Rows are frozen and hashable."""
    assert len(set(functions())) == len(functions())
