"""Configurations of modpoll: its rows of today, and those of its first versions."""

from __future__ import annotations

import pytest

from dissectors import importers

ROWS = "ref,volt,100,uint16,r,V,0.1\nref,energy,102,uint32,rw,kWh\nref,name,104,string4,r\n"


@pytest.mark.parametrize(
    ("word", "order"), [("BE_BE", None), ("LE_BE", "BADC"), ("LE_LE", "DCBA"), ("BE_LE", "CDAB")]
)
def test_the_order_is_bytes_then_words(word: str, order: str | None) -> None:
    text = f"device,meter,1\npoll,input_register,100,10,{word}\n{ROWS}"
    found = importers.read("modpoll", text, "x.csv")
    volt, energy, name = found.model["registers"]
    assert (volt["at"], volt["scale"], volt["unit"]) == ("ir:100", 0.1, "V")
    assert (energy["at"], energy["type"], energy.get("order")) == ("ir:102", "u32", order)
    assert energy["access"] == "rw"
    assert (name["type"], name["count"]) == ("str", 4)


def test_the_former_layout() -> None:
    """The unit is in the row of the poll, the unit of measure in front of the address."""
    text = "poll,plant,9,40001,5,holding_register,BE_BE\nref,a,W,40001,int16,rw,\n"
    (point,) = importers.read("modpoll", text, "x.csv").model["registers"]
    assert point == {"at": "hr:40001", "name": "a", "type": "s16", "unit": "W", "access": "rw"}


def test_bits_and_what_is_not_known() -> None:
    text = "device,d,1\npoll,coil,0,9,BE_BE\nref,a,3,bool,rw\npoll,none,0,1,x\nref,b,1,uint16,r\n"
    found = importers.read("modpoll", text, "x.csv")
    (point,) = found.model["registers"]
    assert point == {"at": "co:3", "name": "a", "access": "rw"}
    assert any("line 4" in note for note in found.notes)
    assert any("line 5, b" in note for note in found.notes)
