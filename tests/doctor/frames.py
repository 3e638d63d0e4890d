"""Frames made by hand: PDUs of the common functions, checksum, RTU and Modbus/TCP.

Independent of modlens on purpose: the model must not inherit a mistake of what it examines.

>>> rtu(5, read_request(3, 16, 2)).hex()
'050300100002c44a'
>>> mbap(7, 5, read_request(3, 16, 2)).hex()
'000700000006050300100002'
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

__all__ = [
    "crc",
    "exception",
    "mbap",
    "read_answer",
    "read_request",
    "rtu",
    "write_answer",
    "write_request",
]

BIT_FUNCTIONS = (1, 2)


def _crc_table() -> list[int]:
    table = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
        table.append(value)
    return table


_CRC_TABLE = _crc_table()


def crc(data: bytes) -> int:
    """CRC-16/MODBUS (serial line specification, 6.2.2)."""
    value = 0xFFFF
    for byte in data:
        value = (value >> 8) ^ _CRC_TABLE[(value ^ byte) & 0xFF]
    return value


def rtu(unit: int, pdu: bytes) -> bytes:
    """A frame for a serial line."""
    body = bytes([unit]) + pdu
    return body + struct.pack("<H", crc(body))


def mbap(transaction: int, unit: int, pdu: bytes) -> bytes:
    """A frame of Modbus/TCP."""
    return struct.pack(">HHHB", transaction & 0xFFFF, 0, len(pdu) + 1, unit) + pdu


def read_request(function: int, address: int, quantity: int) -> bytes:
    return struct.pack(">BHH", function, address, quantity)


def read_answer(function: int, values: Sequence[int]) -> bytes:
    """The answer to a read: bits for functions 1 and 2, registers otherwise."""
    if function in BIT_FUNCTIONS:
        packed = sum(bool(value) << place for place, value in enumerate(values))
        data = packed.to_bytes((len(values) + 7) // 8, "little")
    else:
        data = struct.pack(f">{len(values)}H", *values)
    return bytes([function, len(data)]) + data


def write_request(function: int, address: int, values: Sequence[int]) -> bytes:
    """Functions 6 and 16."""
    if function == 6:
        return struct.pack(">BHH", 6, address, values[0])
    data = struct.pack(f">{len(values)}H", *values)
    return struct.pack(">BHHB", 16, address, len(values), len(data)) + data


def write_answer(request: bytes) -> bytes:
    """Function 6 repeats all of the request, function 16 address and quantity: 5 bytes each."""
    return request[:5]


def exception(function: int, code: int) -> bytes:
    return bytes([function | 0x80, code])
