r"""Recordings, profiles and maps whose texts would take over a terminal that they reach.

`HOSTILE` is in names of files and members, in names of interfaces, buses and registers, in what
a device reports about itself, and in lines that are not understood.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from email.message import EmailMessage
from pathlib import Path

import _modlens
from tests.support.captures import EPOCH, epb, idb, section

__all__ = ["HOSTILE", "MAPS", "UNSAFE", "bus_file", "frames", "make"]

HOSTILE = "p\x1b[2J\x1b]0;t\x07\u009b31m\u0085\x08\r\u202eexe.\u2066\u061c\u200b\x7f"
"""Clears the screen, sets a title, a colour by C1, goes back, and turns the direction of text."""

UNSAFE = (
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
    "|\r(?!\n)"
)
"""What ECMA-48 (C0, DEL, C1) and Unicode (bidirectional marks, 9.1 of UAX #9) let a text do."""

RTAC = 250
IN_TOML = HOSTILE.encode("unicode_escape").decode().replace("\\x", "\\u00")


def _frame(body: bytes) -> bytes:
    return body + _modlens.crc16(body).to_bytes(2, "little")


def frames() -> list[bytes]:
    """Requests and responses: registers, the server's name (function 17), identification (43)."""
    said = HOSTILE.encode()
    registers = said[:8]
    objects = b"".join(bytes([number, len(said)]) + said for number in range(3))
    identification = b"\x01\x2b\x0e\x01\x01\x00\x00\x03" + objects
    bodies = [
        b"\x01\x03\x00\x00\x00\x04", b"\x01\x03\x08" + registers,
        b"\x01\x11", bytes([1, 17, len(said) + 2, 7, 0xFF]) + said,
        b"\x01\x2b\x0e\x01\x00", identification,
        b"\x01\x03\x00\x00\x00\x01", b"\x01\x83\x02",
        b"\x01\x41\x1b\x5b\x32\x4a",
    ]  # fmt: skip
    refused = [b"\x01\x06\x00\x09\x00\x01", b"\x01\x86\x02"] * 40
    return [_frame(body) for body in (*bodies, *refused)]


def make(folder: Path) -> dict[str, Path]:
    """Write all of it below `folder`; gives each by a plain word."""
    evil = folder / HOSTILE
    evil.mkdir()
    wire = frames()
    made = {
        "text": _write(evil / f"{HOSTILE}.log", _log(wire)),
        "raw": _write(evil / f"{HOSTILE}.bin", b"".join(wire)),
        "pcapng": _write(evil / f"{HOSTILE}.pcapng", _capture(wire)),
        "zip": _zip(evil / f"{HOSTILE}.zip", _log(wire)),
        "mail": _write(evil / f"{HOSTILE}.eml", _mail(_log(wire))),
        "chunks": _write(evil / f"{HOSTILE}.jsonl", _chunks(wire)),
        "profile": _write(evil / f"{HOSTILE}.toml", _profile().encode()),
        "bus": _write(folder / "bus.toml", bus_file("/dev/ttyUSB0").encode()),
        "functions": _write(evil / "f.toml", _functions().encode()),
        "dialects": _write(evil / "d.toml", _dialects().encode()),
        "damaged": _write(evil / f"{HOSTILE}.sr", b"PK\x03\x04" + HOSTILE.encode()),
        "nothing": evil / f"not there {HOSTILE}.hex",
    }
    for name, text in MAPS.items():
        made[f"map {name}"] = _write(evil / f"{name}{HOSTILE}{MAP_SUFFIXES[name]}", text.encode())
    return made


def _write(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def _log(wire: list[bytes]) -> bytes:
    """Lines with times, and two that are not understood, one of them with hex."""
    lines = [
        f"2026-11-21T14:{number // 60:02}:{number % 60:02}.000Z {frame.hex()}"
        for number, frame in enumerate(wire)
    ]
    text = HOSTILE.replace("\r", "").replace("\x85", "")
    return "\n".join([*lines, f"{text} no bytes", f"{text} 01 03 {text}", ""]).encode()


def _capture(wire: list[bytes]) -> bytes:
    """A pcapng with a hostile interface name (2), description (3) and hardware (15)."""
    names = [(number, HOSTILE.encode()) for number in (2, 3, 12, 15)]
    out = section() + idb(RTAC, names)
    for number, frame in enumerate(wire):
        head = (EPOCH + number).to_bytes(4, "big") + bytes(4) + b"\x00\x01\x00\x00"
        out += epb(head + frame, (EPOCH + number) * 1_000_000)
    return out


def _zip(path: Path, data: bytes) -> Path:
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr(f"{HOSTILE}/{HOSTILE}.log", data)
        packed.writestr(f"{HOSTILE}.png", b"\x89PNG\r\n\x1a\n" + HOSTILE.encode())
        packed.writestr(f"{HOSTILE}.zip", b"PK\x03\x04 and no more")
    return path


def _mail(data: bytes) -> bytes:
    mail = EmailMessage()
    mail["Subject"] = "bus"
    mail.set_content("as attached")
    name = HOSTILE.replace("\r", "").replace("\x85", "")
    mail.add_attachment(data, maintype="application", subtype="octet-stream", filename=name)
    return mail.as_bytes()


def _chunks(wire: list[bytes]) -> bytes:
    rows = [{"t": EPOCH + number, "hex": frame.hex()} for number, frame in enumerate(wire)]
    rows[-1]["note"] = HOSTILE
    return "".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows).encode()


def _profile() -> str:
    return f"""profile = 1
[device]
id = "evil.pump"
vendor = "{IN_TOML}"
model = "{IN_TOML}"
source = "{IN_TOML}"
address_base = 0
[[registers]]
at = "hr:0"
name = "speed"
type = "u16"
unit = "{IN_TOML}"
note = "{IN_TOML}"
enum = {{ 28699 = "{IN_TOML}" }}
[[registers]]
at = "hr:1"
name = "text"
type = "str"
count = 3
"""


def bus_file(port: str) -> str:
    """A bus file with a hostile name and note."""
    return f"""plant = 1
[[bus]]
name = "{IN_TOML}"
note = "{IN_TOML}"
port = "{port}"
line = "19200-8E1"
"""


def _functions() -> str:
    return f"""format = 1
[[function]]
code = 0x41
name = "{IN_TOML}"
section = "vendor"
summary = "{IN_TOML}"
request = ["data:bytes"]
response = ["data:bytes"]
operation = "other"
example = {{ request = "41 1B5B324A", response = "41 1B5B324A" }}
"""


def _dialects() -> str:
    return f"""format = 1
[[dialect]]
name = "evil"
title = "{IN_TOML}"
clock = "none"
sample = "evil> 01 11 c0 2c"
bytes = ["> 01 11 c0 2c"]
sent = ["evil> {{hex}}"]
"""


_YAML = json.dumps(HOSTILE)
MAPS: Mapping[str, str] = {
    "csv": f'name,address,type,unit,what\n"{HOSTILE}",0,u16,"{HOSTILE}","{HOSTILE}"\n'
    f'a,"{HOSTILE}",u16,,\n',
    "telegraf": f'[[inputs.modbus]]\nname = "{IN_TOML}"\nslave_id = 1\nholding_registers = [\n'
    f'{{ name = "{IN_TOML}", byte_order = "AB", data_type = "UINT16", scale=1.0, address = [0]}},\n'
    f'{{ name = "b", byte_order = "{IN_TOML}", data_type = "{IN_TOML}", address = [1]}}]\n',
    "homeassistant": f"modbus:\n  - name: {_YAML}\n    type: tcp\n    host: h\n    sensors:\n"
    f"      - name: {_YAML}\n        address: 0\n        slave: 1\n"
    f"        unit_of_measurement: {_YAML}\n        {_YAML}: {_YAML}\n",
    "esphome": f"sensor:\n  - platform: modbus_controller\n    name: {_YAML}\n"
    f"    register_type: holding\n    address: 0\n    value_type: U_WORD\n"
    f"    {_YAML}: !lambda {_YAML}\n",
}
"""Importer -> a register map with hostile names, units and keys."""

MAP_SUFFIXES = {"csv": ".csv", "telegraf": ".conf", "homeassistant": ".yaml", "esphome": ".yaml"}
