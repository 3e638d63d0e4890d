"""Runs a settings search on a simulated line: traffic at 20 % load, bits, and a UART.

`search_settings` gives the seconds of traffic that the search needed; `tests.support.uart` is the
line.
"""

from __future__ import annotations

import random
from collections.abc import Iterator

import _modlens
from analyzer.line import Line
from analyzer.sources.serial import Chunk
from analyzer.sources.settings_search import SettingsSearch
from tests.support.uart import ReceivedCharacter, Uart, Wire

LOAD = 0.2
MAX_S = 10.0
"""Seconds of traffic at 20 % bus load within which the settings have to be found."""

NS = 1_000_000_000
READ_S, FLUSH_S = 0.001, 0.016
RTU = ("8E1", "8O1", "8N1", "8N2")
ASCII = ("7E1", "7O1", "7N2", "8N1", "8E1", "7E2")


def rtu(body: bytes) -> bytes:
    """An RTU frame: unit and PDU with the CRC after them."""
    return body + _modlens.crc16(body).to_bytes(2, "little")


def colon(body: bytes) -> bytes:
    """An ASCII frame of unit and PDU."""
    return b":" + (body + bytes([_modlens.lrc(body)])).hex().upper().encode() + b"\r\n"


def polls(mode: str, seed: int) -> Iterator[tuple[bytes, bytes]]:
    """Requests and responses of a poll list, repeated for ever with changing values."""
    rng = random.Random(seed)
    wrap = rtu if mode == "rtu" else colon
    units = rng.sample(range(1, 40), 3)
    while True:
        for unit in units:
            address, count = rng.choice([0, 100, 1000]), rng.choice([1, 2, 4, 6])
            request = bytes([unit, 3]) + address.to_bytes(2, "big") + count.to_bytes(2, "big")
            values = b"".join(
                rng.choice([0, 1, rng.randrange(65536)]).to_bytes(2, "big") for _ in range(count)
            )
            yield wrap(request), wrap(bytes([unit, 3, 2 * count]) + values)


def traffic(line: Line, mode: str, seed: int, *, inverted: bool = False) -> Wire:
    """A line with more than `MAX_S` seconds of polling at 20 % load."""
    wire, now = Wire(line, inverted=inverted), 0.05
    for request, response in polls(mode, seed):
        begun = now
        busy = (len(request) + len(response)) * line.char_bits / line.baud
        behind = wire.send(request, now)
        wire.send(response, behind + 0.005)
        now = begun + max(busy / LOAD, busy + 0.01)
        if now > MAX_S * 1.5:
            return wire
    return wire


def search_settings(
    search: SettingsSearch,
    wire: Wire,
    *,
    coarse: int = 1,
    marks_errors: bool = True,
    resync: bool = True,
) -> float:
    """Let the search listen to the line until it is finished; gives the seconds it took.

    The line is read each millisecond; `coarse` is an adapter that delivers so many bytes at a time
    and marks all of them if one has an error.
    """
    now = 0.0
    receiving, line = Uart(search.line, resync=resync).receive(wire, now), search.line
    following = next(receiving, None)
    buffered: list[ReceivedCharacter] = []
    while search.found is None and now < MAX_S * 1.5 and (following or buffered):
        now += READ_S
        while following is not None and following.time_s <= now:
            buffered.append(following)
            following = next(receiving, None)
        if not buffered:
            search.advance(round(now * NS))
        elif len(buffered) >= coarse or now - buffered[-1].time_s > FLUSH_S:
            errors = [place for place, one in enumerate(buffered) if one.error]
            if coarse > 1 and errors:
                errors = list(range(len(buffered)))
            data = bytes(one.byte for one in buffered)
            search.feed(0, Chunk(data, round(now * NS), errors if marks_errors else ()))
            buffered.clear()
        if search.line != line:
            receiving, line = Uart(search.line, resync=resync).receive(wire, now), search.line
            following = next(receiving, None)
            buffered.clear()
    return now
