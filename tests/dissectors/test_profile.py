"""Profiles: one model, three spellings, every mistake at once."""

from __future__ import annotations

import json
from typing import Any

import jsonschema
import pytest

import _modlens
from dissectors.errors import ProfileError, UsageError
from dissectors.profile import Profile, form_of, from_model, parse, shipped, shipped_names
from tests.conftest import ROOT

SCHEMA = ROOT / "dissectors" / "profiles" / "profile-1.json"

TOML = """\
profile = 1
[device]
id = "acme.meter"
address_base = 1
order = "CDAB"
[device.exceptions]
0x06 = "locked"
[[registers]]
at = "hr:104"
name = "setpoint"
type = "s16"
scale = 0.1
offset = -40
unit = "°C"
access = "rw"
nan = [0x8000, 0x7FFF]
[[registers]]
at = "ir:1"
name = "energy"
type = "u32"
order = "ABCD"
[[registers]]
at = "hr:105.0-2"
name = "mode"
enum = {0 = "off", 1 = "on"}
[[registers]]
at = "co:1"
name = "pump"
"""

YAML = """\
# the same as above
profile: 1
device:
  id: acme.meter
  address_base: 1
  order: CDAB
  exceptions: {0x06: locked}
registers:
  - {at: "hr:104", name: setpoint, type: s16, scale: 0.1, offset: -40, unit: "°C", access: rw,
     nan: [0x8000, 0x7FFF]}
  - {at: "ir:1", name: energy, type: u32, order: ABCD}
  - at: "hr:105.0-2"
    name: mode
    enum: {0: off, 1: on}
  - {at: "co:1", name: pump}
"""

CSV = """\
#base=1
#id=acme.meter
#order=CDAB
#exceptions=6=locked
at,name,type,order,scale,offset,unit,access,nan,enum
hr:104,setpoint,s16,,0.1,-40,°C,rw,0x8000;0x7FFF,
ir:1,energy,u32,ABCD,,,,,,
hr:105.0-2,mode,,,,,,,,0=off;1=on
co:1,pump,,,,,,,,
"""


def mistakes(text: str, path: str = "meter.toml") -> list[tuple[int | None, str | None, str]]:
    """What is wrong with a text: line, key, message."""
    with pytest.raises(ProfileError) as raised:
        parse(text, path)
    return [(one.line, one.key, one.message) for one in raised.value.mistakes]


def test_the_three_spellings_are_one_model() -> None:
    """TOML, YAML and CSV of the same device, with wire addresses."""
    found = [parse(TOML, "m.toml"), parse(YAML, "m.yaml"), parse(CSV, "m.csv")]
    assert found[0].model == found[1].model == found[2].model
    assert [point["at"] for point in found[0].points] == ["hr:103", "ir:0", "hr:104.0-2", "co:0"]
    assert found[0].points[0]["scale"] == 0.1
    assert found[0].points[2]["enum"] == {"0": "off", "1": "on"}


def test_the_model_reads_back() -> None:
    """What the core says of a profile is a profile."""
    once = parse(TOML, "m.toml")
    assert from_model(once.model, "again").model == once.model


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_csv_by_other_delimiters(delimiter: str) -> None:
    """As spreadsheets of other countries write it."""
    text = f"at{delimiter}name{delimiter}unit\nhr:1{delimiter}a{delimiter}V\n"
    assert parse(text, "m.csv").points == [{"at": "hr:1", "name": "a", "type": "u16", "unit": "V"}]


