"""Readings of single frames, for tests of conversion."""

from __future__ import annotations

from typing import Any

import _modlens


def read_frames(registers: str, *pairs: tuple[bytes, bytes], device: str = "") -> list[Any]:
    """The rows of readings of these requests and responses (without checksum) of a profile."""
    text = f"profile = 1\n{device}\n{registers}"
    core = _modlens.Session(_modlens.Functions())
    core.bind(_modlens.Profile(text, "toml"), list(range(256)))
    bus = core.add_bus("test", source="test", mode="rtu")
    for pair in pairs:
        for frame in pair:
            core.feed(bus, frame + _modlens.crc16(frame).to_bytes(2, "little"))
    core.flush()
    return list(core.take().readings)


def read_point(point: str, data: bytes, device: str = "") -> Any:
    """The reading of one point at hr:0, whose registers were read alone."""
    request = b"\x01\x03\x00\x00" + (len(data) // 2).to_bytes(2, "big")
    response = b"\x01\x03" + bytes([len(data)]) + data
    registers = f'[[registers]]\nat = "hr:0"\nname = "x"\n{point}\n'
    (row,) = read_frames(registers, (request, response), device=device)
    return row
