"""ESPHome's `modbus_controller`, a test a feature, from the component's documented keys.

| what | tests (`test_feature[...]`) |
| --- | --- |
| every platform, every table | `platform-*`, `table-*` |
| every value type | `type-*`, `text-*`, `raw-*` |
| masks, offsets | `mask-*`, `offset-*` |
| filters, labels, units | `filter-*`, `select-*`, `unit` |
| what is left out | `left-*` |
"""

from __future__ import annotations

from typing import Any

import pytest

from dissectors import importers
from dissectors.errors import ProfileError, UsageError
from tests.support.importing import Feature, points


def entities(*rows: str, platform: str = "sensor") -> str:
    """Some entities on one platform."""
    lines = "".join(f"  - {{platform: modbus_controller, {row}}}\n" for row in rows)
    return f"modbus_controller:\n  - {{id: meter, address: 3}}\n{platform}:\n{lines}"


def one(keys: str = "register_type: holding", platform: str = "sensor") -> str:
    """An entity called x at 7."""
    return entities(f"name: x, address: 7, {keys}", platform=platform)


def beside(keys: str) -> str:
    """A sensor y that cannot be carried over, after x which can."""
    return entities("name: x, address: 7", f"name: y, {keys}")


def x(at: str = "hr:7", kind: str = "u16", **keys: Any) -> dict[str, dict[str, Any]]:
    """The point x."""
    return {"x": {"at": at, "type": kind, **keys}}


TYPES = [
    ("U_WORD", "u16", None), ("S_WORD", "s16", None), ("U_DWORD", "u32", None),
    ("S_DWORD", "s32", None), ("U_DWORD_R", "u32", "CDAB"), ("S_DWORD_R", "s32", "CDAB"),
    ("U_QWORD", "u64", None), ("S_QWORD", "s64", None), ("U_QWORD_R", "u64", "CDAB"),
    ("S_QWORD_R", "s64", "CDAB"), ("FP32", "f32", None), ("FP32_R", "f32", "CDAB"),
]  # fmt: skip

RW = {"access": "rw"}

