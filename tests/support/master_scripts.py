"""What the master does in each recording: one function per recording, driven by pymodbus' client.

A script yields steps, calls without arguments. Whoever runs it pauses between them and suppresses
pymodbus' exceptions: an exception response, a timeout or an answer that the client does not
understand is part of a recording.

    for step in two_units(client):
        step()
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Iterator
from functools import partial

from pymodbus.client import ModbusSerialClient
from pymodbus.pdu import FileRecord
from pymodbus.pdu.bit_message import ReadCoilsRequest
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

from tests.support.devices import (
    FLOATS_ADDRESS,
    PROFILE_ADDRESS,
    READ_ONLY_ADDRESS,
    TEXT_ADDRESS,
    WIDE_ADDRESS,
    UnknownFunctionRequest,
    log_events,
)

Steps = Iterator[Callable[[], object]]

ABSENT = 3
"""A unit that is on no recorded bus."""
BROADCAST = 0
BROADCAST_TURNAROUND_S = 0.1
"""Serial line specification, 2.4.1: typically 100 to 200 ms."""
LISTEN_ONLY_S = 0.1
"""Long enough to see whether a device answers that should not."""
FILE_WORDS = bytes.fromhex("0dfe0020c0de")


class OversizedRegistersRequest(ReadHoldingRegistersRequest):
    """Reads more registers than the specification and the client's own check allow."""

    MAX_COUNT = 0xFFFF


class OversizedCoilsRequest(ReadCoilsRequest):
    """Reads more coils than the specification and the client's own check allow."""

    MAX_COUNT = 0xFFFF


def all_functions(client: ModbusSerialClient, unit: int = 17) -> Steps:
    """Every function code the client can send, the diagnostics sub-functions last."""
    yield from _bits_and_registers(client, unit)
    yield partial(client.read_exception_status, device_id=unit)
    yield log_events
    yield partial(client.diag_get_comm_event_counter, device_id=unit)
    yield partial(client.diag_get_comm_event_log, device_id=unit)
    yield partial(client.report_device_id, device_id=unit)
    yield from _files(client, unit)
    for code in (1, 2, 3):
        yield partial(client.read_device_information, read_code=code, device_id=unit)
    yield partial(client.read_device_information, read_code=4, object_id=1, device_id=unit)
    yield from _diagnostics(client, unit)


def _bits_and_registers(client: ModbusSerialClient, unit: int) -> Steps:
    yield partial(client.read_coils, 19, count=37, device_id=unit)
    yield partial(client.read_discrete_inputs, 196, count=22, device_id=unit)
    yield partial(client.read_holding_registers, 0, count=10, device_id=unit)
    yield partial(client.read_holding_registers, FLOATS_ADDRESS, count=24, device_id=unit)
    yield partial(client.read_holding_registers, TEXT_ADDRESS, count=20, device_id=unit)
    yield partial(client.read_input_registers, WIDE_ADDRESS, count=14, device_id=unit)
    yield partial(client.write_coil, 172, True, device_id=unit)
    yield partial(client.write_coil, 172, False, device_id=unit)
    yield partial(client.write_register, 2, 3, device_id=unit)
    yield partial(client.write_coils, 19, [True, False, True, True] * 2 + [True], device_id=unit)
    yield partial(client.write_registers, 2, [10, 258], device_id=unit)
    yield partial(client.write_registers, FLOATS_ADDRESS, _float(21.5), device_id=unit)
    mask = partial(client.mask_write_register, address=4, device_id=unit)
    yield partial(mask, and_mask=0x00F2, or_mask=0x0025)
    yield partial(
        client.readwrite_registers,
        read_address=PROFILE_ADDRESS,
        read_count=6,
        write_address=6,
        values=[255, 255, 255],
        device_id=unit,
    )


def _files(client: ModbusSerialClient, unit: int) -> Steps:
    wanted = [FileRecord(4, 1, record_length=4), FileRecord(3, 9, record_length=4)]
    yield partial(client.read_file_record, wanted, device_id=unit)
    record = FileRecord(4, 7, record_data=FILE_WORDS)
    yield partial(client.write_file_record, [record], device_id=unit)
    yield partial(client.read_fifo_queue, address=1246, device_id=unit)


def _diagnostics(client: ModbusSerialClient, unit: int) -> Steps:
    yield partial(client.diag_query_data, b"\xa5\x37", device_id=unit)
    yield partial(client.diag_change_ascii_input_delimeter, delimiter=0x0A, device_id=unit)
    for question in (
        client.diag_read_diagnostic_register,
        client.diag_read_bus_message_count,
        client.diag_read_bus_comm_error_count,
        client.diag_read_bus_exception_error_count,
        client.diag_read_device_message_count,
        client.diag_read_device_no_response_count,
        client.diag_read_device_nak_count,
        client.diag_read_device_busy_count,
        client.diag_read_bus_char_overrun_count,
        client.diag_read_iop_overrun_count,
        client.diag_clear_overrun_counter,
        client.diag_clear_counters,
    ):
        yield partial(question, device_id=unit)
    yield partial(client.diag_getclear_modbus_response, data=3, device_id=unit)
    yield partial(client.diag_restart_communication, True, device_id=unit)
    yield partial(client.diag_force_listen_only, device_id=unit)
    yield partial(time.sleep, LISTEN_ONLY_S)
    yield partial(client.read_holding_registers, 0, count=1, device_id=unit)


