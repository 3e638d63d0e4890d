"""Templates of evcc: the registers between the conditions, each once, with their scales."""

from __future__ import annotations

import pytest

from dissectors import importers
from dissectors.errors import ProfileError

TEXT = """\
template: imaginary
products:
  - brand: Imaginary
params:
  - name: usage
    choice: ["grid", "battery"]
render: |
  type: custom
  {{- if eq .usage "grid" }}
  power:
    source: modbus
    {{- include "modbus" . | indent 2 }}
    register:
      address: 40 # meter power
      type: holding
      decode: int32s
    scale: -1
  currents:
    - source: modbus
      {{- include "modbus" . | indent 4 }}
      register:
        address: 50
        type: input
        decode: uint16nan
      scale: 0.01
    - source: modbus
      register:
        address: 51
        type: input
        decode: uint16nan
      scale: 0.01
  {{- end }}
  {{- if eq .usage "battery" }}
  power:
    source: calc
    add:
    - source: modbus
      register:
        address: 60
        type: holding
        decode: float32
    - source: modbus
      scale: 0.1
      register:
        address: 62
        type: holding
        decode: int16
  soc:
    source: modbus
    register:
      address: {{ .address }}
      type: holding
      decode: uint16
  limit:
    source: const
    value: 1
    set:
      source: modbus
      register:
        address: 70
        type: writesingle
        decode: uint16
  again:
    source: modbus
    register:
      address: 40
      type: holding
      decode: int32s
  {{- end }}
"""


def test_every_register_of_every_case() -> None:
    """Address, type, order, scale and name; scales are in front of a register or after it."""
    found = importers.read("evcc", TEXT, "x.yaml")
    points = {point["at"]: point for point in found.model["registers"]}
    power = points["hr:40"]
    assert (power["name"], power["type"], power["order"]) == ("grid_power", "s32", "CDAB")
    assert (power["scale"], power["note"]) == (-1, "meter power")
    for at in ("ir:50", "ir:51"):
        assert (points[at]["scale"], points[at]["nan"]) == (0.01, [65535])
        assert points[at].get("type", "u16") == "u16"
    assert points["hr:60"]["type"] == "f32"
    assert "scale" not in points["hr:60"]
    assert (points["hr:62"]["type"], points["hr:62"]["scale"]) == ("s16", 0.1)
    assert points["hr:70"]["access"] == "rw"
    assert len(points) == 6
    assert any("soc" in note and "skipped" in note for note in found.notes)


def test_a_template_without_registers_says_why() -> None:
    text = "template: x\nrender: |\n  type: mbmd\n  model: SDM\n"
    with pytest.raises(ProfileError, match="of its own list"):
        importers.read("evcc", text, "x.yaml")


def test_maker_and_lists_that_stand_as_far_in_as_their_keys() -> None:
    """YAML lets a list be below its key without being further in."""
    text = """\
template: imaginary
products:
  - brand: Imaginary
    description:
      generic: Smile # all of them
  - brand: Imaginary
params:
  - name: modbus
render: |
  power:
    source: modbus
    register:
      address: 33
      type: holding
      decode: int32
  currents:
  - source: modbus
    register:
      address: 23
      type: holding
      decode: int16
    scale: 0.1
  - source: modbus
    register:
      address: 24
      type: holding
      decode: int16
    scale: 0.1
"""
    found = importers.read("evcc", text, "x.yaml")
    assert (found.model["device"]["vendor"], found.model["device"]["model"]) == (
        "Imaginary",
        "Smile",
    )
    names = [(point["at"], point["name"]) for point in found.model["registers"]]
    assert names == [("hr:33", "power"), ("hr:23", "currents"), ("hr:24", "currents_2")]