FEATURES = {
    # Platforms and tables.
    "platform-sensor": Feature(one(), x()),
    "platform-number": Feature(
        one("use_write_multiple: true", "number"),
        x(**RW),
        ("use_write_multiple: cannot be kept in a profile",),
    ),
    "platform-switch": Feature(one("register_type: coil", "switch"), x("co:7", "bool", **RW)),
    "platform-switch-of-a-bit": Feature(one("bitmask: 0x8", "switch"), x("hr:7.3", "bool", **RW)),
    "platform-output": Feature(one("value_type: S_WORD", "output"), x(kind="s16", **RW)),
    "platform-binary-sensor": Feature(
        one("register_type: coil", "binary_sensor"), x("co:7", "bool")
    ),
    "platform-other": Feature(one() + "  - {platform: dht, name: y, address: 8}\n", x()),
    "table-discrete-input": Feature(
        one("register_type: discrete_input", "binary_sensor"), x("di:7", "bool")
    ),
    "table-read": Feature(one("register_type: read"), x("ir:7")),
    "table-unknown": Feature(
        beside("address: 8, register_type: file"),
        x(),
        ("y: register_type 'file' is not known; skipped",),
    ),
    # Types.
    **{
        f"type-{word}": Feature(
            one(f"value_type: {word}"), x(kind=kind, **({"order": order} if order else {}))
        )
        for word, kind, order in TYPES
    },
    "type-none": Feature(one(), x()),
    "type-unknown": Feature(
        beside("address: 8, value_type: FP64"), x(), ("y: value_type FP64 is not known; skipped",)
    ),
    "type-order-told": Feature(
        one("value_type: U_DWORD"), x(kind="u32", order="DCBA"), options={"order": "DCBA"}
    ),
    "raw-registers": Feature(one("value_type: RAW, register_count: 3"), x(kind="raw", count=3)),
    "raw-bytes": Feature(one("value_type: RAW, response_size: 5"), x(kind="raw", count=3)),
    "text-registers": Feature(one("register_count: 4", "text_sensor"), x(kind="str", count=4)),
    "text-bytes": Feature(one("response_size: 9", "text_sensor"), x(kind="str", count=5)),
    **{
        f"text-{word}": Feature(
            one(f"register_count: 2, raw_encode: {word}", "text_sensor"), x(kind=kind, count=2)
        )
        for word, kind in [("NONE", "str"), ("ANSI", "str"), ("HEXBYTES", "raw"), ("COMMA", "raw")]
    },
    # Masks: bits of the value, which may be in another register than the first.
    "mask-one-bit": Feature(one("bitmask: 0x8000"), x("hr:7.15", "bool")),
    "mask-run": Feature(one("bitmask: 0x00F0"), x("hr:7.4-7")),
    "mask-everything": Feature(one("bitmask: 0xFFFFFFFF"), x()),
    "mask-all-of-a-register": Feature(one("bitmask: 0xFFFF"), x()),
    "mask-low-word": Feature(one("value_type: U_DWORD, bitmask: 0x0001"), x("hr:8.0", "bool")),
    "mask-high-word": Feature(one("value_type: U_DWORD, bitmask: 0x00030000"), x("hr:7.0-1")),
    "mask-low-word-of-turned-words": Feature(
        one("value_type: U_DWORD_R, bitmask: 0x0001"), x("hr:7.0", "bool")
    ),
    "mask-one-word-of-two": Feature(one("value_type: U_DWORD, bitmask: 0xFFFF"), x("hr:8")),
    "mask-of-a-coil": Feature(
        one("register_type: coil, bitmask: 1", "switch"), x("co:7", "bool", **RW)
    ),
    "mask-of-a-coil-that-says-more": Feature(
        one("register_type: coil, bitmask: 2", "switch"),
        x("co:7", "bool", **RW),
        ("bitmask 2 of a coil: cannot be kept in a profile",),
    ),
    "mask-no-run": Feature(
        beside("address: 8, bitmask: 0x0005"),
        x(),
        ("y: bitmask 5 is not a contiguous run of bits of a register; skipped",),
    ),
    "mask-across-words": Feature(
        beside("address: 8, value_type: U_DWORD, bitmask: 0x00018000"),
        x(),
        ("y: bitmask 98304 is not a contiguous run of bits of a register; skipped",),
    ),
    # Offsets: bytes of registers, bits of coils.
    "offset-byte-offset": Feature(one("byte_offset: 4"), x("hr:9")),
    "offset-offset": Feature(one("offset: 2"), x("hr:8")),
    "offset-of-coils": Feature(
        one("register_type: coil, offset: 3", "binary_sensor"), x("co:10", "bool")
    ),
    "offset-inside-a-register": Feature(
        beside("address: 8, byte_offset: 1"),
        x(),
        ("y: begins at byte 1, inside a register; skipped",),
    ),
    "offset-no-number": Feature(
        beside("address: 8, byte_offset: two"),
        x(),
        ("y: byte_offset 'two' is not a whole number; skipped",),
    ),
    # Filters, labels, units.
    "filter-multiply": Feature(one("filters: [multiply: 0.1]"), x(scale=0.1)),
    "filter-offset": Feature(one("filters: [offset: -40]"), x(offset=-40)),
    "filter-one-behind-the-other": Feature(
        one("filters: [offset: 10, multiply: 0.5, offset: 1]"), x(scale=0.5, offset=6)
    ),
    "filter-not-in-a-list": Feature(one("filters: {multiply: 0.1}"), x(scale=0.1)),
    "filter-of-another-kind": Feature(
        one("filters: [throttle: 10s, multiply: 2]"),
        x(scale=2),
        ("filter throttle: cannot be kept in a profile",),
    ),
    "filter-lambda": Feature(
        one("filters: [lambda: return x * 2;]"),
        x(),
        ("filter lambda: cannot be kept in a profile",),
    ),
    "filter-number-multiply": Feature(one("multiply: 10", "number"), x(scale=0.1, **RW)),
    "select-options": Feature(
        one('optionsmap: {"Off": 0, "On": 1}', "select"), x(enum={"0": "Off", "1": "On"}, **RW)
    ),
    "select-option-that-is-none": Feature(
        one('optionsmap: {"Off": 0, "On": yes please}', "select"),
        x(enum={"0": "Off"}, **RW),
        ("x: option 'On': 'yes please' is not a raw value; skipped",),
    ),
    "unit": Feature(one('unit_of_measurement: "°C"'), x(unit="°C")),
    "address-in-hexadecimal": Feature(entities("name: x, address: 0x006B"), x("hr:107")),
    "name-is-the-id": Feature(entities("id: x, address: 7"), x()),
    # What is left out.
    "left-keys": Feature(
        one("accuracy_decimals: 1, skip_updates: 5, register_count: 2"),
        x(),
        tuple(
            f"{key}: cannot be kept in a profile"
            for key in ("accuracy_decimals", "register_count", "skip_updates")
        ),
    ),
    "left-lambda": Feature(
        one('value_type: S_WORD, lambda: "return x / 2;"'),
        x(kind="s16"),
        ("x: lambda is not understood; the value is the raw one",),
    ),
    "left-lambda-with-its-tag": Feature(
        one('lambda: !lambda "return x;"'),
        x(),
        (
            "line 4: !lambda return x; is not understood; skipped",
            "x: lambda is not understood; the value is the raw one",
        ),
    ),
    "left-write-lambda": Feature(
        one("write_lambda: return x;", "number"),
        x(**RW),
        ("x: write_lambda is not understood; the value is the raw one",),
    ),
    "substitutions": Feature(
        "substitutions: {room: cellar, at: 0x07, long: $room pump}\n"
        + entities('name: "${long}", address: $at'),
        {"cellar pump": {"at": "hr:7", "type": "u16"}},
    ),
    "substitutions-of-a-package": Feature(
        "defaults: {room: cellar, deep: 7}\nsubstitutions: {room: attic}\nsensor:\n"
        "  - {platform: modbus_controller, name: '${room} pump', address: 7,"
        " register_type: holding}\n",
        {"attic pump": {"at": "hr:7", "type": "u16"}},
    ),
    "left-substitutions-of-another-file": Feature(
        "substitutions: {room: cellar}\npackages: {a: b}\n"
        + entities('name: "${level}", address: 7'),
        {"${level}": {"at": "hr:7", "type": "u16"}},
        ("${level}: no such substitution in this file", "packages: is not resolved"),
    ),
    "lambda-and-multiply": Feature(
        one('lambda: "return x / 10;", filters: [{multiply: 0.5}]'),
        x(),
        ("x: lambda is not understood; the value is the raw one",),
    ),
    "left-address-of-a-substitution": Feature(
        beside('address: "${at}"'), x(), ("y: no address; skipped",)
    ),
    "left-custom-command": Feature(
        beside("custom_command: [1, 3]"), x(), ("y: no address; skipped",)
    ),
}


