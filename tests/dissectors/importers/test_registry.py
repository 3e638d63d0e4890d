"""Register maps of other programs; the files here are written for these tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import sunspec2

import _modlens
from dissectors import importers
from dissectors.errors import ProfileError, UsageError
from dissectors.importers import FORMATS, Options
from dissectors.importers.draft import ORDERS
from dissectors.importers.toml import dumps
from dissectors.profile import from_model, parse, shipped, shipped_names
from tests.conftest import ROOT

TELEGRAF = """\
[[inputs.modbus]]
  name = "meter"
  slave_id = 3
  coils = [ { name = "pump", address = [5] } ]
  holding_registers = [
    { name = "level", byte_order = "AB", data_type = "INT16", scale = 0.1, address = [107] },
    { name = "energy", byte_order = "CDAB", data_type = "UINT32", address = [110, 111] },
    { name = "flow", byte_order = "ABCD", data_type = "FLOAT32-IEEE", address = [112, 113] },
  ]
  input_registers = [
    { name = "temperature", byte_order = "AB", data_type = "FIXED", scale = 0.01, address = [7] },
  ]
"""

REQUEST = """\
[[inputs.modbus]]
  configuration_type = "request"
  [[inputs.modbus.request]]
  slave_id = 3
  byte_order = "CDAB"
  register = "holding"
  fields = [
    { address = 110, name = "energy", type = "UINT32" },
    { address = 112, name = "secret", type = "INT16", omit = true },
    { address = 120, name = "serial", type = "STRING", length = 4 },
    { address = 130, name = "run", type = "BIT", bit = 3 },
    { address = 131, name = "low", type = "UINT8L" },
  ]
"""

HOME = """\
modbus:
  - name: hub
    type: tcp
    host: !secret host
    sensors:
      - {name: level, slave: 3, address: 107, input_type: holding, data_type: int16, scale: 0.1}
      - {name: energy, slave: 3, address: 110, data_type: uint32, swap: word, precision: 0}
      - {name: flow, slave: 3, address: 112, data_type: float32}
      - {name: temperature, slave: 3, address: 7, input_type: input, data_type: int16, scale: 0.01}
    binary_sensors:
      - {name: pump, slave: 3, address: 5, input_type: coil}
"""

ESPHOME = """\
modbus_controller:
  - {id: meter, address: 3}
sensor:
  - platform: modbus_controller
    modbus_controller_id: meter
    name: level
    register_type: holding
    address: 107
    value_type: S_WORD
    filters:
      - multiply: 0.1
  - {platform: modbus_controller, name: energy, address: 110, value_type: U_DWORD_R}
  - {platform: modbus_controller, name: flow, address: 112, value_type: FP32}
  - platform: modbus_controller
    name: temperature
    register_type: read
    address: 7
    value_type: S_WORD
    filters: [multiply: 0.01]
binary_sensor:
  - {platform: modbus_controller, name: pump, register_type: coil, address: 5}
"""

CSV = """\
Register Type;Register;Tag Name;Data Type;Byte Order;Factor
coil;5;pump;bool;;
holding;107;level;INT16;;0,1
holding;110;energy;UINT32;3412;
holding;112;flow;float;;
input;7;temperature;INT16;;0,01
"""

MAPS = {"telegraf": TELEGRAF, "homeassistant": HOME, "esphome": ESPHOME, "csv": CSV}


def points(form: str, text: str, **options: Any) -> dict[str, dict[str, Any]]:
    """The points of an imported map by name; what stands beside the name."""
    found = importers.read(form, text, "map", Options(**options))
    checked = from_model(found.model, "map")
    return {
        point["name"]: {key: value for key, value in point.items() if key != "name"}
        for point in checked.points
    }


def notes(form: str, text: str, **options: Any) -> str:
    """The notes of an import."""
    return "\n".join(importers.read(form, text, "map", Options(**options)).notes)


@pytest.mark.parametrize("form", MAPS)
def test_the_same_map_gives_the_same_profile(form: str) -> None:
    """Five points, written down for four programs."""
    assert points(form, MAPS[form]) == {
        "pump": {"at": "co:5", "type": "bool"},
        "level": {"at": "hr:107", "type": "s16", "scale": 0.1},
        "energy": {"at": "hr:110", "type": "u32", "order": "CDAB"},
        "flow": {"at": "hr:112", "type": "f32"},
        "temperature": {"at": "ir:7", "type": "s16", "scale": 0.01},
    }


def test_telegraf_request_style() -> None:
    """Texts, bits and halves; a field that is omitted is a note."""
    assert points("telegraf", REQUEST) == {
        "energy": {"at": "hr:110", "type": "u32", "order": "CDAB"},
        "serial": {"at": "hr:120", "type": "str", "count": 4, "order": "CDAB"},
        "run": {"at": "hr:130.3", "type": "bool"},
        "low": {"at": "hr:131", "type": "u8l", "order": "CDAB"},
    }
    assert "secret: omit = true; left out" in notes("telegraf", REQUEST)


def test_telegraf_metric_style_and_units() -> None:
    """Each metric has its unit; which one is asked for where there are several."""
    metric = """\
