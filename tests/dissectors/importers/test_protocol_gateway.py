"""Tables of PythonProtocolGateway: bits of registers, names in the second column, file names."""

from __future__ import annotations

from dissectors import importers

HEAD = "variable name,data type,register,documented name,unit,values,note\n"


def test_parts_of_registers_texts_and_names() -> None:
    text = (
        f"{HEAD}PV1,,1,Vpv1,0.1V,0-65535,\n,8bit,5,SOC,%,0-100,\n,8bit,5.b8,SOH,%,0-100,\n"
        ",1bit,77.b2,Enabled,,0 or 1,\n,ASCII,115~119,Serial Number,,,\n,SHORT,98,Current,0.1A,,\n"
    )
    found = importers.read("csv", text, "maps/x.input_registry_map.csv")
    points = {point["name"]: point for point in found.model["registers"]}
    assert (points["PV1"]["at"], points["PV1"]["scale"], points["PV1"]["unit"]) == (
        "ir:1",
        0.1,
        "V",
    )
    assert (points["SOC"]["at"], points["SOH"]["at"]) == ("ir:5.0-7", "ir:5.8-15")
    assert points["Enabled"]["at"] == "ir:77.2"
    serial = points["Serial Number"]
    assert (serial["at"], serial["type"], serial["count"]) == ("ir:115", "str", 5)
    assert (points["Current"]["type"], points["Current"]["scale"]) == ("s16", 0.1)
    holding = importers.read("csv", text, "maps/x.holding_registry_map.csv")
    assert holding.model["registers"][0]["at"] == "hr:1"
    assert not [note for note in holding.notes if "assumed" in note and "table" in note]


def test_names_halves_and_access() -> None:
    """The documented name is the name, half a register is its eight bits, W is also read."""
    text = (
        "variable name;data type;writable;register;documented name;description;values;unit\n"
        ";;;5;Reserved;Reserved;;\n"
        ";;;0;firmware;628 is version 6.2.8;;\n"
        ";byte;;3.b8;station;the lower byte;1~255;\n"
        ";8BIT_FLAGS;;11;faults;;;\n"
        ";8BIT_FLAGS ;;11.b8;state;;;\n"
        ";;W;40;ratio;of the transformer;;\n"
        ";UINT8;WD;6;divider;;1~5;0.1S\n"
        "own;;R;7;its title;;;\n"
    )
    found = importers.read("csv", text, "x.holding_registry_map.csv")
    points = {point["name"]: point for point in found.model["registers"]}
    assert {name: point["at"] for name, point in points.items()} == {
        "Reserved": "hr:5",
        "firmware": "hr:0",
        "station": "hr:3.8-15",
        "faults": "hr:11.0-7",
        "state": "hr:11.8-15",
        "ratio": "hr:40",
        "divider": "hr:6.0-7",
        "own": "hr:7",
    }
    assert "note" not in points["Reserved"]
    assert points["firmware"]["note"] == "628 is version 6.2.8"
    assert points["own"]["note"] == "its title"
    assert (points["ratio"]["access"], points["divider"].get("access")) == ("rw", None)
    assert (points["divider"]["scale"], points["divider"]["unit"]) == (0.1, "S")
    assert "a range of values: cannot be kept in a profile (2 times)" in found.notes
    assert not [note for note in found.notes if "not known" in note or "understood" in note]
