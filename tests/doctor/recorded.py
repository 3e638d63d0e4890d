"""The same traffic as different people would have recorded it: a tap's chunk log, a client's log.

Chunk logs are what `modlens formats` shows under "chunks"; clients' logs are written in the
dialects of `tests.support.logs`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from random import Random

from tests.doctor.line_model import Exchange
from tests.doctor.wire import Heard
from tests.support.logs import LogEntry, write

__all__ = ["EPOCH_S", "READS", "chunk_log", "client_log", "reads_of"]

EPOCH_S = 1_795_262_400.0
"""2026-11-21T12:00:00Z."""

READS = ("byte", "fifo", "millisecond")
"""How a receiver hands over: each byte, 8 of them or what came before 4 silent ones, or each ms."""

FIFO, FIFO_SILENCE = 8, 4


def reads_of(heard: Heard, how: str, character_s: float) -> Iterable[tuple[float, bytes]]:
    """Group bytes into reads; a read's time is never before its last byte's."""
    pending = bytearray()
    last_s = 0.0
    for time_s, byte in sorted(heard, key=lambda one: one[0]):
        if pending and _hands_over(how, pending, last_s, time_s, character_s):
            yield _read_time(how, last_s), bytes(pending)
            pending.clear()
        pending.append(byte)
        last_s = time_s
    if pending:
        yield _read_time(how, last_s), bytes(pending)


def _hands_over(
    how: str, pending: bytearray, last_s: float, time_s: float, character_s: float
) -> bool:
    if how == "byte":
        return True
    if how == "fifo":
        return len(pending) >= FIFO or time_s - last_s > FIFO_SILENCE * character_s
    return int(time_s * 1000) != int(last_s * 1000)


def _read_time(how: str, last_s: float) -> float:
    return (int(last_s * 1000) + 1) / 1000 if how == "millisecond" else last_s


def chunk_log(heard: Heard, how: str = "byte", character_s: float = 0.0) -> bytes:
    """A tap's recording."""
    lines = (
        f'{{"t": {EPOCH_S + time_s + 5e-7:.6f}, "hex": "{data.hex()}"}}\n'
        for time_s, data in reads_of(heard, how, character_s)
    )
    return "".join(lines).encode("ascii")


def client_log(exchanges: Sequence[Exchange], heard: Heard, dialect: str = "pymodbus") -> bytes:
    """What the master's program writes: each request, and what it received until the next one."""
    entries: list[LogEntry] = []
    bytes_in_order = sorted(heard, key=lambda one: one[0])
    at = 0
    for place, exchange in enumerate(exchanges):
        sent_s = exchange.start_s
        entries.append(LogEntry(_ns(sent_s), True, exchange.request))
        last = place + 1 == len(exchanges)
        until_s = float("inf") if last else exchanges[place + 1].start_s
        received = bytearray()
        received_s = sent_s
        while at < len(bytes_in_order) and bytes_in_order[at][0] <= until_s:
            received_s, byte = bytes_in_order[at]
            received.append(byte)
            at += 1
        if received:
            entries.append(LogEntry(_ns(received_s), False, bytes(received)))
    return write(dialect, entries).encode()


def own_bytes_left_out(exchanges: Sequence[Exchange], heard: Heard, character_s: float) -> Heard:
    """What the master's receiver hears: not what it sends itself."""
    own = [(one.start_s, one.start_s + (len(one.request) + 0.5) * character_s) for one in exchanges]
    kept: Heard = []
    at = 0
    for time_s, byte in sorted(heard, key=lambda one: one[0]):
        while at < len(own) and own[at][1] < time_s:
            at += 1
        if at == len(own) or time_s <= own[at][0]:
            kept.append((time_s, byte))
    return kept


def _ns(time_s: float) -> int:
    return round((EPOCH_S + time_s) * 1e9)


def reads_by_chance(rng: Random) -> str:
    return rng.choice(READS)


def as_json(rows: Iterable[dict[str, object]]) -> bytes:
    """Lines of JSON."""
    return "".join(json.dumps(row) + "\n" for row in rows).encode()
