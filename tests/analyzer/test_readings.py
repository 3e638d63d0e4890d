"""Readings: named, scaled values of real frames, by profile.

The two device documents print their frames; the expected values are the documents'.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import decode
from tests.conftest import Modlens
from tests.support.readings import read_frames


def recording(path: Path, *frames: str) -> Path:
    """A file of hex lines; frames get their checksum where the document prints none."""
    lines = []
    for text in frames:
        frame = bytes.fromhex(text)
        if _modlens.crc16(frame[:-2]) != int.from_bytes(frame[-2:], "little"):
            frame += _modlens.crc16(frame).to_bytes(2, "little")
        lines.append(frame.hex(" "))
    path.write_text("\n".join(lines) + "\n")
    return path


def named(path: Path, profile: str) -> list[tuple[str | None, Any, str]]:
    """Name, value and what was done, of every reading."""
    rows = decode(path, profiles=[profile]).readings
    return [(row.name, row.value, row.operation) for row in rows]


def test_mightyzap_2_2_1_3_present_position(tmp_path: Path) -> None:
    """Manual, 2.2.1.3 #1: present position 1000, and present current 426."""
    path = recording(
        tmp_path / "bus.hex",
        "01 03 00D2 0001 2433",
        "01 03 02 03E8 B8FA",
        "01 03 00D3 0001 75F3",
        "01 03 02 01AA 39AB",
    )
    assert named(path, "1=mightyzap") == [
        ("present_position", 1000, "read"),
        ("present_current", 426, "read"),
    ]


def test_mightyzap_2_2_2_2_write_single(tmp_path: Path) -> None:
    """Manual, 2.2.2.2: goal position 1000; goal current 800."""
    path = recording(
        tmp_path / "bus.hex",
        "01 06 00CD 03E8 188B",
        "01 06 00CD 03E8 188B",
        "01 06 00D1 0320 D8DB",
        "01 06 00D1 0320 D8DB",
    )
    assert named(path, "1=mightyzap") == [
        ("goal_position", 1000, "write"),
        ("goal_current", 800, "write"),
    ]


def test_mightyzap_2_2_3_3_write_multiple(tmp_path: Path) -> None:
    """Manual, 2.2.3.3 #1: goal speed 1000 and goal current 800 in one request."""
    path = recording(
        tmp_path / "bus.hex", "01 10 00D0 0002 04 03E8 0320 7FAB", "01 10 00D0 0002 4031"
    )
    assert named(path, "1=mightyzap") == [
        ("goal_speed", 1000, "write"),
        ("goal_current", 800, "write"),
    ]


def test_mightyzap_2_2_1_3_request_not_ok(tmp_path: Path) -> None:
    """Manual, 2.2.1.3: the refusal with the checksum that is printed, 40 F3."""
    path = recording(tmp_path / "bus.hex", "01 03 00D3 0001 75F3", "01 83 04 40F3")
    (row,) = decode(path, profiles=["1=mightyzap"])
    assert (row.status, row.exception) == ("exception", 4)
    assert named(path, "1=mightyzap") == []


def test_mightyzap_2_2_2_2_a_misprint(tmp_path: Path) -> None:
    """Manual, 2.2.2.2: the refusal of a write has the checksum of 2.2.1.3's; it is 43 A3.

    CRC-16/MODBUS of 01 86 04, by the specification's appendix B.
    """
    path = tmp_path / "bus.hex"
    for checksum, status in [("40F3", "bad_response"), ("43A3", "exception")]:
        path.write_text(f"0106 00D1 0320 D8DB\n018604 {checksum}\n")
        (row,) = decode(path, profiles=["1=mightyzap"])
        assert row.status == status


def test_mightyzap_2_1_2_6_exceptions(tmp_path: Path) -> None:
    """Manual, 2.1.2.6 and 2.2.2.2: the device's own words for code 4."""
    path = recording(tmp_path / "bus.hex", "01 06 00D1 0320 D8DB", "01 86 04")
    (row,) = decode(path, profiles=["mightyzap"])
    assert (
        row.exception_name
        == "Server Device Failure (device failure, parameter setting value error)"
    )
    (plain,) = decode(path)
    assert plain.exception_name == "Server Device Failure"


