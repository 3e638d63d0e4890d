"""Inverter definitions of solarman: which registers, in which order, what they mean.

The definition is made up; how it is to be read follows from the integration's documentation.
"""

from __future__ import annotations

import pytest

from dissectors import importers
from dissectors.errors import ProfileError

TEXT = """
requests:
  - {start: 0x0003, end: 0x0070, mb_functioncode: 0x03}
  - {start: 0x0100, end: 0x0120, mb_functioncode: 0x04}
parameters:
  - group: solar
    items:
      - name: "PV power"
        class: "power"
        state_class: "measurement"
        uom: "W"
        scale: 1
        rule: 1
        registers: [0x0010]
        icon: "mdi:solar-power"
      - {name: total, uom: kWh, scale: 0.1, rule: 3, registers: [0x0012, 0x0013]}
      - {name: turned, uom: kWh, scale: 0.1, rule: 4, registers: [0x0015, 0x0014]}
      - {name: temperature, uom: "°C", scale: 0.1, offset: 1000, rule: 2, registers: [0x0016]}
  - group: state
    items:
      - name: state
        rule: 1
        registers: [0x0100]
        lookup:
          - {key: 0, value: "standby"}
          - {key: [1, 2], value: "running"}
      - {name: serial, rule: 5, registers: [3, 4, 5, 6, 7]}
      - {name: alarms, rule: 6, registers: [0x0102, 0x0101]}
      - {name: start time, rule: 9, registers: [0x0103]}
      - {name: mode, rule: 1, mask: 0x0030, registers: [0x0104], lookup: [{key: 16, value: one}]}
      - {name: apart, rule: 3, registers: [0x0020, 0x0030]}
      - {name: odd, rule: 42, registers: [0x0021]}
      - {name: nothing, rule: 1, registers: []}
"""


def test_every_kind_of_item() -> None:
    """Type, order, scale, table and labels of each; what cannot be kept is a note."""
    found = importers.read("solarman", TEXT, "x.yaml")
    points = {point["name"]: point for point in found.model["registers"]}
    assert points["PV power"] == {"at": "hr:16", "name": "PV power", "unit": "W", "group": "solar"}
    total, turned = points["total"], points["turned"]
    assert (total["at"], total["type"], total["order"]) == ("hr:18", "u32", "CDAB")
    assert (turned["at"], turned["type"], turned.get("order")) == ("hr:20", "s32", None)
    # (raw - 1000) * 0.1
    assert (points["temperature"]["scale"], points["temperature"]["offset"]) == (0.1, -100)
    assert points["state"]["at"] == "ir:256"
    assert points["state"]["enum"] == {"0": "standby", "1": "running", "2": "running"}
    assert (points["serial"]["type"], points["serial"]["count"]) == ("str", 5)
    assert points["alarms"]["count"] == 2
    assert points["start time"]["at"] == "ir:259"
    assert (points["mode"]["at"], points["mode"]["enum"]) == ("ir:260.4-5", {"1": "one"})
    assert {"apart", "odd", "nothing"} & set(points) == set()
    for name in ("apart", "odd", "nothing"):
        assert any(note.startswith(f"{name}: ") for note in found.notes), name


def test_other_yaml_is_refused() -> None:
    with pytest.raises(ProfileError, match="no parameters"):
        importers.read("solarman", "a: 1\n", "x.yaml")


def test_maker_and_what_is_written() -> None:
    """Who makes it is in the profile; an entity that is set is written; sums have no place."""
    text = """
info: {manufacturer: Imaginary, model: [One, Two]}
parameters:
  - group: settings
    items:
      - {name: limit, platform: number, rule: 1, registers: [0xE00F], configurable: {mode: box}}
      - {name: power, platform: sensor, rule: 1, registers: [0x0010]}
      - {name: product, rule: 1, sensors: [{registers: [1]}, {operator: multiply, registers: [2]}]}
"""
    found = importers.read("solarman", text, "x.yaml")
    device = found.model["device"]
    assert (device["vendor"], device["model"]) == ("Imaginary", "One, Two")
    points = {point["name"]: point for point in found.model["registers"]}
    assert (points["limit"]["at"], points["limit"]["access"]) == ("hr:57359", "rw")
    assert "access" not in points["power"]
    assert "product: calculated from registers of other items; skipped" in found.notes