[[inputs.modbus]]
  [[inputs.modbus.metric]]
  slave_id = {unit}
  byte_order = "DCBA"
  measurement = "m"
  fields = [ {{ register = "input", address = 4, name = "f", type = "FLOAT32", scale = 10.0 }} ]
"""
    text = metric.format(unit=1) + metric.format(unit=2)
    with pytest.raises(UsageError, match="units 1, 2; --unit N"):
        importers.read("telegraf", text, "t.conf")
    assert points("telegraf", text, unit=2) == {
        "f": {"at": "ir:4", "type": "f32", "order": "DCBA", "scale": 10}
    }


def test_home_assistant_of_2021() -> None:
    """`platform: modbus`, `registers`, `reverse_order`, `data_type: float` with a count."""
    text = """\
- platform: modbus
  registers:
    - {name: a, slave: 1, register: 7, register_type: input, data_type: float, count: 2}
    - {name: b, slave: 1, register: 9, data_type: int, count: 2, reverse_order: true}
    - {name: c, slave: 1, register: 11, data_type: uint}
    - {name: d, slave: 1, register: 12, data_type: custom, structure: ">d", count: 4}
    - {name: e, slave: 1, register: 16, data_type: custom, structure: ">2h3b"}
"""
    assert points("homeassistant", text) == {
        "a": {"at": "ir:7", "type": "f32"},
        "b": {"at": "hr:9", "type": "s32", "order": "CDAB"},
        "c": {"at": "hr:11", "type": "u16"},
        "d": {"at": "hr:12", "type": "f64"},
    }
    assert "e: data type '>2h3b' is not understood; left out" in notes("homeassistant", text)


def test_home_assistant_notes() -> None:
    """A secret and a key that profiles have no place for."""
    said = notes("homeassistant", HOME)
    assert "line 4: !secret host is not followed" in said
    assert "precision: has no place in a profile" in said
    text = "modbus:\n  - sensors:\n    - {name: x, address: 1, slave_count: 2, data_type: uint32}\n"
    assert points("homeassistant", text) == {"x": {"at": "hr:1", "type": "u32", "count": 6}}


def test_esphome_features() -> None:
    """Masks, offsets, option maps, texts; lambdas and substitutions are notes."""
    text = """\
substitutions: {device: x}
sensor:
  - {platform: modbus_controller, name: mode, address: 10, bitmask: 0x00F0}
  - {platform: modbus_controller, name: later, address: 20, byte_offset: 4, value_type: S_DWORD}
  - {platform: modbus_controller, name: half, address: 30, offset: 1}
  - platform: modbus_controller
    name: odd
    address: 40
    lambda: !lambda |-
      return x * 2;
  - {platform: other, name: no, address: 1}
select:
  - {platform: modbus_controller, name: state, address: 50, optionsmap: {"Off": 0, "On": 1}}
text_sensor:
  - {platform: modbus_controller, name: serial, address: 60, response_size: 9}
