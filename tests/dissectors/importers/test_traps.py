"""The traps of addresses (section 1.2 of the survey of register maps), each as a named test.

| trap | tests |
| --- | --- |
| 1 one register has five names | `test_trap_1_*`, and the readings of both device documents |
| 2 five digits stop at 9999, mix with six; a bare 40001 may be on the wire | `test_trap_2_*` |
| 3 other tools number otherwise | `test_trap_3_*` |
| 4 bits are counted from three ends | `test_trap_4_*` |
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import decode
from dissectors.errors import ProfileError
from dissectors.profile import parse
from tests.conftest import Modlens
from tests.support.importing import notes, points


def table(*rows: str, head: str = "Address,Name") -> str:
    """A small CSV."""
    return "\n".join([head, *rows]) + "\n"


def place(at: str, base: int | str) -> Any:
    """The wire address of a point in a profile of one's own."""
    said = f'"{base}"' if isinstance(base, str) else base
    text = f"""
profile = 1
device = {{ address_base = {said} }}
[[registers]]
at = "{at}"
name = "x"
"""
    return parse(text, "p.toml").points[0]["at"]


FIVE_NAMES = [("107", 0), ("0x6B", 0), ("108", 1), ("40108", "modicon"), ("400108", "modicon")]


@pytest.mark.parametrize(("text", "base"), FIVE_NAMES)
def test_trap_1_one_register_has_five_names(text: str, base: int | str) -> None:
    """107 on the wire, 108, 40108, 400108; which one, the base says: in tables and in profiles."""
    assert points("csv", table(f"{text},x"), base=base)["x"]["at"] == "hr:107"
    assert place(f"hr:{text}", base) == "hr:107"


def test_trap_1_the_fifth_name_hr108() -> None:
    """The table in front of the number, which counts from 1."""
    for text in ("HR108", "hr 108", "hr:108"):
        assert points("csv", table(f"{text},x"), base=1)["x"]["at"] == "hr:107"


def test_trap_1_the_five_names_are_one_row_of_a_recording(tmp_path: Path, modlens: Modlens) -> None:
    """A filter takes any of them, and the table shows each: they are one transaction."""
    frames = [bytes.fromhex(text) for text in ("0103006B0001", "01030200FF")]
    lines = [(one + _modlens.crc16(one).to_bytes(2, "little")).hex(" ") for one in frames]
    path = tmp_path / "bus.hex"
    path.write_text("\n".join(lines) + "\n")
    for literal in ("107", "0x6B", "'40108'", "'400108'", "'4x006B'"):
        assert len(list(decode(str(path)).transactions.where(f"address == {literal}"))) == 1
    for base, shown in [("wire", "107"), ("5digit", "40108"), ("6digit", "400108"), ("hex", "6B")]:
        assert shown in modlens("map", str(path), "--address", base).out


def test_trap_2_five_digits_stop_at_9999() -> None:
    """49999 is the last of five digits; 410000 goes on; 50000 is nothing."""
    found = points("csv", table("49999,a", "410000,b", "465536,c"), base="modicon")
    assert [point["at"] for point in found.values()] == ["hr:9998", "hr:9999", "hr:65535"]
    assert place("hr:49999", "modicon") == "hr:9998"
    with pytest.raises(ProfileError, match="50000 is not a Modicon address"):
        place("hr:50000", "modicon")
    said = notes("csv", table("40001,x", "50000,y"), base="modicon")
    assert said == ["line 3, y: '50000' is not a Modicon address; skipped"]


def test_trap_2_five_and_six_digits_may_be_mixed() -> None:
    """One file may have addresses of five and of six digits."""
    found = points("csv", table("40001,a", "400002,b", "30003,c", "300004,d"), base="modicon")
    assert [point["at"] for point in found.values()] == ["hr:0", "hr:1", "ir:2", "ir:3"]


def test_trap_2_a_bare_40001_is_never_converted_by_itself() -> None:
    """It can be a wire address (SunSpec's 40000, modpoll's 30000); what was assumed is printed."""
    text = table("40001,x", "30000,y")
    assert [point["at"] for point in points("csv", text).values()] == ["hr:40001", "hr:30000"]
    assert place("hr:40001", 0) == "hr:40001"
    assert place("hr:40001", 1) == "hr:40000"


def test_trap_2_what_was_assumed_is_printed(tmp_path: Path, modlens: Modlens) -> None:
    """On standard error, with the option that says otherwise."""
    path = tmp_path / "map.csv"
    path.write_text(table("40001,x"))
    done = modlens("import", "csv", str(path))
    assert 'at = "hr:40001"' in done.out
    assert "addresses count from 0, as on the wire (assumed; --base 0, 1 or modicon overrides)" in (
        done.err
    )
    done = modlens("import", "csv", str(path), "--base", "modicon")
    assert 'at = "hr:0"' in done.out


def test_trap_3_the_change_log_of_zeek_counts_from_1() -> None:
    """Its `address` (of icsnpp) is the wire's, its `modbus_register_change.log` is one more."""
    text = table("1001,x", head="register,name")
    assert points("csv", text, base=1)["x"]["at"] == "hr:1000"
    assert points("csv", table("1000,x", head="address,name"))["x"]["at"] == "hr:1000"


def test_trap_3_sigrok_calls_a_holding_register_31001() -> None:
    """It prints `0x3E8 / 31001` for function 3: the number says input, the function holding.

    Neither is believed by itself: with both in one row it is left out, with a note.
    """
    assert points("csv", table("31001,x"), base="modicon")["x"]["at"] == "ir:1000"
    text = table("40001,3,ok", "31001,3,x", head="Address,Function,Name")
    assert list(points("csv", text, base="modicon")) == ["ok"]
    assert notes("csv", text, base="modicon") == [
        "line 3, x: '31001' is not a Modicon address of hr; skipped"
    ]
    text = table("0x3E8,3,x", head="Address,Function,Name")
    assert points("csv", text)["x"]["at"] == "hr:1000"


def test_trap_4_bits_count_from_the_lowest() -> None:
    """.0 is the lowest bit here, as in most programs; one beyond 15 is refused, not wrapped."""
    found = points("csv", table("10.0,a", "10.15,b"))
    assert [point["at"] for point in found.values()] == ["hr:10.0", "hr:10.15"]
    said = notes("csv", table("10,a", "10.16,x"))
    assert said == ["line 3, x: bit 16 is not one of 0 to 15; skipped"]


def test_trap_4_mervis_counts_them_from_1() -> None:
    """.1 is the lowest bit of a table that is known as theirs by its head; .0 is none."""
    head = "StationNumber,Name,Element,StType"
    text = table("1,a,10.1,BOOL", "1,b,10.16,BOOL", "1,c,10.0,BOOL", head=head)
    found = points("csv", text)
    assert [point["at"] for point in found.values()] == ["hr:10.0", "hr:10.15"]
    assert "line 4, c: bit 0 is not one of 1 to 16; skipped" in notes("csv", text)


def test_trap_4_a_bit_is_the_bit_of_the_value() -> None:
    """Bit 0 of 0x0001 on the wire, whatever a program prints first."""
    from tests.support.readings import read_frames  # noqa: PLC0415 - here only

    registers = "".join(
        f'[[registers]]\nat = "hr:0.{bit}"\nname = "bit{bit}"\n' for bit in (0, 8, 15)
    )
    rows = read_frames(registers, (b"\1\3\0\0\0\1", b"\1\3\2\x80\x01"))
    assert {row.name: row.value for row in rows if row.name} == {"bit0": 1, "bit8": 0, "bit15": 1}
