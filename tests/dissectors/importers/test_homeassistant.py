"""Home Assistant's `modbus:`, a test a feature, from the integration's documented keys.

| what | tests (`test_feature[...]`) |
| --- | --- |
| every list of entities, every table | `list-*`, `table-*` |
| every data type, structures | `type-*`, `struct-*` |
| the schema of 2020 and 2021 | `old-*` |
| `swap`, texts, arrays | `swap-*`, `text-*`, `virtual-*` |
| scale, offset, sentinels, units | `number-*` |
| YAML: includes, secrets, anchors | `yaml-*`, `test_what_is_no_configuration` |
| what is left out | `left-*` |
"""

from __future__ import annotations

from typing import Any

import pytest

from dissectors import importers
from dissectors.errors import ProfileError, UsageError
from tests.support.importing import Feature, points


def hub(*entities: str, kind: str = "sensors") -> str:
    """A hub with some entities in one list."""
    rows = "".join(f"      - {{{entity}}}\n" for entity in entities)
    return f"modbus:\n  - name: hub\n    type: tcp\n    host: 10.0.0.9\n    {kind}:\n{rows}"


def sensor(keys: str = "data_type: uint16") -> str:
    """A sensor called x at 7."""
    return hub(f"name: x, address: 7, {keys}")


def beside(keys: str) -> str:
    """A sensor y that cannot be carried over, after x which can."""
    return hub("name: x, address: 7, data_type: uint16", f"name: y, {keys}")


def x(at: str = "hr:7", kind: str = "u16", **keys: Any) -> dict[str, dict[str, Any]]:
    """The point x."""
    return {"x": {"at": at, "type": kind, **keys}}


TYPES = {
    "int16": "s16", "uint16": "u16", "int32": "s32", "uint32": "u32", "int64": "s64",
    "uint64": "u64", "float16": "f16", "float32": "f32", "float64": "f64",
}  # fmt: skip

STRUCTURES = {
    ">h": "s16", ">H": "u16", ">i": "s32", ">I": "u32", ">l": "s32", ">L": "u32", ">q": "s64",
    ">Q": "u64", ">e": "f16", ">f": "f32", ">d": "f64", "!f": "f32",
}  # fmt: skip

COIL = "name: x, address: 7"

