"""Templates of wb-mqtt-serial, written for this test after the driver's documentation."""

from __future__ import annotations

import pytest

from dissectors import importers
from dissectors.errors import ProfileError

TEXT = """{
  // a template
  "device_type": "Imaginary",
  "device": {
    "name": "Imaginary", /* no
    device */
    "channels": [
      {"name": "Temperature", "reg_type": "input", "address": 0, "format": "s16", "scale": 0.1,
       "error_value": "0x7FFF", "units": "deg C"},
      {"name": "Energy", "reg_type": "input", "address": "0x10", "format": "u32",
       "word_order": "little_endian"},
      {"name": "Flow", "reg_type": "holding", "address": 20, "format": "float", "readonly": true},
      {"name": "Bits", "reg_type": "holding", "address": "109:1:2"},
      {"name": "Relay", "reg_type": "coil", "address": 3, "type": "switch"},
      {"name": "Door", "reg_type": "discrete", "address": 4},
      {"name": "Serial", "reg_type": "input", "address": 200, "format": "string",
       "string_data_size": 12},
      {"name": "Fault", "reg_type": "input", "address": 30, "error_value": "0xFFFF",
       "condition": "mode == 1"},
      {"name": "Other", "reg_type": "press_counter", "address": 5},
    ],
    "parameters": {
      "mode": {"title": "Mode", "address": 40, "enum": [0, 2], "enum_titles": ["off", "on"]},
      "reset": {"title": "Reset", "write_address": 41}
    }
  }
}
"""


def test_every_kind_of_channel_and_parameter() -> None:
    found = importers.read("wb-mqtt-serial", TEXT, "x.json")
    points = {point["name"]: point for point in found.model["registers"]}
    first = points["Temperature"]
    assert (first["at"], first["type"], first["scale"], first["nan"]) == (
        "ir:0",
        "s16",
        0.1,
        [32767],
    )
    energy = points["Energy"]
    assert (energy["at"], energy["type"], energy["order"]) == ("ir:16", "u32", "CDAB")
    assert (points["Flow"]["type"], points["Flow"].get("access")) == ("f32", None)
    assert points["Bits"]["at"] == "hr:109.1-2"
    assert (points["Relay"]["at"], points["Relay"]["access"]) == ("co:3", "rw")
    assert (points["Door"]["at"], points["Door"].get("access")) == ("di:4", None)
    assert (points["Serial"]["type"], points["Serial"]["count"]) == ("strl", 12)
    assert points["Fault"]["nan"] == [65535]
    assert (points["Mode"]["enum"], points["Mode"]["access"]) == ({"0": "off", "2": "on"}, "rw")
    assert (points["Reset"]["at"], points["Reset"]["access"]) == ("hr:41", "w")
    assert "Other" not in points
    assert any(note.startswith("condition") for note in found.notes)
    assert any("licensed" in note for note in found.notes)


def test_a_jinja_template_is_refused() -> None:
    with pytest.raises(ProfileError, match="Jinja"):
        importers.read("wb-mqtt-serial", '{% for i in range(3) %}{"a": 1}{% endfor %}', "x.json")


def test_a_device_of_another_protocol_is_refused() -> None:
    text = '{"device": {"protocol": "dlms", "channels": [{"name": "a", "address": "1.0.12"}]}}'
    with pytest.raises(ProfileError, match="protocol dlms, not Modbus"):
        importers.read("wb-mqtt-serial", text, "x.json")


def test_model_units_of_types_and_switches_that_are_turned() -> None:
    """The type of a control names its unit; a switch may be on where the coil is 0."""
    text = """{"device_type": "x", "device": {"name": "Imaginary 33", "channels": [
      {"name": "Inlet", "reg_type": "input", "address": 403, "format": "s16", "scale": 0.1,
       "type": "temperature"},
      {"name": "Off", "reg_type": "coil", "address": 54, "type": "switch", "on_value": 0,
       "off_value": 1},
      {"name": "Fan", "reg_type": "holding", "address": 5, "type": "switch", "on_value": 3}
    ]}}"""
    found = importers.read("wb-mqtt-serial", text, "x.json")
    assert found.model["device"]["model"] == "Imaginary 33"
    inlet, off, fan = found.model["registers"]
    assert (inlet["unit"], inlet["scale"]) == ("°C", 0.1)
    assert off["enum"] == {"1": "off", "0": "on"}
    assert fan["enum"] == {"0": "off", "3": "on"}