"""
    assert points("esphome", text) == {
        "mode": {"at": "hr:10.4-7", "type": "u16"},
        "later": {"at": "hr:22", "type": "s32"},
        "state": {"at": "hr:50", "type": "u16", "access": "rw", "enum": {"0": "Off", "1": "On"}},
        "serial": {"at": "hr:60", "type": "str", "count": 5},
    }
    said = notes("esphome", text)
    for part in ("!lambda", "substitutions: is not resolved", "half: begins at byte 1", "odd: RAW"):
        assert part in said


KEPWARE = """\
Tag Name,Address,Data Type,Respect Data Type,Client Access,Scan Rate,Scaling,Raw Low,Raw High,\
Scaled Low,Scaled High,Scaled Data Type,Clamp Low,Clamp High,Eng Units,Description,Negate Value
"Level","40108",Short,1,R/W,100,Linear,0,1000,0,100,Double,0,0,"%","Tank level",0
"Energy","400111",DWord,1,RO,100,None,,,,,,,,"kWh","",0
"Alarm","40001.5",Boolean,1,RO,100,None,,,,,,,,"","",0
"Serial","400200.20H",String,1,RO,100,None,,,,,,,,"","",0
"Pump","000006",Boolean,1,R/W,100,None,,,,,,,,"","",0
"Input","300008",Float,1,RO,100,"Square Root",0,1,0,1,Float,0,0,"","",0
"""


def test_kepware() -> None:
    """Modicon addresses, bits, texts, linear scaling; the order is assumed, and said."""
    assert points("csv", KEPWARE) == {
        "Level": {"at": "hr:107", "type": "s16", "scale": 0.1, "unit": "%", "access": "rw",
                  "note": "Tank level"},
        "Energy": {"at": "hr:110", "type": "u32", "order": "CDAB", "unit": "kWh"},
        "Alarm": {"at": "hr:0.5", "type": "bool"},
        "Serial": {"at": "hr:199", "type": "str", "count": 10},
        "Pump": {"at": "co:5", "type": "bool", "access": "rw"},
        "Input": {"at": "ir:7", "type": "f32", "order": "CDAB"},
    }  # fmt: skip
    said = notes("csv", KEPWARE)
    assert "40001 or 400001 (assumed" in said
    assert "CDAB (assumed" in said
    assert "scaling 'Square Root' is not linear" in said
    assert points("csv", KEPWARE, order="ABCD")["Energy"] == {
        "at": "hr:110", "type": "u32", "unit": "kWh"
    }  # fmt: skip


def table(*rows: str, head: str = "Address,Name") -> str:
    """A small CSV."""
    return "\n".join([head, *rows]) + "\n"


def test_trap_1_one_register_has_five_names() -> None:
    """Section 1.2: 107 on the wire, 108, 40108, 400108; which one, the base says."""
    for text, base in [
        ("107", 0),
        ("0x6B", 0),
        ("108", 1),
        ("40108", "modicon"),
        ("400108", "modicon"),
    ]:
        assert points("csv", table(f"{text},x"), base=base)["x"]["at"] == "hr:107"


def test_trap_2_five_and_six_digits_may_be_mixed() -> None:
    """Section 1.2: 49999 is the last of five digits; 410000 goes on."""
    found = points("csv", table("40001,a", "400002,b", "49999,c", "410000,d"), base="modicon")
    assert [point["at"] for point in found.values()] == ["hr:0", "hr:1", "hr:9998", "hr:9999"]


def test_trap_2_a_bare_40001_is_never_converted_by_itself() -> None:
    """Section 1.2: it can be a wire address (SunSpec, modpoll); what was assumed is said."""
    assert points("csv", table("40001,x"))["x"]["at"] == "hr:40001"
    assert "addresses count from 0, as on the wire (assumed; --base" in notes(
        "csv", table("40001,x")
    )


def test_trap_3_other_tools_numbers_are_taken_as_the_base_says() -> None:
    """Section 1.2: wire + 1 as Zeek's change log prints it, 31001 as sigrok does for function 3."""
    assert points("csv", table("1001,x"), base=1)["x"]["at"] == "hr:1000"
    assert points("csv", table("31001,x"), base="modicon")["x"]["at"] == "ir:1000"


def test_trap_4_bits_count_from_the_lowest() -> None:
    """Section 1.2: .0 is the lowest bit here; a bit beyond 15 is refused, not wrapped."""
    assert points("csv", table("10.0,x"))["x"]["at"] == "hr:10.0"
    assert "bit 16 is none of 0 to 15" in notes("csv", table("10.16,x"))


def test_csv_head_words_and_orders() -> None:
    """Words that people use, in any case; unknown columns are notes."""
    text = table("AB12,ignored", head="Modbus Address\tVariable Name\tUoM\tColour").replace(
        "AB12,ignored", "12\tx\tbar\tred"
    )
    assert points("csv", text) == {"x": {"at": "hr:12", "type": "u16", "unit": "bar"}}
    assert "column 'Colour' is not understood" in notes("csv", text)


