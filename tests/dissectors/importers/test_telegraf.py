"""Telegraf's `inputs.modbus`, a test a feature, from the plugin's documented configuration.

| what | tests (`test_feature[...]`) |
| --- | --- |
| the three styles, units | `style-*`, `test_units` |
| every data type | `type-*` |
| fixed point numbers | `fixed-*` |
| every order of bytes | `order-*` |
| bits, texts, scale | `bit-*`, `text-*`, `scale-*` |
| what is left out | `left-*` |
"""

from __future__ import annotations

from typing import Any

import pytest

from dissectors import importers
from dissectors.errors import ProfileError, UsageError
from tests.support.importing import Feature, points


def register(fields: str, table: str = "holding_registers") -> str:
    """A plugin in the style `register`."""
    return f"[[inputs.modbus]]\nslave_id = 3\n{table} = [\n  {{ {fields} }},\n]\n"


def request(fields: str, head: str = 'register = "holding"') -> str:
    """A plugin in the style `request`."""
    return (
        '[[inputs.modbus]]\nconfiguration_type = "request"\n[[inputs.modbus.request]]\n'
        f"slave_id = 3\n{head}\nfields = [ {{ {fields} }} ]\n"
    )


def x(at: str = "hr:7", kind: str = "u16", **keys: Any) -> dict[str, dict[str, Any]]:
    """The point x."""
    return {"x": {"at": at, "type": kind, **keys}}


BESIDE = '{ name = "x", address = [7], data_type = "UINT16" }, '


def beside(fields: str) -> str:
    """A field that cannot be carried over, after x which can."""
    return register("").replace("{  },", f"{BESIDE} {{ {fields} }},")


TYPES = [
    ("INT8L", "s8l", 1), ("INT8H", "s8h", 1), ("UINT8L", "u8l", 1), ("UINT8H", "u8h", 1),
    ("INT16", "s16", 1), ("UINT16", "u16", 1), ("INT32", "s32", 2), ("UINT32", "u32", 2),
    ("INT64", "s64", 4), ("UINT64", "u64", 4), ("FLOAT16-IEEE", "f16", 1),
    ("FLOAT32-IEEE", "f32", 2), ("FLOAT64-IEEE", "f64", 4),
]  # fmt: skip

ORDERS = [
    ("AB", 1, None), ("BA", 1, "BADC"), ("ABCD", 2, None), ("CDAB", 2, "CDAB"), ("BADC", 2, "BADC"),
    ("DCBA", 2, "DCBA"), ("ABCDEFGH", 4, None), ("GHEFCDAB", 4, "CDAB"), ("BADCFEHG", 4, "BADC"),
    ("HGFEDCBA", 4, "DCBA"),
]  # fmt: skip

