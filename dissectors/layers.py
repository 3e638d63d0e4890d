"""Layers of scapy for Modbus, built from the table: for crafting, `show()` and scapy's own tools.

Imports scapy (GPL-2, some 90 ms): nothing else in the package imports this module, and the decoder
does not use it. The frames are `ModbusRTU`, `ModbusASCII` and `ModbusTCP`; every row of the table
gives a class for its request and one for its response, named after the function:

>>> from dissectors.layers import ModbusRTU, ReadHoldingRegistersRequest
>>> frame = ModbusRTU(unit=17) / ReadHoldingRegistersRequest(address=107, quantity=3)
>>> bytes(frame).hex(" ")
'11 03 00 6b 00 03 76 87'
>>> write = pdu_class(16, "request")(address=1, registers=[10, 258])
>>> ModbusTCP(bytes(ModbusTCP(unit=1) / write)).show()
###[ Modbus TCP ]###
  mbap_id   = 1
  protocol  = 0
  length    = 11
  unit      = 1
###[ Write Multiple Registers, request ]###
     function  = Write Multiple Registers
     address   = 1
     quantity  = 2
     byte_count= 4
     registers = [10, 258]
<BLANKLINE>

Checksums, lengths, counts and quantities that are None are worked out when the frame is built; a
value that is given stays, and a wrong checksum that was read stays too and says so in `show()`.

scapy cannot know who sent a frame. `ModbusRTU(data)` reads it by the layout that fits, as a request
where both fit; `ModbusRTURequest(data)` and `ModbusRTUResponse(data)` say it (and so for ASCII and
TCP). What the layout does not cover stays as `Raw`, and so does a frame that is too short. To read
Modbus/TCP out of scapy's own captures: `bind_layers(TCP, ModbusTCP, dport=502)`.
"""

from __future__ import annotations

import binascii
import re
from typing import ClassVar

from scapy.fields import AnyField, ByteField, Field, ShortField
from scapy.packet import Packet, Raw

import _modlens
from dissectors.pdu_layers import (
    ModbusExceptionResponse,
    ModbusPDU,
    class_for,
    load_vendor,
    pdu_class,
    pdu_classes,
)
from dissectors.table import Direction

__all__ = [
    "ModbusASCII",
    "ModbusASCIIRequest",
    "ModbusASCIIResponse",
    "ModbusExceptionResponse",
    "ModbusPDU",
    "ModbusRTU",
    "ModbusRTURequest",
    "ModbusRTUResponse",
    "ModbusTCP",
    "ModbusTCPRequest",
    "ModbusTCPResponse",
    "load_vendor",
    "pdu_class",
    "pdu_classes",
]


def __getattr__(name: str) -> type[ModbusPDU]:
    """The classes of the table as attributes of this module."""
    try:
        return pdu_classes()[name]
    except KeyError:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None


def __dir__() -> list[str]:
    return sorted([*__all__, *pdu_classes()])


class _Checksum(Field[int | None, int]):
    """A checksum in hex; where it is wrong, `show()` gives the right one as well."""

    def i2repr(self, pkt: Packet | None, x: int | None) -> str:
        """The checksum in hex, and what it should be if it is wrong."""
        digits = 2 * self.sz
        expected = pkt.expected_checksum() if isinstance(pkt, _Adu) else x
        if x is None or x == expected:
            return "None" if x is None else f"0x{x:0{digits}X}"
        return f"0x{x:0{digits}X} (wrong: 0x{expected:0{digits}X} expected)"

    def i2m(self, pkt: Packet | None, x: int | None) -> int:
        """0 for a checksum that is computed later."""
        return 0 if x is None else x


class _Adu(Packet):
    """The base of the three frame types: a unit, and a PDU that is decoded by its direction."""

    modbus_direction: ClassVar[Direction | None] = None
    min_bytes: ClassVar[int] = 2

    def __init_subclass__(cls) -> None:
        # scapy looks for the hook in the class itself, not in its bases.
        cls.dispatch_hook = classmethod(_class_or_raw)  # type: ignore[attr-defined]

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """The class of the PDU, by function code, leading field and direction."""
        return class_for(payload, self.modbus_direction) or Raw

    def expected_checksum(self) -> int | None:
        """The checksum that unit and PDU should have; None for TCP, which has none."""
        return None

    @classmethod
    def can_be_read(cls, data: bytes) -> bool:
        """Whether the bytes are long enough to be such a frame."""
        return len(data) >= cls.min_bytes


def _class_or_raw(
    cls: type[_Adu], /, _pkt: bytes = b"", *_: object, **_fields: object
) -> type[Packet]:
    """The hook by which scapy chooses another class: a frame too short to be one stays `Raw`."""
    return cls if not _pkt or cls.can_be_read(_pkt) else Raw