def test_csv_two_columns_for_one_thing() -> None:
    """The first one counts, the other one is a note."""
    said = notes("csv", table("40,flow,41", head="Address,Name,Register"))
    assert "column 'Register' says the same as 'Address'; left out" in said


def test_home_assistant_with_what_is_no_number() -> None:
    """A person's slip in a file is no crash: what cannot be counted counts as nothing."""
    text = (
        "modbus:\n  - sensors:\n      - name: a\n        address: 1\n        virtual_count: many\n"
        "        count: x\n      - just words\n    switches: none\n"
    )
    assert points("homeassistant", text)["a"]["at"] == "hr:1"


def test_orders_have_one_table() -> None:
    """Section 1.3: every synonym."""
    for order, words in {
        "ABCD": "big BE_BE 1234 highlow MSWLSW", "CDAB": "lowhigh LSWMSW 3412 sw word",
        "BADC": "2143 sb byte", "DCBA": "4321 little word_byte",
    }.items():  # fmt: skip
        for word in words.split():
            assert importers.order_of(word, "x") == order
    assert set(ORDERS.values()) == {"ABCD", "CDAB", "BADC", "DCBA"}
    with pytest.raises(UsageError, match="is no order"):
        importers.order_of("upside down", "x")


def test_double_names_and_registers_are_notes() -> None:
    """Nothing is dropped in silence."""
    text = table("1,a", "1,b", "2,a")
    assert list(points("csv", text)) == ["a", "a_2"]
    said = notes("csv", text)
    assert "b: hr:1 belongs to a; left out" in said
    assert "called a_2" in said


@pytest.mark.parametrize("form", ["telegraf", "homeassistant", "esphome", "csv", "sunspec"])
def test_what_is_none_of_it_is_said(form: str) -> None:
    """An error that names the file."""
    with pytest.raises(ProfileError, match=r"^map"):
        importers.read(form, "x: [1]\n" if form in ("homeassistant", "esphome") else "{", "map")


def test_unknown_formats() -> None:
    """With a near name."""
    with pytest.raises(UsageError, match="did you mean 'telegraf'"):
        importers.read("telegraph", "", "x")


SUNSPEC = Path(sunspec2.__file__).parent / "models" / "json"


@pytest.mark.parametrize(("number", "text"), _modlens.sunspec_models())
def test_shipped_sunspec_models_are_those_of_the_alliance(number: int, text: str) -> None:
    """The importer makes them from the JSON of the package pysunspec2."""
    source = (SUNSPEC / f"model_{number}.json").read_text(encoding="utf-8")
    found = importers.read("sunspec", source, f"model_{number}.json")
    assert text.split("\n", 2)[2] == dumps(from_model(found.model, "x").model)


def test_sunspec_reads_every_model_of_the_alliance() -> None:
    """Each is a profile; repeated groups are a note."""
    for path in sorted(SUNSPEC.glob("model_*.json")):
        found = importers.read("sunspec", path.read_text(encoding="utf-8"), path.name)
        from_model(found.model, path.name)
        assert all("repeats" in note or "is not known" in note for note in found.notes), path.name


WRITERS = [name for name, form in FORMATS.items() if form.writes]


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("name", shipped_names())
def test_what_is_written_is_read_again(form: str, name: str) -> None:
    """Every writer's reader gives back at least tables, addresses and types."""
    profile = shipped(name)
    text = importers.write(form, profile).text
    if form == "toml":
        assert parse(text, "x.toml").model == profile.model
        return
    again = from_model(importers.read(form, text, "x").model, "x")
    places = [{point["at"] for point in one.points} for one in (again, profile)]
    assert places[0] == places[1]
    if form == "csv":
        assert again.model == profile.model


@pytest.mark.parametrize("form", ["telegraf", "homeassistant"])
def test_the_example_survives_the_way_back(form: str) -> None:
    """Out to the other program and back: the same points."""
    profile = from_model(importers.read("csv", CSV, "map").model, "map")
    again = from_model(importers.read(form, importers.write(form, profile).text, "x").model, "x")
    key = lambda point: point["at"]  # noqa: E731 - a word would say no more
    assert sorted(again.points, key=key) == sorted(profile.points, key=key)


def test_every_importer_is_in_the_registry() -> None:
    """Every module with `read` or `write` but the helpers."""
    folder = ROOT / "dissectors" / "importers"
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__", "draft"}
    assert modules == {form.module for form in FORMATS.values()}
