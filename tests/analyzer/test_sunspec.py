"""SunSpec devices name themselves: the marker and the chain of models in passive traffic."""

from __future__ import annotations

from typing import Any

import _modlens

BASE = 40_000


def transaction(core: _modlens.Session, bus: int, first: int, data: bytes) -> None:
    """A read of holding registers of unit 1 and its answer."""
    request = b"\x01\x03" + first.to_bytes(2, "big") + (len(data) // 2).to_bytes(2, "big")
    response = b"\x01\x03" + bytes([len(data)]) + data
    for frame in (request, response):
        core.feed(bus, frame + _modlens.crc16(frame).to_bytes(2, "little"))


def readings(*reads: tuple[int, bytes]) -> dict[str, Any]:
    """Name -> text and unit, of everything that got a name."""
    core = _modlens.Session(_modlens.Functions())
    bus = core.add_bus("pv", source="pv", mode="rtu")
    for first, data in reads:
        transaction(core, bus, first, data)
    core.flush()
    rows = core.take().readings
    return {row.name: (row.value_text, row.unit_of_measure) for row in rows if row.name}


def words(*numbers: int) -> bytes:
    """Registers."""
    return b"".join((number & 0xFFFF).to_bytes(2, "big") for number in numbers)


COMMON = words(1, 66) + b"Maker".ljust(32, b"\0") + b"Model 7".ljust(32, b"\0") + bytes(68)


def inverter() -> bytes:
    """Model 103: 12.34 A, 3456 W (factor 1 of 10), the rest not implemented."""
    registers = [0xFFFF] * 50
    registers[0], registers[4] = 1234, -2  # A, A_SF
    registers[12], registers[13] = 345, 1  # W, W_SF
    registers[36] = 4  # St
    return words(103, 50, *registers)


def test_models_are_found_behind_the_marker() -> None:
    """Common model and inverter get their names, scales and units without any file."""
    found = readings((BASE, b"SunS" + COMMON[:4]), (BASE + 2, COMMON), (BASE + 70, inverter()))
    assert found["Mn"] == ("Maker", None)
    assert found["Md"] == ("Model 7", None)
    assert found["A"] == ("12.34", "A")
    assert found["W"] == ("3450", "W")
    assert found["AphA"] == (None, "A")  # 0xFFFF: not implemented
    assert found["St"] == ("MPPT", None)


def test_the_marker_may_be_read_alone() -> None:
    """A master may look for the marker first; what it reads then goes on from there."""
    found = readings((BASE, b"SunS"), (BASE + 2, COMMON), (BASE + 70, inverter()))
    assert (found["Mn"], found["A"]) == (("Maker", None), ("12.34", "A"))


def test_one_block_has_the_rows_of_many() -> None:
    """Also where reads of address 0 before it hold no marker, and are taken as any exchange is."""
    polls = [(0, words(1, 2, 3))] * 3
    reads = [*polls, (BASE, b"SunS"), *polls, (BASE + 2, COMMON), (0, words(4, 5, 6))]

    def rows(size: int) -> list[tuple[Any, ...]]:
        line = bytearray()
        for first, data in reads * 2:
            request = b"\x01\x03" + first.to_bytes(2, "big") + (len(data) // 2).to_bytes(2, "big")
            for frame in (request, b"\x01\x03" + bytes([len(data)]) + data):
                line += frame + _modlens.crc16(frame).to_bytes(2, "little")
        core = _modlens.Session(_modlens.Functions())
        bus = core.add_bus("pv", source="pv", mode="rtu")
        for at in range(0, len(line), size):
            core.feed(bus, bytes(line[at : at + size]))
        core.flush()
        batch = core.take()
        named = [(row.name, row.value_text) for row in batch.readings if row.name]
        return [*named, *((row.txn, row.status, row.address) for row in batch.transactions)]

    whole = rows(1 << 20)
    assert ("Mn", "Maker") in whole
    assert whole == rows(1)


def test_one_read_may_hold_it_all() -> None:
    """Marker, chain of models and values may be in one response."""
    found = readings(
        (BASE, b"SunS" + COMMON), (BASE + 70, inverter()), (BASE + 122, words(0xFFFF, 0))
    )
    assert found["A"] == ("12.34", "A")


def test_without_the_marker_nothing_is_named() -> None:
    """Without the marker, registers that look like a model get no names."""
    assert readings((BASE + 2, COMMON), (BASE + 70, inverter())) == {}


def test_the_marker_counts_at_its_places_only() -> None:
    """40000, 50000 and 0 (SunSpec Device Information Model Specification)."""
    assert readings((1000, b"SunS" + COMMON)) == {}
    assert readings((50_000, b"SunS" + COMMON))["Mn"] == ("Maker", None)
    assert readings((0, b"SunS" + COMMON))["Mn"] == ("Maker", None)
