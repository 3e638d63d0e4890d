"""A recorded device, simulated: pymodbus serves the file, its client reads the values back."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pymodbus")

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.datastore import ModbusServerContext, ModbusSimulatorContext
from pymodbus.server import ModbusTcpServer

from analyzer import decode
from tests.conftest import CAPTURES, Modlens

FILE = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
ALL = CAPTURES / "pymodbus_all_functions" / "recording.jsonl"


def newest(file: Path, unit: int) -> dict[tuple[str, int], int]:
    """The last value of each register and bit of a unit, from our rows."""
    rows = decode(file, line="19200-8E1").readings.where(f"unit == {unit} and status == 'ok'")
    return {(row.register_type, row.address): row.raw[0] for row in rows}


async def served(
    device: dict[str, Any], wanted: dict[tuple[str, int], int]
) -> dict[tuple[str, int], int]:
    """What a client reads from pymodbus' server with that device, address by address."""
    context = ModbusServerContext(devices=ModbusSimulatorContext(device, None), single=True)
    server = ModbusTcpServer(context, address=("127.0.0.1", 0))
    task = asyncio.create_task(server.serve_forever())
    while server.transport is None:
        await asyncio.sleep(0.01)
    transport: Any = server.transport
    port = transport.sockets[0].getsockname()[1]
    found = {}
    async with AsyncModbusTcpClient("127.0.0.1", port=port) as client:
        reads = {
            "coil": client.read_coils,
            "discrete_input": client.read_discrete_inputs,
            "holding_register": client.read_holding_registers,
            "input_register": client.read_input_registers,
        }
        for kind, address in wanted:
            answer = await reads[kind](address, count=1)
            assert not answer.isError(), (kind, address, answer)
            found[kind, address] = int((answer.bits or answer.registers)[0])
        unseen = await client.read_input_registers(9_999, count=1)
        assert unseen.isError()
    stop: Any = server.shutdown
    await stop()
    task.cancel()
    return found


@pytest.mark.parametrize(("file", "units"), [(FILE, (1, 2)), (ALL, (17,))])
def test_a_recorded_device_answers_as_it_did(
    file: Path, units: tuple[int, ...], tmp_path: Path, modlens: Modlens
) -> None:
    """Every register and bit that was seen, with its last value; the others are refused."""
    path = tmp_path / "bus.simulator.json"
    assert modlens("export", file, "--line", "19200-8E1", "-o", path).status == 0
    setup = json.loads(path.read_text())
    assert set(setup["device_list"]) == {f"unit_{unit}" for unit in units}
    for unit in units:
        wanted = newest(file, unit)
        assert len(wanted) > 20
        assert asyncio.run(served(setup["device_list"][f"unit_{unit}"], wanted)) == wanted
