"""Devices that pymodbus servers play in recordings, with values worth looking at.

Not part of modlens and no model of a product. Some values change while they are read, and reading
takes its time, as in a real device.

    device = demo_device(17, Behaviour(refusals={(6, 3): ExcCodes.DEVICE_BUSY}))
"""

from __future__ import annotations

import asyncio
import itertools
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pymodbus.pdu.device
import pymodbus.pdu.events
from pymodbus import ExceptionResponse, ModbusDeviceIdentification
from pymodbus.constants import ExcCodes
from pymodbus.pdu import ModbusPDU
from pymodbus.simulator import DataType, SimAction, SimData, SimDevice

UNTYPED_DEVICE: Any = pymodbus.pdu.device  # pymodbus leaves both modules without types
UNTYPED_EVENTS: Any = pymodbus.pdu.events

COUNTER_ADDRESS = 0
TEMPERATURE_ADDRESS = 1
FLOATS_ADDRESS = 100
TEXT_ADDRESS = 200
WIDE_ADDRESS = 300
PROFILE_ADDRESS = 1000
READ_ONLY_ADDRESS = 2000

SETTINGS = [41, 215, 65516, 0x8000, 1, 0xFFFF, 1500, 0x55AA, 2026, 11]
FLOATS = [230.1, 229.8, 231.4, 5.27, 4.98, 5.11, 50.01, -0.87, 3521.5, 1.0e-3, math.nan, 1.25e6]
TEXT = "modlens demo device, serial no. 00421337"
ANY_ADDRESS = -1


@dataclass(frozen=True, slots=True)
class Behaviour:
    """How a device behaves apart from its values.

    `refusals` maps (function, address) to the exception code it answers; the address is that of the
    request, or `ANY_ADDRESS`. `work_s` is how long it works on a request, in seconds, in turn.
    `slow_s` maps an address to a time that takes the place of `work_s` there.
    """

    refusals: Mapping[tuple[int, int], ExcCodes] = field(default_factory=dict)
    work_s: tuple[float, ...] = (0.003, 0.006, 0.004, 0.011, 0.003, 0.018)
    slow_s: Mapping[int, float] = field(default_factory=dict)


class UnknownFunctionRequest(ModbusPDU):
    """A request of the user-defined function 41h, which the devices here do not support."""

    function_code = 0x41
    rtu_frame_size = 4

    async def datastore_update(self, context: object, device_id: int) -> ModbusPDU:
        """Refuse it with exception 1 (application protocol specification, section 7)."""
        return ExceptionResponse(self.function_code, ExcCodes.ILLEGAL_FUNCTION, device_id)


def identity() -> ModbusDeviceIdentification:
    """Return what the devices say about themselves (functions 11h and 2Bh/0Eh)."""
    said: ModbusDeviceIdentification = UNTYPED_DEVICE.ModbusDeviceIdentification(
        info_name={
            "VendorName": "modlens",
            "ProductCode": "DEMO-3",
            "MajorMinorRevision": "1.4",
            "VendorUrl": "https://example.org/demo",
            "ProductName": "Demo device",
            "ModelName": "three-phase",
            "UserApplicationName": "recording for tests",
        }
    )
    return said


def prime_counters() -> None:
    """Give pymodbus' diagnostic counters, event log and delimiter the same start each time.

    pymodbus has one set of them for all servers of a process. The counter of events starts at 0,
    because pymodbus (3.16) does not answer function 07h otherwise.
    """
    block = UNTYPED_DEVICE.ModbusControlBlock()
    block.reset()
    block.ListenOnly = False
    block.Delimiter = b"\n"
    counters = block.Counter
    counters.BusMessage, counters.BusCommunicationError, counters.BusExceptionError = 4711, 3, 12
    counters.DeviceMessage, counters.DeviceNoResponse, counters.DeviceNAK = 2042, 5, 0
    counters.DEVICE_BUSY, counters.BusCharacterOverrun, counters.Event = 7, 0, 0


def log_events() -> None:
    """Put one event of each kind into the communication event log that pymodbus' servers share."""
    for event in (
        UNTYPED_EVENTS.CommunicationRestartEvent(),
        UNTYPED_EVENTS.RemoteReceiveEvent(broadcast=True),
        UNTYPED_EVENTS.RemoteSendEvent(read=True),
        UNTYPED_EVENTS.EnteredListenModeEvent(),
        UNTYPED_EVENTS.RemoteReceiveEvent(overrun=True),
    ):
        UNTYPED_DEVICE.ModbusControlBlock().addEvent(event)


def demo_device(unit: int, behaviour: Behaviour | None = None) -> SimDevice:
    """Return a device with 2048 coils, 512 inputs and the register blocks named above.

    Holding and input registers hold the same kinds of values, the inputs' differ with the unit.
    """
    coils = [index % 3 == 0 or index % 7 == unit % 7 for index in range(2048)]
    inputs = [index % 5 == 0 or 16 <= index < 24 for index in range(512)]
    return SimDevice(
        unit,
        simdata=(
            [SimData(0, values=coils, datatype=DataType.BITS)],
            [SimData(0, values=inputs, datatype=DataType.BITS)],
            _registers(0),
            _registers(unit),
        ),
        action=_action(behaviour or Behaviour()),
    )


def _registers(shift: int) -> list[SimData]:
    wide = [*struct.unpack(">14H", struct.pack(">iIqd2h", -40_000, 3_123_456_789, -1, 0.1, 7, -7))]
    profile = [round(2000 + 1500 * math.sin(index / 20 + shift)) for index in range(250)]
    profile[60:80] = [0] * 20
    return [
        _block(0, [value ^ shift for value in SETTINGS]),
        SimData(FLOATS_ADDRESS, values=FLOATS, datatype=DataType.FLOAT32),
        SimData(TEXT_ADDRESS, values=TEXT, datatype=DataType.STRING),
        _block(WIDE_ADDRESS, wide),
        _block(PROFILE_ADDRESS, profile),
        SimData(READ_ONLY_ADDRESS, values=[1, 2, 3], datatype=DataType.REGISTERS, readonly=True),
    ]


def _block(address: int, values: list[int]) -> SimData:
    return SimData(address, values=values, datatype=DataType.REGISTERS)


def _action(behaviour: Behaviour) -> SimAction:
    """Return what pymodbus calls before it reads or writes: refuse, work, let values move."""
    work_s = itertools.cycle(behaviour.work_s)
    reads = itertools.count(1)

    async def act(
        function: int,
        start: int,
        address: int,
        _count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        await asyncio.sleep(behaviour.slow_s.get(address, next(work_s)))
        refusals = behaviour.refusals
        code = refusals.get((function, address)) or refusals.get((function, ANY_ADDRESS))
        if code is None and values is None and function in {3, 4} and start == COUNTER_ADDRESS:
            number = next(reads)
            registers[COUNTER_ADDRESS] = (registers[COUNTER_ADDRESS] + 1) & 0xFFFF
            registers[TEMPERATURE_ADDRESS] = 215 + round(5 * math.sin(number / 3))
        return code

    return act