FEATURES = {
    # Styles.
    "style-register-holding": Feature(register('name = "x", address = [7]'), x()),
    "style-register-input": Feature(
        register('name = "x", address = [7]', "input_registers"), x("ir:7")
    ),
    "style-register-coils": Feature(
        register('name = "x", address = [7], data_type = "BOOL"', "coils"), x("co:7", "bool")
    ),
    "style-register-discrete": Feature(
        register('name = "x", address = [7]', "discrete_inputs"), x("di:7", "bool")
    ),
    **{
        f"style-request-{word}": Feature(
            request('name = "x", address = 7, type = "UINT16"', f'register = "{word}"'),
            x(f"{space}:7", "bool" if space in ("co", "di") else "u16"),
        )
        for word, space in [("holding", "hr"), ("input", "ir"), ("coil", "co"), ("discrete", "di")]
    },
    "style-metric": Feature(
        '[[inputs.modbus]]\nconfiguration_type = "metric"\n[[inputs.modbus.metric]]\nslave_id = 3\n'
        'byte_order = "DCBA"\nmeasurement = "m"\nfields = [\n'
        '  { register = "input", address = 4, name = "f", type = "FLOAT32", scale = 10.0 },\n'
        '  { register = "coil", address = 5, name = "c" },\n'
        '  { address = 6, name = "h", type = "UINT16" },\n]\n'
        '[inputs.modbus.metric.tags]\nplace = "cellar"\n',
        {
            "f": {"at": "ir:4", "type": "f32", "order": "DCBA", "scale": 10},
            "c": {"at": "co:5", "type": "bool"},
            "h": {"at": "hr:6", "type": "u16", "order": "BADC"},
        },
        (
            "measurement: of a metric cannot be kept in a profile",
            "tags: of a metric cannot be kept in a profile",
        ),
    ),
    # Types, in both spellings.
    **{
        f"type-{word}": Feature(
            register(f'name = "x", data_type = "{word}", address = {list(range(7, 7 + width))}'),
            x("hr:7", kind),
        )
        for word, kind, width in TYPES
    },
    **{
        f"type-request-{word}": Feature(
            request(f'name = "x", type = "{word.removesuffix("-IEEE")}", address = 7'),
            x("hr:7", kind),
        )
        for word, kind, _ in TYPES
    },
    # Fixed point numbers, and FLOAT32, their old name.
    **{
        f"fixed-{word}-{width}": Feature(
            register(
                f'name = "x", data_type = "{word}", scale = 0.01, '
                f"address = {list(range(7, 7 + width))}"
            ),
            x("hr:7", f"{sign}{16 * width}", scale=0.01),
        )
        for word, sign in [("FIXED", "s"), ("UFIXED", "u"), ("FLOAT32", "u")]
        for width in (1, 2, 4)
    },
    # Orders.
    **{
        f"order-{word}": Feature(
            register(
                f'name = "x", byte_order = "{word}", data_type = "INT{16 * width}", '
                f"address = {list(range(7, 7 + width))}"
            ),
            x("hr:7", f"s{16 * width}", **({"order": order} if order else {})),
        )
        for word, width, order in ORDERS
    },
    "order-of-the-request": Feature(
        request('name = "x", type = "UINT32", address = 7', 'byte_order = "CDAB"'),
        x("hr:7", "u32", order="CDAB"),
    ),
    "order-told": Feature(
        register('name = "x", data_type = "INT32", address = [7, 8]'),
        x("hr:7", "s32", order="BADC"),
        options={"order": "BADC"},
    ),
    # Bits: in a register with turned bytes they are other ones (core: order of the point).
    "bit": Feature(request('name = "x", type = "BIT", bit = 3, address = 7'), x("hr:7.3", "bool")),
    "bit-0-if-none-is-told": Feature(
        request('name = "x", type = "BIT", address = 7'), x("hr:7.0", "bool")
    ),
    "bit-of-turned-bytes": Feature(
        request('name = "x", type = "BIT", bit = 3, address = 7', 'byte_order = "DCBA"'),
        x("hr:7.3", "bool", order="BADC"),
    ),
    # Texts: Telegraf turns the bytes of a register, never its registers.
    "text": Feature(
        request('name = "x", type = "STRING", length = 4, address = 7'), x("hr:7", "str", count=4)
    ),
    "text-of-addresses": Feature(
        register('name = "x", data_type = "STRING", address = [7, 8, 9]'),
        x("hr:7", "str", count=3),
    ),
    "text-of-one-register": Feature(
        request('name = "x", type = "STRING", address = 7'), x("hr:7", "str", count=1)
    ),
    "text-turned": Feature(
        request('name = "x", type = "STRING", length = 4, address = 7', 'byte_order = "DCBA"'),
        x("hr:7", "str", count=4, order="BADC"),
    ),
    "text-words-do-not-turn": Feature(
        request('name = "x", type = "STRING", length = 4, address = 7', 'byte_order = "CDAB"'),
        x("hr:7", "str", count=4),
    ),
    **{
        f"text-{where}": Feature(
            request('name = "x", type = "STRING", length = 4, address = 7').replace(
                "[[inputs.modbus]]\n",
                f'[[inputs.modbus]]\nstring_register_location = "{where}"\n',
                1,
            ),
            x("hr:7", kind, count=4),
        )
        for where, kind in [("lower", "strl"), ("upper", "strh"), ("", "str")]
    },
    # Scale.
    "scale": Feature(register('name = "x", scale = 0.1, address = [7]'), x(scale=0.1)),
    "scale-1": Feature(register('name = "x", scale = 1.0, address = [7]'), x()),
    "scale-0-is-none": Feature(register('name = "x", scale = 0.0, address = [7]'), x()),
    # What is left out.
    "left-omit": Feature(
        beside('name = "y", omit = true, address = [8]'), x(), ("y: omit = true; skipped",)
    ),
    "left-output-measurement-tags": Feature(
        register('name = "x", address = [7], output = "FLOAT64", measurement = "m"'),
        x(),
        ("measurement: cannot be kept in a profile", "output: cannot be kept in a profile"),
    ),
    "left-settings-of-the-line": Feature(
        '[[inputs.modbus]]\nname = "meter"\ncontroller = "tcp://a:502"\ntimeout = "1s"\n'
        'slave_id = 3\nholding_registers = [ { name = "x", address = [7] } ]\n'
        '[inputs.modbus.workarounds]\nafter_connect_pause = "1s"\n',
        x(),
        tuple(
            f"{key}: is not part of a register map"
            for key in ("controller", "name", "timeout", "workarounds")
        ),
    ),
    "left-keys-of-a-request": Feature(
        request('name = "x", address = 7, type = "UINT16"', 'optimization = "shrink"'),
        x(),
        ("optimization: of a request cannot be kept in a profile",),
    ),
    "left-registers-not-in-a-row": Feature(
        beside('name = "y", address = [9, 8], data_type = "UINT32"'),
        x(),
        ("y: registers [9, 8] are not in a row; skipped",),
    ),
    "left-width-that-cannot-be": Feature(
        beside('name = "y", address = [8, 9, 10], data_type = "UINT32"'),
        x(),
        ("y: UINT32 takes 2 registers, not 3; skipped",),
    ),
    "left-fixed-of-3": Feature(
        beside('name = "y", address = [8, 9, 10], data_type = "FIXED"'),
        x(),
        ("y: FIXED of 3 registers; skipped",),
    ),
    "left-type-unknown": Feature(
        beside('name = "y", address = [8], data_type = "INT24"'),
        x(),
        ("y: type INT24 is not known; skipped",),
    ),
    "left-order-unknown": Feature(
        beside('name = "y", address = [8], byte_order = "ACBD"'),
        x(),
        ("y: 'ACBD' is not a byte order; skipped",),
    ),
    "left-no-address": Feature(beside('name = "y"'), x(), ("y: no address; skipped",)),
    "left-address-no-number": Feature(
        beside('name = "y", address = "8"'), x(), ("y: address '8' is not a number; skipped",)
    ),
    "left-scale-no-number": Feature(
        beside('name = "y", address = [8], scale = "ten"'),
        x(),
        ("y: scale 'ten' is not a number; skipped",),
    ),
    "left-bit-that-cannot-be": Feature(
        beside('name = "y", address = [8], data_type = "BIT", bit = 16'),
        x(),
        ("y: bit 16 is not one of 0 to 15; skipped",),
    ),
    "left-length-no-number": Feature(
        beside('name = "y", address = [8], data_type = "STRING", length = "two"'),
        x(),
        ("y: length 'two' is not a number of registers; skipped",),
    ),
    "left-table-unknown": Feature(
        request('name = "x", address = 7, type = "UINT16"')
        + '[[inputs.modbus.request]]\nslave_id = 3\nregister = "files"\n'
        'fields = [ { name = "y", address = 8, type = "UINT16" } ]\n',
        x(),
        ("y: table 'files' is not known; skipped",),
    ),
    "left-base-option": Feature(
        register('name = "x", address = [7]'),
        x(),
        ("--base is ignored: a file for telegraf states it itself",),
        {"base": 1},
    ),
}