FEATURES = {
    # Lists of entities, and their tables.
    "list-sensors": Feature(sensor("input_type: holding"), x(kind="s16")),
    "table-input": Feature(sensor("input_type: input, data_type: uint16"), x("ir:7")),
    "list-binary-sensors": Feature(hub(COIL, kind="binary_sensors"), x("co:7", "bool")),
    "table-discrete-input": Feature(
        hub(f"{COIL}, input_type: discrete_input", kind="binary_sensors"), x("di:7", "bool")
    ),
    "table-binary-of-a-register": Feature(
        hub(f"{COIL}, input_type: input", kind="binary_sensors"), x("ir:7.0", "bool")
    ),
    "list-switches-holding": Feature(
        hub(f"{COIL}, write_type: holding, command_on: 2, command_off: 0", kind="switches"),
        x(access="rw", enum={"0": "off", "2": "on"}),
    ),
    "list-switches-coil": Feature(
        hub(f"{COIL}, write_type: coils", kind="switches"), x("co:7", "bool", access="rw")
    ),
    "list-switches-verify": Feature(
        hub(f"{COIL}, verify: {{address: 9}}", kind="switches"),
        x(access="rw"),
        ("verify: cannot be kept in a profile",),
    ),
    "list-lights": Feature(
        hub(f"{COIL}, write_type: coil", kind="lights"), x("co:7", "bool", access="rw")
    ),
    "list-fans": Feature(hub(COIL, kind="fans"), x(access="rw")),
    "list-covers": Feature(
        hub(f"{COIL}, input_type: coil, state_open: 1", kind="covers"),
        x("co:7", "bool", access="rw"),
        ("state_open: cannot be kept in a profile",),
    ),
    "list-climates": Feature(
        hub(f"{COIL}, data_type: int16, scale: 0.1, target_temp_register: 9", kind="climates"),
        x(kind="s16", scale=0.1),
        ("target_temp_register: cannot be kept in a profile",),
    ),
    # Types.
    "type-none-is-int16": Feature(sensor("slave: 1"), x(kind="s16")),
    **{
        f"type-{word}": Feature(sensor(f"data_type: {word}"), x(kind=kind))
        for word, kind in TYPES.items()
    },
    **{
        f"struct-{word}": Feature(sensor(f'data_type: custom, structure: "{word}"'), x(kind=kind))
        for word, kind in STRUCTURES.items()
    },
    "struct-little-endian": Feature(
        sensor('data_type: custom, count: 2, structure: "<f"'), x(kind="f32", order="DCBA")
    ),
    "struct-of-the-machine": Feature(
        sensor('data_type: custom, count: 2, structure: "=f"'), x(kind="f32", order="DCBA")
    ),
    "struct-little-endian-with-swap": Feature(
        sensor('data_type: custom, count: 2, structure: "<f", swap: word'),
        x(kind="f32", order="BADC"),
    ),
    "struct-array": Feature(
        sensor('data_type: custom, count: 4, structure: ">2i"'), x(kind="s32", count=4)
    ),
    "struct-array-of-letters": Feature(
        sensor('data_type: custom, count: 3, structure: ">hhh"'), x(kind="s16", count=3)
    ),
    "struct-text": Feature(
        sensor('data_type: custom, count: 4, structure: ">8s"'), x(kind="str", count=4)
    ),
    "struct-mixed": Feature(
        sensor('data_type: custom, count: 7, scale: 0.1, structure: ">hH5h"'),
        {
            "x_1": {"at": "hr:7", "type": "s16", "scale": 0.1},
            "x_2": {"at": "hr:8", "type": "u16", "scale": 0.1},
            "x_3": {"at": "hr:9", "type": "s16", "count": 5, "scale": 0.1},
        },
        ("x: structure '>hH5h' gives 3 points, numbered by their first value",),
    ),
    "struct-with-padding": Feature(
        sensor('data_type: custom, count: 5, structure: ">h4xf"'),
        {"x_1": {"at": "hr:7", "type": "s16"}, "x_2": {"at": "hr:10", "type": "f32"}},
        ("x: structure '>h4xf' gives 2 points, numbered by their first value",),
    ),
    # Python aligns the float to four bytes where no prefix is given: calcsize("hf") is 8.
    "struct-aligned": Feature(
        sensor('data_type: custom, count: 4, structure: "hf"'),
        {
            "x_1": {"at": "hr:7", "type": "s16", "order": "BADC"},
            "x_2": {"at": "hr:9", "type": "f32", "order": "DCBA"},
        },
        ("x: structure 'hf' gives 2 points, numbered by their first value",),
    ),
    "struct-of-halves": Feature(
        sensor('data_type: custom, count: 2, structure: ">Bbh"'),
        {
            "x_1": {"at": "hr:7", "type": "u8h"},
            "x_2": {"at": "hr:7", "type": "s8l"},
            "x_3": {"at": "hr:8", "type": "s16"},
        },
        ("x: structure '>Bbh' gives 3 points, numbered by their first value",),
    ),
    # Swapped words turn round all three registers: the float is in front, its words swapped.
    "struct-swapped-words": Feature(
        sensor('data_type: custom, count: 3, structure: ">hf", swap: word'),
        {
            "x_1": {"at": "hr:9", "type": "s16"},
            "x_2": {"at": "hr:7", "type": "f32", "order": "CDAB"},
        },
        ("x: structure '>hf' gives 2 points, numbered by their first value",),
    ),
    **{
        f"struct-refused-{structure}": Feature(
            beside(f'address: 8, data_type: custom, structure: "{structure}"{more}'),
            x(),
            (f"y: {why}; skipped",),
        )
        for structure, more, why in [
            (">2h3b", "", "structure '>2h3b' takes 7 bytes: no whole registers"),
            (">bhb", "", "value 2 begins in the middle of a register"),
            (">hP", "", "structure with 'P', which no register holds"),
            (">h2", "", "structure '>h2' is not understood"),
            (">hH", ", count: 3", "structure '>hH' takes 2 registers, not the count of 3"),
            (">hH", ", virtual_count: 3", "an array of structures"),
            (">h4s", ", swap: word", "registers of a text in turned order"),
        ]
    },
    # The schemas of 2020 and 2021: the count is the width.
    **{
        f"old-{word}-{count}": Feature(sensor(f"data_type: {word}, count: {count}"), x(kind=kind))
        for word, count, kind in [
            ("int", 1, "s16"),
            ("int", 2, "s32"),
            ("int", 4, "s64"),
            ("uint", 1, "u16"),
            ("uint", 2, "u32"),
            ("uint", 4, "u64"),
            ("float", 1, "f16"),
            ("float", 2, "f32"),
            ("float", 4, "f64"),
        ]
    },
    "old-no-count": Feature(sensor("data_type: uint"), x()),
    "old-count-that-cannot-be": Feature(
        beside("address: 8, data_type: int, count: 3"),
        x(),
        ("y: data type 'int' is not understood; skipped",),
    ),
    "old-reverse-order": Feature(
        sensor("data_type: int, count: 2, reverse_order: true"), x(kind="s32", order="CDAB")
    ),
    "old-platform": Feature(
        "- platform: modbus\n  registers:\n"
        "    - {name: x, slave: 1, register: 7, register_type: input, data_type: uint}\n"
        "- platform: modbus\n  coils:\n    - {name: c, slave: 1, address: 5}\n",
        {**x("ir:7"), "c": {"at": "co:5", "type": "bool"}},
    ),
    # Orders.
    "swap-none": Feature(sensor("data_type: int32, swap: none"), x(kind="s32")),
    "swap-word": Feature(sensor("data_type: int32, swap: word"), x(kind="s32", order="CDAB")),
    "swap-byte": Feature(sensor("data_type: int32, swap: byte"), x(kind="s32", order="BADC")),
    "swap-word-byte": Feature(
        sensor("data_type: int32, swap: word_byte"), x(kind="s32", order="DCBA")
    ),
    "swap-byte-of-one-register": Feature(
        sensor("data_type: int16, swap: byte"), x(kind="s16", order="BADC")
    ),
    "swap-unknown": Feature(
        beside("address: 8, swap: sideways"), x(), ("y: 'sideways' is not a byte order; skipped",)
    ),
    "swap-told": Feature(
        sensor("data_type: int32"), x(kind="s32", order="CDAB"), options={"order": "CDAB"}
    ),
    # Texts and arrays.
    "text": Feature(sensor("data_type: string, count: 8"), x(kind="str", count=8)),
    "text-byte-swap": Feature(
        sensor("data_type: string, count: 8, swap: byte"), x(kind="str", count=8, order="BADC")
    ),
    "text-word-swap": Feature(
        beside("address: 8, data_type: string, count: 8, swap: word"),
        x(),
        ("y: registers of a text in turned order; skipped",),
    ),
    "virtual-count": Feature(sensor("data_type: uint32, virtual_count: 2"), x(kind="u32", count=6)),
    "virtual-slave-count": Feature(sensor("data_type: uint16, slave_count: 2"), x(count=3)),
    "virtual-count-of-coils": Feature(
        hub(f"{COIL}, virtual_count: 7", kind="binary_sensors"), x("co:7", "bool", count=8)
    ),
    "virtual-count-of-switches": Feature(
        hub(f"{COIL}, write_type: coil, virtual_count: 7", kind="switches"),
        x("co:7", "bool", access="rw"),
        ("virtual_count: cannot be kept in a profile",),
    ),
    "virtual-count-of-bits": Feature(
        hub(f"{COIL}, input_type: holding, virtual_count: 7", kind="binary_sensors"),
        x("hr:7.0", "bool"),
        ("virtual_count: cannot be kept in a profile",),
    ),
    "virtual-count-of-texts": Feature(
        beside("address: 8, data_type: string, count: 2, virtual_count: 2"),
        x(),
        ("y: an array of texts; skipped",),
    ),
    "virtual-count-no-number": Feature(
        beside("address: 8, virtual_count: many"),
        x(),
        ("y: virtual_count 'many' is not a number of values; skipped",),
    ),
    # Numbers.
    "number-scale-and-offset": Feature(
        sensor("data_type: int16, scale: 0.1, offset: -40"), x(kind="s16", scale=0.1, offset=-40)
    ),
    "number-scale-1": Feature(sensor("data_type: uint16, scale: 1, offset: 0"), x()),
    "number-scale-no-number": Feature(
        sensor("data_type: uint16, scale: ten"), x(), ("x: scale 'ten' is not a number; skipped",)
    ),
    "number-nan-value": Feature(
        sensor("data_type: int16, nan_value: 0x8000"), x(kind="s16", nan=[0x8000])
    ),
    "number-nan-value-text": Feature(
        sensor('data_type: uint32, nan_value: "0xFFFFFFFF"'), x(kind="u32", nan=[0xFFFFFFFF])
    ),
    "number-nan-of-a-text": Feature(
        sensor("data_type: string, count: 2, nan_value: 0"),
        x(kind="str", count=2),
        ("x: nan 0 does not apply to a str; skipped",),
    ),
    "number-unit": Feature(sensor('data_type: uint16, unit_of_measurement: "°C"'), x(unit="°C")),
    "number-unit-no-text": Feature(
        sensor("data_type: uint16, unit_of_measurement: [V]"),
        x(),
        ("x: unit ['V'] is not text; skipped",),
    ),
    "number-address-in-hexadecimal": Feature(
        hub("name: x, address: 0x006B, data_type: uint16"), x("hr:107")
    ),
    # What is left out.
    "left-keys": Feature(
        sensor("data_type: uint16, precision: 1, device_class: power, scan_interval: 9"),
        x(),
        tuple(
            f"{key}: cannot be kept in a profile"
            for key in ("device_class", "precision", "scan_interval")
        ),
    ),
    "left-keys-are-counted": Feature(
        hub("name: x, address: 7, unique_id: a", "name: y, address: 8, unique_id: b"),
        {**x(kind="s16"), "y": {"at": "hr:8", "type": "s16"}},
        ("unique_id: cannot be kept in a profile (2 times)",),
    ),
    "left-no-address": Feature(beside("slave: 1"), x(), ("y: no address; skipped",)),
    "left-template": Feature(
        beside('address: "{{ 8 }}"'), x(), ("y: address '{{ 8 }}' is not a number; skipped",)
    ),
    "left-table": Feature(
        beside("address: 8, input_type: files"),
        x(),
        ("y: input_type 'files' is not known; skipped",),
    ),
    "left-type": Feature(
        beside("address: 8, data_type: int24"),
        x(),
        ("y: data type 'int24' is not understood; skipped",),
    ),
    # YAML.
    "yaml-secret": Feature(
        sensor().replace("10.0.0.9", "!secret host"),
        x(),
        ("line 4: !secret host is not followed; skipped",),
    ),
    "yaml-secret-address": Feature(
        beside("address: !secret at"),
        x(),
        ("line 7: !secret at is not followed; skipped", "y: no address; skipped"),
    ),
    "yaml-anchor": Feature(
        "modbus:\n  - sensors:\n      - &one {name: x, address: 7, data_type: uint32, swap: word}\n"
        "      - {<<: *one, name: y, address: 9}\n",
        {
            **x(kind="u32", order="CDAB"),
            "y": {"at": "hr:9", "type": "u32", "order": "CDAB"},
        },
    ),
    "yaml-entities-of-an-included-file": Feature(
        "- {name: x, address: 7, data_type: uint16}\n",
        x(),
        ("a list of entities without a hub: sensors (assumed)",),
    ),
    "yaml-words-in-place-of-lists": Feature(
        sensor() + "    switches: none\n    covers: [a, 3]\n", x()
    ),
}