TEN = """\
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


def test_ten_different_mistakes_are_told_at_once() -> None:
    """Each with its line and its key."""
    found = mistakes(TEN)
    assert [(line, key) for line, key, _ in found] == [
        (3, "device.adress_base"),
        (4, "device.order"),
        (6, "registers[0].at"),
        (9, "registers[1].at"),
        (14, "registers[2].typ"),
        (18, "registers[3].type"),
        (20, "registers[4].at"),
        (25, "registers[5].scale"),
        (29, "registers[6].type"),
        (32, "registers[7].name"),
    ]
    words = [message for _, _, message in found]
    assert words[0] == "meter.toml:3: device.adress_base: no such key; did you mean 'address_base'?"
    for message, part in zip(
        words[1:],
        ("ABCD, CDAB", "is no table", "beyond the last one", "did you mean 'type'", "none of bool",
         "bits 0 (lowest) to 15", "every value would be the same", "needs count", "line 13"),
        strict=True,
    ):  # fmt: skip
        assert part in message


def test_one_error_says_all_of_them() -> None:
    """A line a mistake, as the command line prints it."""
    with pytest.raises(ProfileError) as raised:
        parse(TEN, "meter.toml")
    lines = str(raised.value).split("\n")
    assert len(lines) == 10
    assert lines[0].startswith("meter.toml:3: ")


@pytest.mark.parametrize(
    ("point", "key", "part"),
    [
        ('at = "hr:1"', "name", "is missing"),
        ('name = "x"', "at", "is missing"),
        ('at = "hr:1"\nname = "x"\ntype = "u32"\ncount = 3', "count", "each u32 takes 2"),
        ('at = "hr:65535"\nname = "x"\ntype = "u32"', "at", "beyond 65535"),
        ('at = "co:1"\nname = "x"\ntype = "u16"', "type", "is a bool"),
        ('at = "hr:1"\nname = "x"\ntype = "bool"', "type", "one bit"),
        ('at = "hr:1.3"\nname = "x"\ntype = "u32"', "type", "part of a register"),
        ('at = "hr:1"\nname = "x"\ntype = "str"\ncount = 2\nscale = 2', "scale", "no number"),
        ('at = "hr:1"\nname = "x"\ntype = "f32"\nenum = {0 = "a"}', "enum", "whole number"),
        ('at = "hr:1"\nname = "x"\nbits = {16 = "a"}', "bits", "bits 0 to 15"),
        ('at = "hr:1"\nname = "x"\nnan = 1.5', "nan", "whole number"),
        ('at = "hr:1"\nname = "x"\nsf = "y"', "sf", "holds the scale factor"),
        ('at = "hr:1"\nname = "x"\ncount = 0', "count", "from 1 on"),
        ('at = "hr:1"\nname = "x"\nscale = "2"', "scale", "takes a number"),
        ('at = "hr:1"\nname = "x"\naccess = "x"', "access", "r, w, rw"),
        ('at = "hr:1"\nname = "x"\nenum = {a = "b"}', "enum.a", "is no number"),
        ('at = "hr:1"\nname = "x"\ntype = "u32"\n[[registers]]\nat = "hr:2"\nname = "y"',
         "at", "belongs to"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_point(point: str, key: str, part: str) -> None:
    """Named with its key."""
    ((_, where, message),) = mistakes(f"profile = 1\n[[registers]]\n{point}\n")
    assert str(where).endswith(key)
    assert part in message


def test_address_0_with_base_1() -> None:
    """Trap of section 1.2: there is no register 0 where counting begins at 1."""
    ((line, _, message),) = mistakes(
        'profile = 1\ndevice = {address_base = 1}\n[[registers]]\nat = "hr:0"\nname = "x"\n'
    )
    assert line == 4
    assert "counts from 1" in message


def test_broken_syntax_does_not_hide_the_rest() -> None:
    """TOML that cannot be parsed whole is read as far as it goes."""
    found = mistakes('profile = 1\n[device]\norder = \n[[registers]]\nat = "hr:1"\ntyp = "x"\n')
    assert found[0][0] == 3
    assert any(key == "registers[0].typ" for _, key, _ in found)


def test_yaml_mistakes_have_lines() -> None:
    """Of the YAML file, not of a tree in between."""
    found = mistakes("profile: 1\nregisters:\n  - at: hr:1\n    name: x\n    typ: s16\n", "m.yaml")
    assert [(line, key) for line, key, _ in found] == [(5, "registers[0].typ")]
    assert "did you mean 'type'" in found[0][2]
    assert mistakes("profile: [1\n", "m.yaml")[0][0] == 2


def test_yaml_is_yaml_1_2() -> None:
    """0107, 12:30, NO, off and 1e3 are what they look like (PyYAML reads 71, 750, false, false)."""
    text = """\
