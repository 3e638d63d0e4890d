"""Things of openHAB's Modbus binding: pollers give the table, data things the rest."""

from __future__ import annotations

import pytest

from dissectors import importers
from dissectors.errors import UsageError
from dissectors.importers import Options

TEXT = """
// one inverter
Bridge modbus:tcp:inverter "Inverter" @ "Roof" [ host="192.0.2.1", port=502, id=3 ] {
    Bridge poller holding [ start=100, length=20, refresh=1000, type="holding" ] {
        Thing data power "Power" [ readStart="100", readValueType="int32_swap" ]
        Thing data mode [ readStart="102", readValueType="uint16", writeStart="102",
                          writeValueType="int16", writeType="holding" ]
        Thing data low [ readStart="103.0", readValueType="uint8" ]
        Thing data high [ readStart="103.1", readValueType="int8" ]
        Thing data alarm [ readStart="104.15", readValueType="bit" ]
        Thing data scaled [ readStart="105", readValueType="int16", readTransform="JS(div10.js)" ]
    }
    /* Bridge poller none [ start=0, length=1, type="input" ] { } */
    Bridge poller coils [ start=4, length=2, type="coil" ] {
        Thing data pump [ readStart="4", readValueType="bit", writeStart="4", writeType="coil" ]
    }
    Thing data command [ writeStart="200", writeValueType="int16", writeType="holding" ]
}
Bridge modbus:serial:meter [ port="/dev/ttyUSB0", id=7 ] {
    Bridge poller inputs [ start=0, length=4, type="input" ] {
        Thing data volt [ readStart="2", readValueType="float32" ]
    }
}
"""


def test_every_kind_of_data_thing() -> None:
    found = importers.read("openhab", TEXT, "x.things", Options(unit=3))
    points = {point["name"]: point for point in found.model["registers"]}
    power = points["power"]
    assert (power["at"], power["type"], power["order"]) == ("hr:100", "s32", "CDAB")
    assert (points["mode"]["at"], points["mode"]["access"]) == ("hr:102", "rw")
    assert (points["low"]["at"], points["low"]["type"]) == ("hr:103", "u8l")
    assert (points["high"]["at"], points["high"]["type"]) == ("hr:103", "s8h")
    assert points["alarm"]["at"] == "hr:104.15"
    assert (points["pump"]["at"], points["pump"]["access"]) == ("co:4", "rw")
    assert (points["command"]["at"], points["command"]["access"]) == ("hr:200", "w")
    assert any("JS(div10.js)" in note for note in found.notes)
    assert "volt" not in points


def test_several_devices_have_to_be_chosen_from() -> None:
    with pytest.raises(UsageError, match="3, 7"):
        importers.read("openhab", TEXT, "x.things")
    (point,) = importers.read("openhab", TEXT, "x", Options(unit=7)).model["registers"]
    assert point == {"at": "ir:2", "name": "volt", "type": "f32"}
