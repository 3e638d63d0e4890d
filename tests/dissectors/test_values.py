"""Values as text, as numbers, as lists."""

from __future__ import annotations

import pytest

from dissectors.errors import UsageError
from dissectors.table import Field, function
from dissectors.values import Json, coil_state, to_json

GROUPS = function(0x15).fields("request")[1]


@pytest.mark.parametrize(
    ("word", "value", "expected"),
    [
        ("u16", 107, 107),
        ("u16", "0x6B", 107),
        ("len8", "6", 6),
        ("u16[]", "1,2 0x03", [1, 2, 3]),
        ("u16[]", "", []),
        ("u16[]", 7, [7]),
        ("u16[]", (1, "2"), [1, 2]),
        ("u8[]", b"\x01\xff", [1, 255]),
        ("bits", "1011", [1, 0, 1, 1]),
        ("bits", "on,off,ON", [1, 0, 1]),
        ("bits", [True, False, 1], [1, 0, 1]),
        ("bytes", b"AB", "4142"),
        ("bytes", "41 42", "4142"),
        ("bytes", "0x4142", "4142"),
        ("bytes", "", ""),
    ],
)
def test_values_become_what_the_core_takes(word: str, value: object, expected: Json) -> None:
    """Numbers stay, texts are read by the field's word."""
    assert to_json(Field("field", word), value) == expected


@pytest.mark.parametrize(
    "value",
    [
        [{"file": 4, "registers": "1,2"}],
        {"file": 4, "registers": [1, 2]},
        '{"file": 4, "registers": [1, 2]}',
        '[{"file": "0x4", "registers": [1, 2]}]',
    ],
)
def test_groups_are_mappings_or_their_json(value: object) -> None:
    """Groups are lists of mappings, one mapping, or their JSON."""
    assert to_json(GROUPS, value) == [{"file": 4, "registers": [1, 2]}]


@pytest.mark.parametrize(
    ("word", "value", "said"),
    [
        ("u16", 65536, "0 to 65535"),
        ("u16", -1, "0 to 65535"),
        ("u8", "300", "0 to 255"),
        ("u16", "many", "many"),
        ("u16[]", "1,x", "x"),
        ("u16[]", 1.5, "list"),
        ("bits", "102", "bits"),
        ("bits", "on,maybe", "maybe"),
        ("bytes", "4", "hex"),
        ("bytes", "Hello", "hex"),
    ],
)
def test_wrong_values_are_named(word: str, value: object, said: str) -> None:
    """The message has the field's name and what it takes."""
    with pytest.raises(UsageError, match=said) as raised:
        to_json(Field("own_field", word), value)
    assert "own_field" in str(raised.value)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("[{", "JSON"),
        ([1], "reference_type, file"),
        (7, "reference_type, file"),
        ([{"fiel": 4}], "did you mean 'file'"),
        ([{"xyzzy": 4}], "it takes reference_type, file"),
    ],
)
def test_wrong_groups_are_named(value: object, said: str) -> None:
    """Errors in groups name the field inside."""
    with pytest.raises(UsageError, match=said):
        to_json(GROUPS, value)


def test_coils_are_on_or_off() -> None:
    """`on` and `off` are the two values of Write Single Coil."""
    assert [coil_state(value) for value in ("on", "OFF", True, False, 7, "7")] == [
        0xFF00, 0, 0xFF00, 0, 7, "7",
    ]  # fmt: skip