class ModbusRTU(_Adu):
    """A serial frame: unit, PDU, CRC with its low byte first (serial line specification, 2.5.1)."""

    name = "Modbus RTU"
    min_bytes = 4
    fields_desc: ClassVar[list[AnyField]] = [
        ByteField("unit", 1),
        _Checksum("checksum", None, "<H"),
    ]

    def expected_checksum(self) -> int | None:
        """The checksum that unit and PDU should have."""
        return _modlens.crc16(bytes([self.unit]) + bytes(self.payload))

    def pre_dissect(self, s: bytes) -> bytes:
        """The frame's bytes in the order of the fields of this layer."""
        # The checksum is a field of this layer but is placed after the PDU in the frame, so it is
        # moved to the place of the field.
        return s[:1] + s[-2:] + s[1:-2]

    def do_dissect(self, s: bytes) -> bytes:
        """The bytes after the fields of this layer."""
        rest = super().do_dissect(s)
        # scapy would return the rearranged bytes from its cache.
        self.raw_packet_cache = None
        return rest

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """The built frame, with computed fields filled in."""
        checked = pkt[:1] + pay
        checksum = pkt[1:3]
        if self.checksum is None:
            checksum = _modlens.crc16(checked).to_bytes(2, "little")
        return checked + checksum


class ModbusASCII(_Adu):
    """A serial frame in characters: colon, unit and PDU in hex, LRC, CR LF (serial line, 2.5.2)."""

    name = "Modbus ASCII"
    fields_desc: ClassVar[list[AnyField]] = [
        ByteField("unit", 1),
        _Checksum("checksum", None, ">B"),
    ]

    @classmethod
    def can_be_read(cls, data: bytes) -> bool:
        """Whether these are a colon and pairs of hex digits, for three bytes at least."""
        digits = data.rstrip(b"\r\n")[1:]
        return data[:1] == b":" and re.fullmatch(rb"([0-9A-Fa-f]{2}){3,}", digits) is not None

    def expected_checksum(self) -> int | None:
        """The checksum that unit and PDU should have."""
        return _modlens.lrc(bytes([self.unit]) + bytes(self.payload))

    def pre_dissect(self, s: bytes) -> bytes:
        """The bytes in the order of the fields."""
        binary = binascii.unhexlify(s.rstrip(b"\r\n")[1:])
        return binary[:1] + binary[-1:] + binary[1:-1]

    def do_dissect(self, s: bytes) -> bytes:
        """The bytes after the fields."""
        rest = super().do_dissect(s)
        self.raw_packet_cache = None
        return rest

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """The frame, with what is left to be worked out."""
        checked = pkt[:1] + pay
        lrc = bytes([_modlens.lrc(checked)]) if self.checksum is None else pkt[1:2]
        return b":" + (checked + lrc).hex().upper().encode("ascii") + b"\r\n"


class ModbusTCP(_Adu):
    """A frame on TCP: the MBAP header and a PDU (messaging on TCP/IP, 3.1.3).

    What is beyond the header's length is padding.
    """

    name = "Modbus TCP"
    min_bytes = 8
    fields_desc: ClassVar[list[AnyField]] = [
        ShortField("mbap_id", 1),
        ShortField("protocol", 0),
        ShortField("length", None),
        ByteField("unit", 1),
    ]

    def extract_padding(self, s: bytes) -> tuple[bytes, bytes | None]:
        """The bytes that the header's length covers, and those beyond it."""
        size = max(0, self.length - 1)
        return s[:size], s[size:] or None

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """The frame, with what is left to be worked out."""
        if self.length is None:
            pkt = pkt[:4] + (1 + len(pay)).to_bytes(2, "big") + pkt[6:]
        return pkt + pay


class ModbusRTURequest(ModbusRTU):
    """An RTU frame that is known to be a request."""

    modbus_direction = "request"


class ModbusRTUResponse(ModbusRTU):
    """An RTU frame that is known to be a response."""

    modbus_direction = "response"


class ModbusASCIIRequest(ModbusASCII):
    """An ASCII frame that is known to be a request."""

    modbus_direction = "request"


class ModbusASCIIResponse(ModbusASCII):
    """An ASCII frame that is known to be a response."""

    modbus_direction = "response"


class ModbusTCPRequest(ModbusTCP):
    """A TCP frame that is known to be a request."""

    modbus_direction = "request"


class ModbusTCPResponse(ModbusTCP):
    """A TCP frame that is known to be a response."""

    modbus_direction = "response"
