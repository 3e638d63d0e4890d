"""The words beside the bytes, function by function."""

from __future__ import annotations

import pytest

from dissectors.describe import describe
from dissectors.table import Direction


def meanings(pdu: str, direction: Direction, request: str | None = None) -> dict[str, str]:
    """Return the meaning of every block of a PDU."""
    asked = None if request is None else bytes.fromhex(request)
    pieces = describe(bytes.fromhex(pdu), mode="pdu", direction=direction, request=asked)
    return {piece.name: piece.meaning for piece in pieces}


@pytest.mark.parametrize(
    ("pdu", "name", "meaning"),
    [
        ("03 006B 0003", "address", "107 = 0x006B, 400108 (40108)"),
        ("03 006B 0003", "quantity", "3 registers, 400108 to 400110"),
        ("03 006B 0001", "quantity", "1 register, 400108"),
        ("04 0008 0001", "address", "8 = 0x0008, 300009 (30009)"),
        ("02 00C4 0016", "address", "196 = 0x00C4, 100197 (10197)"),
        ("01 2710 0002", "address", "10000 = 0x2710, 010001"),
        ("05 00AC FF00", "value", "coil 173 on"),
        ("05 00AC 0000", "value", "coil 173 off"),
        ("06 0001 FFFE", "value", "400002: u16 65534, s16 -2, 0xFFFE"),
        ("0F 0013 000A 02 CD01", "coils[1]", "coil 28 on, 29 off; 6 padding bits"),
        ("10 0001 0002 04 000A 8000", "registers[1]", "400003: u16 32768, s16 -32768, 0x8000"),
        ("16 0004 00F2 0025", "and_mask", "0x00F2, bits kept: 1, 4, 5, 6, 7"),
        ("16 0004 00F2 0000", "or_mask", "0x0000, bits set where not kept: none"),
        ("17 0003 0006 000E 0001 02 00FF", "quantity", "6 registers, 400004 to 400009"),
        ("17 0003 0006 000E 0001 02 FF", "write_quantity", "1 register, 400015"),
        ("17 0003 0006 000E 0001 02 0001", "write_registers[0]", "400015: u16 1, s16 1, 0x0001"),
        ("18 04DE", "address", "queue at 1246 = 0x04DE"),
        ("14 07 06 0004 0001 0002", "groups[0].length", "2 registers"),
        ("08 000B 0000", "function", "Diagnostics, request"),
        ("08 0004 0000", "function", "Diagnostics (Force Listen Only Mode), request"),
        ("2B 0E 04 80", "object_id", "Private"),
        ("2B 63 00", "mei_type", "not in the specification"),
        ("46 01", "function", "function 70, user-defined, not in the table, request"),
        ("4A 01", "function", "function 74, not in the table, request"),
        ("5A 0002", "extra", "no layout is known for this content"),
    ],
)  # fmt: skip
def test_requests(pdu: str, name: str, meaning: str) -> None:
    """Addresses in both notations, values in every base that fits."""
    assert meanings(pdu, "request")[name] == meaning


@pytest.mark.parametrize(
    ("pdu", "request_pdu", "name", "meaning"),
    [
        ("01 03 CD6B05", "01 0013 0013", "coils[0]",
         "coil 20 on, 21 off, 22 on, 23 on, 24 off, 25 off, 26 on, 27 on"),
        ("01 03 CD6B05", "01 0013 0013", "coils[2]", "coil 36 on, 37 off, 38 on; 5 padding bits"),
        ("01 01 05", None, "coils[0]", "bit 0 on, 1 off, 2 on, 3 off, 4 off, 5 off, 6 off, 7 off"),
        ("01 02 0500", "01 0000 0003", "coils[1]", "8 padding bits"),
        ("02 01 01", "02 00C4 0001", "inputs[0]", "input 197 on; 7 padding bits"),
        ("03 04 022B FFFF", "03 006B 0002", "registers[1]", "400109: u16 65535, s16 -1, 0xFFFF"),
        ("03 02 022B", None, "registers[0]", "u16 555, s16 555, 0x022B"),
        ("03 02 022B", "04 006B 0001", "registers[0]", "u16 555, s16 555, 0x022B"),
        ("17 02 00FE", "17 0003 0001 000E 0001 02 00FF", "registers[0]",
         "400004: u16 254, s16 254, 0x00FE"),
        ("10 0001 0002", "10 0001 0002 04 000A 0102", "quantity", "2 registers, 400002 to 400003"),
        ("07 6D", "07", "status", "bits set: 0, 2, 3, 5, 6"),
        ("0B FFFF 0108", "0B", "status", "busy with an earlier command"),
        ("0C 07 0000 0001 0002 04", "0C", "status", "ready"),
        ("0C 07 0000 0001 0002 04", "0C", "events[0]", "entered Listen Only Mode"),
        ("0C 07 0000 0001 0002 C2", "0C", "events[0]", "received, communication error, broadcast"),
        ("0C 07 0000 0001 0002 41", "0C", "events[0]", "sent, exception 1 to 3"),
        ("0C 07 0000 0001 0002 00", "0C", "events[0]", "communication restarted"),
        ("0C 07 0000 0001 0002 10", "0C", "events[0]", "0x10, not in the specification"),
        ("11 03 4243FF", "11", "server_id", '"BC", run indicator on'),
        ("11 01 00", "11", "server_id", "run indicator off"),
        ("11 02 1B5B", "11", "server_id", ""),
        ("18 0006 0002 01B8 1284", "18 04DE", "fifo_count", "2 registers in the queue"),
        ("2B 0E 01 01 FF 02 01 00 02 4142", "2B 0E 01 00", "more_follows",
         "more objects follow: request again from the next object id"),
        ("2B 0E 01 81 00 00 01 00 02 4142", "2B 0E 01 00", "conformity_level",
         "basic, stream and individual"),
        ("2B 0E 01 01 00 00 01 00 02 4142", "2B 0E 01 00", "objects[0].value", '"AB"'),
        ("2B 0E 01 01 00 00 01 00 00", "2B 0E 01 00", "objects[0].value", "empty"),
        ("83 02", None, "function", "Read Holding Registers: exception response"),
        ("83 07", None, "exception_code",
         "exception 7: not in the specification; defined by the vendor"),
        ("08 000D 0003", None, "sub_function",
         "Return Bus Exception Error Count: exception responses that the device has sent"),
    ],
)  # fmt: skip
def test_responses(pdu: str, request_pdu: str | None, name: str, meaning: str) -> None:
    """Numbers of registers and bits come from the request; without it there are none."""
    assert meanings(pdu, "response", request_pdu)[name] == meaning


def test_exception_texts_are_the_vocabularys() -> None:
    """An exception's text is the name and meaning in the vocabulary."""
    text = meanings("83 02", "response")["exception_code"]
    assert text.startswith("Illegal Data Address: ")
