"""What can be wrong with a profile: every rule of the validator on a bad file, with line and key.

`RULES` has a row a rule. What a JSON Schema can say of it the shipped schema says as well; what it
cannot (widths, what appears twice, registers that meet) is marked, and only the validator knows it.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass

import jsonschema
import pytest
from hypothesis import given, settings

import _modlens
from dissectors.errors import ProfileError
from dissectors.profile import from_model, parse, shipped_names
from tests.support.profiles import models

SCHEMA = jsonschema.Draft202012Validator(json.loads(_modlens.profile_schema()))


@dataclass(frozen=True, slots=True)
class Rule:
    """A bad file, where its only mistake is, and what is said; whether the schema refuses it."""

    text: str
    line: int
    key: str | None
    part: str
    schema: bool = True


def point(text: str, line: int, key: str, part: str, *, schema: bool = True) -> Rule:
    """A mistake in a point that begins in line 2; `text` begins in line 3."""
    body = text.replace("; ", "\n")
    return Rule(f"profile = 1\n[[registers]]\n{body}\n", line, f"registers[0].{key}", part, schema)


def at(text: str, part: str, base: str = "0", *, schema: bool = True) -> Rule:
    """A mistake in `at`, which is in line 4."""
    device = f"profile = 1\ndevice = {{address_base = {base}}}\n[[registers]]\n"
    return Rule(f'{device}at = {text}\nname = "x"\n', 4, "registers[0].at", part, schema)


def device(text: str, key: str, part: str, *, schema: bool = True) -> Rule:
    """A mistake in the device, in line 3."""
    return Rule(f"profile = 1\n[device]\n{text}\n", 3, f"device.{key}", part, schema)


def two(first: str, second: str, line: int, key: str, part: str) -> Rule:
    """A mistake between two points: no schema knows of it."""
    one = f'[[registers]]\n{first}\nname = "x"\n'
    other = f"[[registers]]\n{second}\n"
    return Rule(f"profile = 1\n{one}{other}", line, f"registers[1].{key}", part, schema=False)


X = 'at = "hr:1"; name = "x"'

RULES = {
    # The file.
    "no-version": Rule("registers = []\n", 1, "profile", "the file begins with profile = 1"),
    "other-version": Rule(
        "profile = 2\n", 1, "profile", "must be 1, the version of this format, not 2"
    ),
    "unknown-key-of-the-file": Rule(
        "profile = 1\nregister = []\n", 2, "register", "did you mean 'registers'"
    ),
    "registers-no-list": Rule("profile = 1\nregisters = 3\n", 2, "registers", "a list of points"),
    "point-no-table": Rule("profile = 1\nregisters = [3]\n", 2, "registers[0]", "takes a table"),
    # The device.
    "device-no-table": Rule(
        "profile = 1\ndevice = 3\n", 2, "device", "takes a table, not a number"
    ),
    "device-unknown-key": device("adress_base = 1", "adress_base", "did you mean 'address_base'"),
    "device-far-key": device("zzz = 1", "zzz", "no such key; there are id, vendor"),
    "device-no-text": device("id = true", "id", "takes a text, not true or false"),
    "device-base": device("address_base = 2", "address_base", '0, 1 or "modicon", not 2'),
    "device-order": device('order = "ACBD"', "order", "not one of ABCD, CDAB, BADC, DCBA"),
    "device-functions": device("functions = [3, 200]", "functions", "from 1 to 127, not 200"),
    "device-vendor-functions": device(
        "vendor_functions = [3]", "vendor_functions", "list of names"
    ),
    "device-sunspec": device("sunspec = 0", "sunspec", "a whole number from 1 on, not 0"),
    "device-exception-no-code": device(
        'exceptions = {busy = "y"}', "exceptions.busy", '"busy" is not a number'
    ),
    "device-exception-out-of-range": device(
        'exceptions = {256 = "y"}', "exceptions.256", "256 is not from 1 to 255", schema=False
    ),
    "device-exceptions-no-table": device('exceptions = "y"', "exceptions", 'number = "label"'),
    "device-exception-no-text": device(
        "exceptions = {4 = [1]}", "exceptions.4", "takes a text, not a list"
    ),
    # A point: keys and what they take.
    "point-unknown-key": point(f'{X}; typ = "s16"', 5, "typ", "did you mean 'type'"),
    "at-missing": point('name = "x"', 2, "at", "is missing"),
    "name-missing": point('at = "hr:1"', 2, "name", "is missing"),
    "name-empty": point('at = "hr:1"; name = " "', 4, "name", "is empty", schema=False),
    "name-no-text": point('at = "hr:1"; name = [1]', 4, "name", "takes a text, not a list"),
    "type-unknown": point(f'{X}; type = "u23"', 5, "type", "is not one of bool, u8h"),
    "order-unknown": point(f'{X}; order = "big"', 5, "order", "is not one of ABCD"),
    "access-unknown": point(f'{X}; access = "q"', 5, "access", '"q" is not one of r, w, rw'),
    "count-zero": point(f"{X}; count = 0", 5, "count", "from 1 on, not 0"),
    "count-too-big": point(f"{X}; count = 65536", 5, "count", "from 1 on, not 65536"),
    "scale-zero": point(f"{X}; scale = 0", 5, "scale", "every value would be the same"),
    "scale-no-number": point(f'{X}; scale = "2"', 5, "scale", "takes a number"),
    "scale-of-many-digits": point(
        f"{X}; scale = 0.1234567890123456789", 5, "scale", "at most 18 digits", schema=False
    ),
    "offset-no-number": point(f"{X}; offset = true", 5, "offset", "takes a number, not true"),
    "enum-no-table": point(f'{X}; enum = "on"', 5, "enum", "takes a table of number"),
    "enum-no-number": point(f'{X}; enum = {{a = "b"}}', 5, "enum.a", '"a" is not a number'),
    "enum-no-text": point(f"{X}; enum = {{1 = [2]}}", 5, "enum.1", "takes a text, not a list"),
    "bits-no-bit": point(
        f'{X}; bits = {{64 = "b"}}', 5, "bits.64", "64 is not from 0 to 63", schema=False
    ),
    "nan-no-number": point(f'{X}; nan = "x"', 5, "nan", "takes a raw value or a list"),
    "unit-no-text": point(f"{X}; unit = [1]", 5, "unit", "takes a text, not a list"),
    # Where it stands.
    "at-no-text": at("107", 'such as "hr:0x00CD", not 107'),
    "at-no-colon": at('"107"', "a colon and an address"),
    "at-no-table": at('"xr:5"', '"xr" is not a table'),
    "at-no-address": at('"hr:x"', '"x" is not an address'),
    "at-signed": at('"hr:+5"', '"+5" is not an address'),
    "at-beyond": at('"hr:65536"', "beyond the last address, 65535", schema=False),
    "at-beyond-base-1": at('"hr:65537"', "beyond the last address, 65536", "1", schema=False),
    "at-0-base-1": at('"hr:0"', "counts from 1", "1", schema=False),
    "at-no-modicon": at('"hr:30001"', "begin with 40001 or 400001", '"modicon"', schema=False),
    "at-bit-of-a-coil": at('"co:1.0"', "has no bits of its own", schema=False),
    "at-no-bit": at('"hr:1.x"', '"x" is not a bit'),
    "at-bit-16": at('"hr:1.16"', "bits 0 (lowest) to 15", schema=False),
    "at-bits-turned": at('"hr:1.5-3"', "the lower bit comes first", schema=False),
    # Keys that do not go together.
    "text-without-count": point(f'{X}; type = "str"', 5, "type", "needs count", schema=False),
    "count-of-halves": point(
        f'{X}; type = "u32"; count = 3', 6, "count", "each u32 takes 2", schema=False
    ),
    "count-of-a-part": point(
        'at = "hr:1.3"; name = "x"; count = 2', 5, "count", "has no count", schema=False
    ),
    "reaching-beyond": point(
        'at = "hr:65535"; name = "x"; type = "u32"', 3, "at", "reach beyond 65535", schema=False
    ),
    "coil-of-another-type": point(
        'at = "co:1"; name = "x"; type = "u16"', 5, "type", "a coil is a bool", schema=False
    ),
    "bool-without-bit": point(f'{X}; type = "bool"', 5, "type", "takes one bit", schema=False),
    "part-of-another-type": point(
        'at = "hr:1.3"; name = "x"; type = "u32"', 5, "type", "part of a register", schema=False
    ),
    "scale-of-a-text": point(
        f'{X}; type = "str"; count = 2; scale = 2',
        7,
        "scale",
        "is not a number, so it cannot be",
        schema=False,
    ),
    "offset-of-raw": point(
        f'{X}; type = "raw"; count = 2; offset = 2', 7, "offset", "is not a number", schema=False
    ),
    "enum-of-a-float": point(
        f'{X}; type = "f32"; enum = {{0 = "a"}}', 6, "enum", "not a whole number", schema=False
    ),
    "bits-beyond": point(f'{X}; bits = {{16 = "a"}}', 5, "bits", "has bits 0 to 15", schema=False),
    "nan-of-a-text": point(
        f'{X}; type = "str"; count = 2; nan = 0', 7, "nan", "a str is not a number", schema=False
    ),
    "nan-fraction-of-a-whole": point(f"{X}; nan = 1.5", 5, "nan", "whole number", schema=False),
    "sf-unknown": point(f'{X}; sf = "y"', 5, "sf", 'no point "y" for the scale', schema=False),
    # Between points.
    "name-twice": two('at = "hr:1"', 'name = "x"\nat = "hr:2"', 6, "name", "in line 4, too"),
    "register-twice": two(
        'at = "hr:1"', 'at = "hr:1"\nname = "y"', 6, "at", "wire address 1 of hr, which belongs to"
    ),
    "register-reached": two(
        'at = "hr:1"\ntype = "u32"', 'at = "hr:2"\nname = "y"', 7, "at", "which belongs to"
    ),
    "sf-no-whole-number": two(
        'at = "hr:1"\ntype = "f32"',
        'sf = "x"\nat = "hr:3"\nname = "y"',
        7,
        "sf",
        "is not a single whole number",
    ),
}


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_rule(rule: Rule) -> None:
    """The one mistake of a bad file; and the schema refuses it, or cannot know."""
    with pytest.raises(ProfileError) as raised:
        parse(rule.text, "bad.toml")
    (mistake,) = raised.value.mistakes
    assert (mistake.line, mistake.key) == (rule.line, rule.key)
    assert mistake.message.startswith(f"bad.toml:{rule.line}: {rule.key}: ")
    assert rule.part in mistake.message
    assert (not SCHEMA.is_valid(tomllib.loads(rule.text))) == rule.schema


@settings(deadline=None, max_examples=50)
@given(model=models())
def test_the_schema_takes_what_the_validator_takes(model: object) -> None:
    """The JSON Schema accepts any profile that the core accepts."""
    assert isinstance(model, dict)
    SCHEMA.validate(from_model(model, "x").model)
    SCHEMA.validate(model)


@pytest.mark.parametrize("text", [text for _, text in _modlens.shipped_profiles()])
def test_the_schema_takes_the_shipped_profiles(text: str) -> None:
    """The JSON Schema accepts the shipped profiles."""
    assert shipped_names()
    SCHEMA.validate(tomllib.loads(text))


TEN_TOML = """\
profile = 1
[device]
adress_base = 1
order = "ACBD"
[[registers]]
at = "xr:5"
name = "a"
[[registers]]
at = "hr:70000"
name = "b"
[[registers]]
at = "hr:1"
name = "c"
typ = "s16"
[[registers]]
at = "hr:2"
name = "d"
type = "u23"
[[registers]]
at = "hr:3.16"
name = "e"
[[registers]]
at = "hr:4"
name = "f"
scale = 0
[[registers]]
at = "hr:6"
name = "g"
type = "str"
[[registers]]
at = "hr:8"
name = "c"
"""

TEN_YAML = """\
# the same mistakes
profile: 1
device:
  adress_base: 1
  order: ACBD