@pytest.mark.parametrize("feature", FEATURES.values(), ids=FEATURES)
def test_feature(feature: Feature) -> None:
    """Each feature gives exactly the expected points and notes."""
    assert feature.found("telegraf") == feature.expected


def test_units() -> None:
    """The only unit is taken; of several one is chosen; one that is not there is refused."""
    metric = """\
[[inputs.modbus]]
  [[inputs.modbus.metric]]
  slave_id = {unit}
  fields = [ {{ address = 4, name = "of_{unit}", type = "INT16" }} ]
"""
    text = metric.format(unit=1) + metric.format(unit=2)
    for unit in (None, 7):
        with pytest.raises(UsageError, match=r"map: choose a unit with --unit N; there are 1, 2"):
            points("telegraf", text, unit=unit)
    assert list(points("telegraf", text, unit=2)) == ["of_2"]
    assert list(points("telegraf", metric.format(unit=5))) == ["of_5"]


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("[[inputs.modbus]\n", "map: not TOML: "),
        ("[[inputs.cpu]]\n", r"map: no \[\[inputs.modbus\]\] in it"),
        ("inputs = 3\n", r"map: no \[\[inputs.modbus\]\] in it"),
        ("[[inputs.modbus]]\nholding_registers = 3\n", "map: it has no point"),
    ],
)
def test_what_is_no_configuration(text: str, part: str) -> None:
    """A file that is no configuration is refused with its name."""
    with pytest.raises(ProfileError, match=part):
        importers.read("telegraf", text, "map")