def test_grundfos_13_2_holding_registers(tmp_path: Path) -> None:
    """Chapter 13.2: address 0x006B is register 108; 108 to 110 hold 1."""
    path = recording(tmp_path / "bus.hex", "01 03 006B 0003", "01 03 06 0001 0001 0001")
    assert named(path, "1=grundfos") == [
        ("register_00108", 1, "read"),
        ("register_00109", 1, "read"),
        ("register_00110", 1, "read"),
    ]


def test_grundfos_13_3_input_registers(tmp_path: Path) -> None:
    """Chapter 13.3: address 0x1010 is register 4113; 4113 to 4115 hold 0x2222."""
    path = recording(tmp_path / "bus.hex", "01 04 1010 0003", "01 04 06 2222 2222 2222")
    assert named(path, "1=grundfos") == [
        ("register_04113", 0x2222, "read"),
        ("register_04114", 0x2222, "read"),
        ("register_04115", 0x2222, "read"),
    ]


def test_grundfos_13_4_write_single(tmp_path: Path) -> None:
    """Chapter 13.4: 0xAFFE to the register at address 0x1000."""
    path = recording(tmp_path / "bus.hex", "01 06 1000 AFFE", "01 06 1000 AFFE")
    assert named(path, "1=grundfos") == [("register_04097", 0xAFFE, "write")]


def test_grundfos_13_4_setpoint(tmp_path: Path) -> None:
    """Chapter 13.4: "register 00104 (setpoint) is addressed as 00103".

    The chapter prints no frame for it: this one is ours.
    """
    path = recording(tmp_path / "bus.hex", "01 06 0067 1388", "01 06 0067 1388")
    assert named(path, "1=grundfos") == [("setpoint", 5000, "write")]


U32 = '[[registers]]\nat = "hr:10"\nname = "energy"\ntype = "u32"\nunit = "kWh"\n'