registers:
  - {at: "xr:5", name: a}
  - {at: "hr:70000", name: b}
  - at: "hr:1"
    name: c
    typ: s16
  - {at: "hr:2", name: d, type: u23}
  - {at: "hr:3.16", name: e}
  - {at: "hr:4", name: f, scale: 0}
  - at: "hr:6"
    name: g
    type: str
  - {at: "hr:8", name: c}
"""

TEN_CSV = """\
#adress_base=1
#order=ACBD
at,name,type,typ,scale
xr:5,a,,,
hr:70000,b,,,
hr:1,c,,s16,
hr:2,d,u23,,
hr:3.16,e,,,
hr:4,f,,,0
hr:6,g,str,,
hr:8,c,,,
"""

TEN = [
    ("device.adress_base", "did you mean 'address_base'"),
    ("device.order", "not one of ABCD, CDAB"),
    ("registers[0].at", "is not a table"),
    ("registers[1].at", "beyond the last address"),
    ("registers[2].typ", "did you mean 'type'"),
    ("registers[3].type", "not one of bool"),
    ("registers[4].at", "bits 0 (lowest) to 15"),
    ("registers[5].scale", "every value would be the same"),
    ("registers[6].type", "needs count"),
    ("registers[7].name", "is the name of the point in line"),
]
"""Ten different mistakes: key, and a part of what is said."""


@pytest.mark.parametrize(
    ("name", "text", "lines"),
    [
        ("meter.toml", TEN_TOML, [3, 4, 6, 9, 14, 18, 20, 25, 29, 32]),
        ("meter.yaml", TEN_YAML, [4, 5, 7, 8, 11, 12, 13, 14, 17, 18]),
        ("meter.csv", TEN_CSV, [1, 2, 4, 5, 6, 7, 8, 9, 10, 11]),
    ],
)
def test_ten_different_mistakes_are_reported_at_once(
    name: str, text: str, lines: list[int]
) -> None:
    """In each spelling: each with its line and its key, a line a mistake."""
    with pytest.raises(ProfileError) as raised:
        parse(text, name)
    found = raised.value.mistakes
    assert [(one.line, one.key) for one in found] == [
        (line, key) for line, (key, _) in zip(lines, TEN, strict=True)
    ]
    for one, (key, part) in zip(found, TEN, strict=True):
        assert one.message.startswith(f"{name}:{one.line}: {key}: ")
        assert part in one.message
    assert str(raised.value).split("\n") == [one.message for one in found]


@pytest.mark.parametrize(
    ("text", "line", "key", "part"),
    [
        ('at,name,scale\nhr:1,a,"0,1"\n', 2, "registers[0].scale", 'takes a number, not "0,1"'),
        ("at,name\nhr:1,a,b\n", 2, None, "3 cells, but 2 keys in the head"),
        ("at,at,name\nhr:1,hr:2,a\n", 2, "registers[0].at", "appears twice"),
        ('at,name\nhr:1,"a\n', 2, None, "a quotation mark that is never closed"),
        ("#only=settings\n", 1, "at", "no line of keys"),
    ],
)
def test_mistakes_of_tables_only(text: str, line: int, key: str | None, part: str) -> None:
    """What a table can get wrong and the other spellings cannot."""
    with pytest.raises(ProfileError) as raised:
        parse(text, "m.csv")
    assert [(one.line, one.key) for one in raised.value.mistakes if part in one.message] == [
        (line, key)
    ]


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("profile: 1\nregisters:\n  - at: hr:1\n    at: hr:2\n", 4, "at: appears twice"),
        ("- 1\n", 1, "a profile is a table, not a list"),
        ("profile: [1\n", 2, "not YAML"),
        ("", 1, "is missing; the file begins with profile = 1"),
    ],
)
def test_mistakes_of_yaml_only(text: str, line: int, part: str) -> None:
    """What YAML can get wrong and the other spellings cannot."""
    with pytest.raises(ProfileError, match=part) as raised:
        parse(text, "m.yaml")
    assert raised.value.line == line