@pytest.mark.parametrize("feature", FEATURES.values(), ids=FEATURES)
def test_feature(feature: Feature) -> None:
    """Each feature gives exactly the expected points and notes."""
    assert feature.found("esphome") == feature.expected


def test_units() -> None:
    """Of several controllers one is chosen by its unit; one that is not there is refused."""
    text = (
        "modbus_controller:\n  - {id: a, address: 1}\n  - {id: b, address: 2}\nsensor:\n"
        "  - {platform: modbus_controller, modbus_controller_id: a, name: x, address: 7}\n"
        "  - {platform: modbus_controller, modbus_controller_id: b, name: y, address: 8}\n"
    )
    for unit in (None, 7):
        with pytest.raises(
            UsageError, match=r"choose a unit with --unit N; there are 1 \(a\), 2 \(b\)"
        ):
            points("esphome", text, unit=unit)
    assert list(points("esphome", text, unit=2)) == ["y"]
    with pytest.raises(UsageError, match=r"choose a unit with --unit N; there are 3 \(meter\)"):
        points("esphome", one(), unit=4)


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("sensor: [\n", 2, "not YAML: "),
        ("sensor:\n  - {platform: dht, name: x}\n", None, "no entity on platform modbus_contr"),
        ("a: 1\nsensor: !include s.yaml\n", 2, "!include is not followed: import that file"),
    ],
)
def test_what_is_no_configuration(text: str, line: int | None, part: str) -> None:
    """Files that are no configuration are refused with line and reason."""
    with pytest.raises(ProfileError, match=part) as raised:
        importers.read("esphome", text, "map")
    assert raised.value.line == line


def test_a_value_before_a_lambda_has_no_unit() -> None:
    """The unit is that of what the lambda makes of the raw value."""
    text = (
        "modbus_controller:\n  - {id: a, address: 1}\nsensor:\n"
        "  - {platform: modbus_controller, modbus_controller_id: a, name: x, address: 7,"
        ' unit_of_measurement: kW, lambda: "return x * 0.1;"}\n'
    )
    assert "unit" not in points("esphome", text)["x"]


def test_a_unit_is_taken_where_the_format_is_detected() -> None:
    """Without one, the file with several units is not said to be of no format."""
    text = "modbus:\n  - sensors:\n" + "".join(
        f"      - {{name: s{unit}, address: 1, slave: {unit}}}\n" for unit in (1, 3)
    )
    assert importers.detect(text, "configuration.yaml", 3) == "homeassistant"
    with pytest.raises(UsageError, match=r"choose a unit with --unit N; there are 1, 3"):
        importers.detect(text, "configuration.yaml")
