"""scapy frames: building, reading, and what stays when something is wrong."""

from __future__ import annotations

import subprocess
import sys

import pytest
from scapy.packet import Packet, Padding, Raw

from dissectors import layers
from dissectors.layers import (
    ModbusASCII,
    ModbusExceptionResponse,
    ModbusRTU,
    ModbusRTURequest,
    ModbusRTUResponse,
    ModbusTCP,
    pdu_class,
)

ReadRequest = pdu_class(3, "request")


def shown(packet: Packet) -> str:
    """Return what `show()` prints."""
    return str(packet.show(dump=True))


def test_the_three_framings_are_built() -> None:
    """Checksums and the header's length are filled in."""
    pdu = ReadRequest(address=107, quantity=3)
    assert bytes(ModbusRTU(unit=17) / pdu) == bytes.fromhex("11 03 006B 0003 7687")
    assert bytes(ModbusASCII(unit=17) / pdu) == b":1103006B00037E\r\n"
    built = bytes(ModbusTCP(mbap_id=7, unit=17) / pdu)
    assert built == bytes.fromhex("0007 0000 0006 11 03 006B 0003")


@pytest.mark.parametrize(
    ("cls", "data"),
    [
        (ModbusRTU, bytes.fromhex("11 03 006B 0003 7688")),
        (ModbusASCII, b":1103006B00037F\r\n"),
    ],
)
def test_a_wrong_checksum_is_kept_and_visible(cls: type[Packet], data: bytes) -> None:
    """The bytes come back as they were, `show()` says what is wrong, deleting fixes it."""
    packet = cls(data)
    assert bytes(packet) == data
    assert "wrong: 0x" in shown(packet)
    assert packet.checksum != packet.expected_checksum()
    del packet.checksum
    mended = cls(bytes(packet))
    assert mended.checksum == mended.expected_checksum()
    assert "wrong" not in shown(mended)


def test_given_values_stay() -> None:
    """Wrong lengths and checksums can be made on purpose."""
    pdu = pdu_class(16, "request")(address=1, quantity=9, byte_count=7, registers=[1])
    assert bytes(pdu) == bytes.fromhex("10 0001 0009 07 0001")
    assert bytes(ModbusRTU(unit=1, checksum=0x1234) / pdu)[-2:] == b"\x34\x12"
    assert bytes(ModbusTCP(unit=1, length=99) / pdu)[4:6] == b"\x00\x63"


def test_changed_fields_are_built_anew() -> None:
    """A frame that was read can be changed; its kept checksum must go for a new one."""
    packet = ModbusRTU(bytes.fromhex("11 03 006B 0003 7687"))
    packet.payload.address = 108
    assert bytes(packet) == bytes.fromhex("11 03 006C 0003 7687")
    del packet.checksum
    assert ModbusRTU(bytes(packet)).expected_checksum() == ModbusRTU(bytes(packet)).checksum


def test_direction_by_class_and_by_layout() -> None:
    """The plain classes infer the direction; the others fix it."""
    echo = bytes.fromhex("01 06 0001 0003 9809")
    assert type(ModbusRTU(echo).payload).__name__ == "WriteSingleRegisterRequest"
    assert type(ModbusRTURequest(echo).payload).__name__ == "WriteSingleRegisterRequest"
    assert type(ModbusRTUResponse(echo).payload).__name__ == "WriteSingleRegisterResponse"
    response = bytes.fromhex("01 03 02 0064 B9AF")
    assert type(ModbusRTU(response).payload).__name__ == "ReadHoldingRegistersResponse"


def test_exceptions() -> None:
    """Exception responses of any function are named by function and code."""
    packet = ModbusRTU(bytes.fromhex("11 83 02 C134"))
    assert isinstance(packet.payload, ModbusExceptionResponse)
    assert "Illegal Data Address" in shown(packet)
    assert bytes(ModbusExceptionResponse(function=0x83, exception_code=2)) == b"\x83\x02"


@pytest.mark.parametrize(
    ("cls", "data"),
    [
        (ModbusRTU, b"\x01"),
        (ModbusRTU, b"\x01\x03\x02"),
        (ModbusASCII, b":01\r\n"),
        (ModbusASCII, b":0103F\r\n"),
        (ModbusASCII, b"no frame"),
        (ModbusTCP, b"\x00\x01\x00\x00\x00\x01\x11"),
    ],
)
def test_what_cannot_be_a_frame_stays_raw(cls: type[Packet], data: bytes) -> None:
    """Bytes that cannot be a frame stay `Raw`, without an error."""
    packet = cls(data)
    assert isinstance(packet, Raw)
    assert bytes(packet) == data


@pytest.mark.parametrize("body", ["63 0102", "03 06 02", "5A 0002", "03 02 0064 FF", "10 00"])
def test_what_the_layout_does_not_cover_stays_raw(body: str) -> None:
    """Unknown functions, cut bodies, bytes too many."""
    data = b"\x01" + bytes.fromhex(body) + b"\x12\x34"
    packet = ModbusRTUResponse(data)
    assert packet.haslayer(Raw)
    assert bytes(packet) == data


def test_bytes_beyond_the_headers_length_are_padding() -> None:
    """As scapy has it; a length that is too long is kept."""
    packet = ModbusTCP(bytes.fromhex("0001 0000 0006 11 03 006B 0003 FFFF"))
    assert packet[Padding].load == b"\xff\xff"
    long = bytes.fromhex("0001 0000 00FF 11 03 006B 0003")
    assert bytes(ModbusTCP(long)) == long


def test_the_classes_are_attributes_of_the_module() -> None:
    """By name, listed, and refused like any other attribute."""
    assert layers.ReadCoilsRequest is pdu_class("Read Coils", "request")
    assert "ReadDeviceIdentificationResponse" in dir(layers)
    with pytest.raises(AttributeError, match="NoSuchFunction"):
        _ = layers.NoSuchFunction


def test_nothing_else_imports_scapy() -> None:
    """It costs 90 ms; the decoder must start without it."""
    modules = "describe explain craft table vocabulary pdu errors function_lookup values".split()
    code = ";".join(f"import dissectors.{name}" for name in modules)
    code += ";import sys; sys.exit(any(name.startswith('scapy') for name in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_layers_need_only_scapys_packets_and_fields() -> None:
    """Layers do not import `scapy.all`, which takes 400 ms and opens sockets."""
    code = "import dissectors.layers, sys; sys.exit('scapy.all' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
