"""Profiles: one model, three spellings, every mistake at once."""

from __future__ import annotations

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
    """The core's model of a profile can be parsed as a profile again."""
    once = parse(TOML, "m.toml")
    assert from_model(once.model, "again").model == once.model


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_csv_by_other_delimiters(delimiter: str) -> None:
    """As spreadsheets of other countries write it: 0,1 is a number there."""
    text = f"at{delimiter}name{delimiter}scale\nhr:1{delimiter}a{delimiter}0,1\n"
    assert parse(text, "m.csv").points == [{"at": "hr:1", "name": "a", "type": "u16", "scale": 0.1}]


def test_csv_as_a_spreadsheet_saves_it() -> None:
    """Every line filled up to the width of the table, CR LF, cells in quotation marks."""
    text = (
        '#base=1,,,\r\n"#exceptions=4=a, b;6=c",,,\r\nat,name,unit,enum\r\n'
        'hr:2,a,,"0=x;1=y"\r\n,,,\r\n'
    )
    found = parse(text, "m.csv")
    assert found.device["exceptions"] == {"0x04": "a, b", "0x06": "c"}
    assert found.points == [
        {"at": "hr:1", "name": "a", "type": "u16", "enum": {"0": "x", "1": "y"}}
    ]


def test_broken_syntax_does_not_hide_the_rest() -> None:
    """TOML that cannot be parsed whole is read as far as it goes."""
    found = mistakes('profile = 1\n[device]\norder = \n[[registers]]\nat = "hr:1"\ntyp = "x"\n')
    assert found[0][0] == 3
    assert any(key == "registers[0].typ" for _, key, _ in found)


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
    """Each shipped profile has an id, a source, and points."""
    for name in shipped_names():
        profile = shipped(name)
        assert profile.device["id"]
        assert profile.device["source"]
        assert profile.points
    with pytest.raises(UsageError, match="did you mean 'grundfos'"):
        shipped("grundfoss")


def test_what_is_no_profile_file() -> None:
    """A file with an unknown suffix is refused."""
    with pytest.raises(UsageError, match=r"\.toml, \.yaml"):
        form_of("meter.txt")


def test_the_schema_is_current() -> None:
    """The shipped file is what the core makes of its table of keys."""
    assert SCHEMA.read_text(encoding="utf-8") == _modlens.profile_schema()


def test_a_profile_shows_itself() -> None:
    """The `repr` of a profile has its name and number of points."""
    assert repr(shipped("mightyzap")) == "<Profile mightyzap: 5 points>"
    assert isinstance(shipped("mightyzap"), Profile)