def exceptions(client: ModbusSerialClient, unit: int = 1) -> Steps:
    """Requests that the device refuses: unknown, not permitted, or configured to fail."""
    yield partial(client.read_holding_registers, 0, count=10, device_id=unit)
    yield partial(client.execute, False, UnknownFunctionRequest(dev_id=unit))
    yield partial(client.readwrite_registers, address=0, read_count=1, values=[1], device_id=unit)
    yield partial(client.read_holding_registers, 5000, count=2, device_id=unit)
    yield partial(client.read_holding_registers, 8, count=3, device_id=unit)
    yield partial(client.read_coils, 4000, count=8, device_id=unit)
    yield partial(client.write_register, READ_ONLY_ADDRESS, 1, device_id=unit)
    yield partial(client.write_registers, PROFILE_ADDRESS, list(range(124)), device_id=unit)
    yield partial(client.read_device_information, read_code=4, object_id=9, device_id=unit)
    for address in range(1, 10):
        yield partial(client.write_register, address, 0x1234, device_id=unit)
    yield partial(client.read_input_registers, 0, count=10, device_id=unit)
    oversized = OversizedRegistersRequest(address=0, count=126, dev_id=unit)
    yield partial(client.execute, False, oversized)
    yield partial(client.execute, False, OversizedCoilsRequest(address=0, count=2001, dev_id=unit))
    yield partial(client.read_holding_registers, 0, count=1, device_id=unit)


def timeouts(client: ModbusSerialClient, unit: int = 1) -> Steps:
    """Poll a unit that answers and one that is not there, in turn."""
    for turn in range(4):
        yield partial(client.read_holding_registers, FLOATS_ADDRESS, count=8, device_id=unit)
        yield partial(client.read_input_registers, 0, count=2 + turn, device_id=unit)
        if turn % 2 == 0:
            yield partial(client.read_holding_registers, 0, count=2, device_id=ABSENT)
        yield partial(client.write_register, 6, 1500 + turn, device_id=unit)
    yield partial(client.write_coil, 1, True, device_id=ABSENT)


def late_answers(client: ModbusSerialClient, unit: int = 1) -> Steps:
    """Every third poll goes to a block that the device takes longer for than the master waits."""
    for turn in range(3):
        yield partial(client.read_holding_registers, 0, count=4, device_id=unit)
        yield partial(client.read_input_registers, 0, count=3 + turn, device_id=unit)
        yield partial(client.read_holding_registers, PROFILE_ADDRESS, count=5, device_id=unit)
        yield partial(time.sleep, 1.0)
    yield partial(client.read_holding_registers, 0, count=4, device_id=unit)


def broadcast(client: ModbusSerialClient, unit: int = 1) -> Steps:
    """Write to all units at once, wait, and read back from each."""
    for write in (
        partial(client.write_register, 6, 1800),
        partial(client.write_registers, 2, [7, 8, 9]),
        partial(client.write_coil, 5, True),
        partial(client.write_coils, 8, [True, True, False]),
    ):
        yield partial(write, device_id=BROADCAST, no_response_expected=True)
        yield partial(time.sleep, BROADCAST_TURNAROUND_S)
        for address in (unit, unit + 1):
            yield partial(client.read_holding_registers, 0, count=10, device_id=address)
        yield partial(client.read_coils, 0, count=16, device_id=unit)


def mixed_ascii(client: ModbusSerialClient, unit: int = 10) -> Steps:
    """Functions of all kinds over ASCII framing."""
    yield from _bits_and_registers(client, unit)
    yield partial(client.read_coils, 0, count=2000, device_id=unit)
    yield partial(client.read_exception_status, device_id=unit)
    yield log_events
    yield partial(client.diag_query_data, b"modlens!", device_id=unit)
    yield partial(client.diag_get_comm_event_log, device_id=unit)
    yield partial(client.report_device_id, device_id=unit)
    yield from _files(client, unit)
    yield partial(client.read_device_information, read_code=2, device_id=unit)
    yield partial(client.read_holding_registers, 5000, count=2, device_id=unit)
    yield partial(client.execute, False, UnknownFunctionRequest(dev_id=unit))
    yield partial(client.read_holding_registers, 0, count=10, device_id=unit)


def two_units(client: ModbusSerialClient, units: tuple[int, int] = (1, 2)) -> Steps:
    """Poll two units in turn as a supervisory system does; every third turn a set point follows."""
    for turn in range(8):
        for unit in units:
            yield partial(client.read_holding_registers, 0, count=10, device_id=unit)
            yield partial(client.read_input_registers, FLOATS_ADDRESS, count=24, device_id=unit)
            yield partial(client.read_coils, 0, count=(8, 40)[turn % 2], device_id=unit)
            if turn % 3 == 0:
                value = _float(20 + turn + math.pi / unit)
                yield partial(client.write_registers, FLOATS_ADDRESS, value, device_id=unit)
            if turn in {2, 5}:
                for address in (PROFILE_ADDRESS, PROFILE_ADDRESS + 125):
                    read = client.read_input_registers
                    yield partial(read, address, count=125, device_id=unit)
        yield partial(time.sleep, 0.05)
    yield partial(client.read_discrete_inputs, 0, count=200, device_id=units[0])


def plain_polls(client: ModbusSerialClient, unit: int = 1) -> Steps:
    """A poll cycle of three reads and a write, again and again."""
    for turn in range(6):
        yield partial(client.read_holding_registers, 0, count=10, device_id=unit)
        yield partial(client.read_input_registers, FLOATS_ADDRESS, count=6, device_id=unit)
        yield partial(client.read_coils, 0, count=12, device_id=unit)
        yield partial(client.write_register, 6, 1400 + turn, device_id=unit)


def _float(value: float) -> list[int]:
    return list(struct.unpack(">2H", struct.pack(">f", value)))