def read(address: int, data: bytes) -> tuple[bytes, bytes]:
    """A read of holding registers of unit 1."""
    request = b"\x01\x03" + address.to_bytes(2, "big") + (len(data) // 2).to_bytes(2, "big")
    return request, b"\x01\x03" + bytes([len(data)]) + data


def test_a_value_split_over_two_reads_is_not_put_together() -> None:
    """Each half is a bare register; who sees both may have read them at different times."""
    rows = read_frames(U32, read(9, b"\0\1\0\2"), read(11, b"\0\3"))
    assert [(row.address, row.name, row.value) for row in rows] == [
        (9, None, 1), (10, None, 2), (11, None, 3)
    ]  # fmt: skip


def test_registers_around_a_value_stay() -> None:
    """Nothing that was read is lost because a profile does not know it."""
    rows = read_frames(U32, read(9, b"\0\1\0\1\0\2\0\4"))
    assert [
        (row.address, row.name, row.raw, row.value_text, row.unit_of_measure) for row in rows
    ] == [
        (9, None, [1], "1", None),
        (10, "energy", [1, 2], "65538", "kWh"),
        (12, None, [4], "4", None),
    ]


def test_an_answer_shorter_than_asked_is_not_filled_up() -> None:
    """A value whose second register is missing gives no reading but that of its first register."""
    request, _ = read(10, b"\0\0\0\0")
    rows = read_frames(U32, (request, b"\x01\x03\x02\x00\x07"))
    assert [row.name for row in rows if row.name] == []


def test_integers_stay_exact() -> None:
    """2^64 - 1 has no float64: the number is empty, the text is not."""
    point = '[[registers]]\nat = "hr:0"\nname = "n"\ntype = "u64"\n'
    (row,) = read_frames(point, read(0, b"\xff" * 8))
    assert (row.value, row.value_text) == (None, "18446744073709551615")


def test_scale_factors_of_the_same_read_and_of_an_earlier_one() -> None:
    """The exponent is used from the moment it has been seen; before there is no value."""
    points = """
[[registers]]
at = "hr:0"
name = "power"
type = "s16"
sf = "power_sf"
unit = "W"
[[registers]]
at = "hr:1"
name = "power_sf"
type = "s16"
"""
    rows = read_frames(
        points, read(0, b"\x01\x00"), read(0, b"\x01\x00\xff\xfe"), read(0, b"\x02\x00")
    )
    powers = [row.value_text for row in rows if row.name == "power"]
    assert powers == [None, "2.56", "5.12"]


def test_coils_and_arrays(tmp_path: Path) -> None:
    """Bits of a coil block have names; an array has a row an element."""
    text = """
profile = 1
[[registers]]
at = "co:2"
name = "pump"
enum = {0 = "off", 1 = "on"}
[[registers]]
at = "hr:0"
name = "t"
type = "u32"
count = 4
"""
    profile = tmp_path / "p.toml"
    profile.write_text(text)
    path = recording(
        tmp_path / "bus.hex",
        "01 01 0001 0003", "01 01 01 02",
        "01 03 0000 0004", "01 03 08 00000001 00000002",
        "01 05 0002 FF00", "01 05 0002 FF00",
    )  # fmt: skip
    rows = [(row.name, row.value_text) for row in decode(path, profiles=[str(profile)]).readings]
    assert rows == [
        (None, "0"), ("pump", "on"), (None, "0"), ("t[0]", "1"), ("t[1]", "2"), ("pump", "on")
    ]  # fmt: skip


def test_every_export_has_them(tmp_path: Path, modlens: Modlens) -> None:
    """Columns, the map of the transactions table, and filters."""
    path = recording(
        tmp_path / "bus.hex", "01 10 00D0 0002 04 03E8 0320 7FAB", "01 10 00D0 0002 4031"
    )
    words = ("decode", str(path), "--profile", "1=mightyzap")
    where = 'name == "goal_speed" and value > 900'
    done = modlens(*words, "--table", "readings", "--where", where, "--to", "csv",
                   "--columns", "name,value,value_text,raw")  # fmt: skip
    assert done.out == "name,value,value_text,raw\r\ngoal_speed,1000,1000,1000\r\n"
    done = modlens(*words, "--to", "jsonl", "--columns", "readings")
    assert done.out == '{"readings":{"goal_speed":1000,"goal_current":800}}\n'
    done = modlens(*words)
    assert "goal_speed=1000" in done.out


def test_other_units_have_no_names(tmp_path: Path) -> None:
    """Units without a bound profile have no names."""
    path = recording(tmp_path / "bus.hex", "02 03 00D2 0001", "02 03 02 03E8")
    with pytest.warns(UserWarning, match="for unit 1, which was not heard; there are 2"):
        assert named(path, "1=mightyzap") == [(None, 1000, "read")]
    assert named(path, "1-3=mightyzap") == [("present_position", 1000, "read")]


@pytest.mark.parametrize(
    ("option", "part"),
    [
        ("1=mightyzip", "did you mean 'mightyzap'"),
        ("300=mightyzap", "0 to 255"),
        ("5-2=mightyzap", "the lower one first"),
        ("1=", "such as 1=mightyzap"),
        ("1=nowhere.toml", "No such file"),
    ],
)
def test_wrong_bindings_are_refused(
    option: str, part: str, tmp_path: Path, modlens: Modlens
) -> None:
    """Invalid bindings are refused before anything is decoded."""
    path = recording(tmp_path / "bus.hex", "02 03 00D2 0001", "02 03 02 03E8")
    done = modlens("decode", str(path), "--profile", option)
    assert done.status in (2, 3)
    assert part in done.err


@pytest.mark.parametrize(("scale", "value"), [("0.1", "21.4"), ("0.01", "2.14"), ("1", "214")])
def test_a_filter_compares_the_scaled_value(
    tmp_path: Path, modlens: Modlens, scale: str, value: str
) -> None:
    """Register 107 holds 214 (00D6); a limit between the raw number and the scaled one reports."""
    (tmp_path / "meter.toml").write_text(
        f"profile = 1\n[[registers]]\nat = 'hr:107'\nname = 'volts'\nscale = {scale}\n"
    )
    path = recording(tmp_path / "bus.hex", "11 03 006B 0001", "11 03 02 00D6")
    words = ["decode", str(path), "--profile", f"17={tmp_path / 'meter.toml'}"]
    words += ["--table", "readings", "--to", "csv", "--columns", "name,value"]
    kept = {op: modlens(*words, "--where", f"value {op} {float(value) + 0.5}").out for op in "<>"}
    assert kept == {"<": f"name,value\r\nvolts,{value}\r\n", ">": "name,value\r\n"}