@pytest.mark.parametrize("feature", FEATURES.values(), ids=FEATURES)
def test_feature(feature: Feature) -> None:
    """Each feature gives exactly the expected points and notes."""
    assert feature.found("homeassistant") == feature.expected


def test_units() -> None:
    """`slave`, `device_address`; entities without one belong to all."""
    text = hub(
        "name: a, address: 1, slave: 1", "name: b, address: 2, device_address: 2",
        "name: c, address: 3",
    )  # fmt: skip
    for unit in (None, 7):
        with pytest.raises(UsageError, match=r"map: choose a unit with --unit N; there are 1, 2"):
            points("homeassistant", text, unit=unit)
    assert list(points("homeassistant", text, unit=2)) == ["b", "c"]


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("modbus: [\n", 2, "not YAML: "),
        ("modbus:\n  - a: \x01\n", 2, "not YAML: unacceptable character"),
        ("light:\n  - x\n", None, "no modbus: with sensors or switches in it$"),
        ("a: 1\nmodbus: !include m.yaml\n", 2, "!include m.yaml is not followed: import that file"),
        ("&a [*a]\n", None, "no modbus|contains itself"),
        ("? [a, b]\n: 3\n", None, "no modbus"),
    ],
)
def test_what_is_no_configuration(text: str, line: int | None, part: str) -> None:
    """Files that are no configuration are refused with line and reason."""
    with pytest.raises(ProfileError, match=part) as raised:
        importers.read("homeassistant", text, "map")
    assert raised.value.line == line