profile: 1
registers:
  - {at: "hr:1", name: NO, scale: 0107, unit: off, note: 12:30, enum: {1: off, 2: NO}}
  - {at: "hr:2", name: b, scale: 1e3}
"""
    first, second = parse(text, "m.yaml").points
    assert first["name"] == "NO"
    assert first["scale"] == 107
    assert (first["unit"], first["note"]) == ("off", "12:30")
    assert first["enum"] == {"1": "off", "2": "NO"}
    assert second["scale"] == 1000


def test_csv_mistakes_have_lines() -> None:
    """Settings, cells and comments are counted as the editor does."""
    found = mistakes(
        "#base=2\n# a remark, with a comma\nat,name,typ\nhr:1,a,s16\nhr:2,a,\n", "m.csv"
    )
    assert [(line, key) for line, key, _ in found] == [
        (1, "device.address_base"),
        (4, "registers[0].typ"),
        (5, "registers[1].name"),
    ]


def test_shipped_profiles() -> None:
    """Each has an id, a source, and points."""
    for name in shipped_names():
        profile = shipped(name)
        assert profile.device["id"]
        assert profile.device["source"]
        assert profile.points
    with pytest.raises(UsageError, match="did you mean 'grundfos'"):
        shipped("grundfoss")


def test_what_is_no_profile_file() -> None:
    """The suffix says what it is."""
    with pytest.raises(UsageError, match=r"\.toml, \.yaml"):
        form_of("meter.txt")


def test_the_schema_is_current() -> None:
    """The shipped file is what the core makes of its table of keys."""
    assert SCHEMA.read_text(encoding="utf-8") == _modlens.profile_schema()


def plain(text: str) -> Any:
    """TOML as an editor's schema check sees it."""
    import tomllib  # noqa: PLC0415 - here only

    return tomllib.loads(text)


GOOD = [TOML, *(text for _, text in _modlens.shipped_profiles())]

BAD = [
    "registers = []",
    "profile = 2",
    "profile = 1\nregister = []",
    "profile = 1\n[device]\naddress_base = 2",
    "profile = 1\n[device]\norder = 'ACBD'",
    "profile = 1\n[device]\nfunctions = [0]",
    "profile = 1\n[device.exceptions]\nx = 'y'",
    *(
        f"profile = 1\n[[registers]]\n{point}"
        for point in (
            "name = 'x'",
            "at = 'hr:1'",
            "at = 'hr:1'\nname = 'x'\ntyp = 's16'",
            "at = 'hr:1'\nname = 'x'\ntype = 'u23'",
            "at = 'xr:1'\nname = 'x'",
            "at = 'hr:x'\nname = 'x'",
            "at = 'hr:1'\nname = 'x'\nscale = 0",
            "at = 'hr:1'\nname = 'x'\nscale = '1'",
            "at = 'hr:1'\nname = 'x'\ncount = 0",
            "at = 'hr:1'\nname = 'x'\naccess = 'q'",
            "at = 'hr:1'\nname = 'x'\nenum = {a = 'b'}",
            "at = 'hr:1'\nname = 'x'\nnan = 'x'",
        )
    ),
]


@pytest.mark.parametrize("text", GOOD)
def test_the_schema_takes_what_the_validator_takes(text: str) -> None:
    """Good files."""
    parse(text, "good.toml")
    jsonschema.validate(plain(text), json.loads(_modlens.profile_schema()))


@pytest.mark.parametrize("text", BAD)
def test_the_schema_refuses_what_the_validator_refuses(text: str) -> None:
    """Bad files whose mistake a schema can say."""
    with pytest.raises(ProfileError):
        parse(text, "bad.toml")
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(plain(text), json.loads(_modlens.profile_schema()))


def test_a_profile_shows_itself() -> None:
    """Name and size."""
    assert repr(shipped("mightyzap")) == "<Profile mightyzap: 5 points>"
    assert isinstance(shipped("mightyzap"), Profile)
