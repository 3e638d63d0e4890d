"""Ordinary traffic with something odd in the middle, as a tap, a log and a capture hold it.

A message is a line of text: a kind and bytes in hex.

- `>` a request, `<` a response: unit and PDU, which the recording frames as it has to
- `>!` and `<!`: the bytes on the wire
- `<~`: a response with the transaction identifier 0; `<^`: with that of the request before
- `<_`: with a pause inside the frame; `<x`: with a byte that the receiver marked (taps only)
- `lost`: a segment of the server that the capture lacks
- `again`, `twice`: the last packet is sent again, or captured twice; `changed`: sent again with
  another last byte; `reset` ends the connection
- `wait 900`: so many milliseconds pass
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import _modlens
from tests.doctor.network import Network

__all__ = ["COLUMNS", "PLAIN", "RECORDINGS", "TABLES", "Decoded", "decoded", "framed"]

LINE = (19_200, 8, "E", 1.0)
EPOCH_NS = 1_700_000_000_000_000_000
CHARACTER_NS = 572_917
"""A character of eleven bits at 19200 baud."""
MASTER_PAUSE_MS, UNIT_PAUSE_MS = 30, 10
TABLES = ("frames", "transactions", "readings", "findings", "connections")
COLUMNS: dict[str, list[str]] = {
    table: [column["key"] for column in columns]
    for table, columns in json.loads(_modlens.vocabulary("columns")).items()
}

PLAIN = (
    *(
        message
        for turn in range(3)
        for message in (
            *("> 11 03 00 6B 00 02", f"< 11 03 04 01 {turn:02X} 02 8F"),
            *("> 02 04 00 07 00 01", f"< 02 04 02 43 {turn:02X}"),
            *("> 11 01 00 13 00 0A", f"< 11 01 02 CD 0{turn}"),
        )
    ),
    *("> 02 10 00 01 00 02 04 00 0A 01 02", "< 02 10 00 01 00 02"),
)
"""Ten exchanges: reads of registers and bits of two units, and a write."""


@dataclass(frozen=True, slots=True)
class Message:
    """What happens when; `request` is the number of the request that was sent last."""

    ms: int
    kind: str
    body: bytes
    request: int

    @property
    def is_request(self) -> bool:
        """Whether the master sends it."""
        return self.kind.startswith(">")

    @property
    def is_frame(self) -> bool:
        """Whether there are bytes on the wire."""
        return self.kind[0] in "<>"


def messages(lines: Iterable[str]) -> Iterator[Message]:
    """The messages of these lines, with times from 0 on."""
    now = requests = 0
    for line in lines:
        kind, _, text = line.partition(" ")
        if kind == "wait":
            now += int(text)
            continue
        requests += kind[0] == ">"
        now += MASTER_PAUSE_MS if kind[0] == ">" else UNIT_PAUSE_MS
        yield Message(now, kind, bytes.fromhex(text), requests)


def framed(body: bytes) -> bytes:
    """Unit and PDU as an RTU frame."""
    return body + _modlens.crc16(body).to_bytes(2, "little")


def _wire(message: Message) -> bytes:
    return message.body if "!" in message.kind else framed(message.body)


def _characters(message: Message) -> bytes:
    if "!" in message.kind:
        return message.body
    adu = message.body + bytes([_modlens.lrc(message.body)])
    return f":{adu.hex().upper()}\r\n".encode()


def _raw(lines: Iterable[str]) -> bytes:
    """The bytes on the wire, without times."""
    return b"".join(map(_wire, messages(lines)))


def _ascii(lines: Iterable[str]) -> bytes:
    """The characters of the ASCII framing, without times."""
    return b"".join(map(_characters, messages(lines)))


def _log(lines: Iterable[str]) -> bytes:
    """A line a frame: seconds since 1970 and the bytes in hex."""
    return b"".join(
        b"%d.%03d000 %s\n" % (1_700_000_000 + m.ms // 1000, m.ms % 1000, _wire(m).hex(" ").encode())
        for m in messages(lines)
    )


def _capture(lines: Iterable[str]) -> bytes:
    """One connection of Modbus/TCP, a packet a message."""
    network = Network()
    flow = network.flow("10.0.0.1", "10.0.0.2")
    flow.open(0.0)
    for message in messages(lines):
        at_s = 1 + message.ms / 1000
        body = message.body
        number = {"<~": 0, "<^": message.request - 1}.get(message.kind, message.request)
        packet = struct.pack(">HHH", number, 0, len(body)) + body
        match message.kind:
            case "lost":
                flow.next_seq[False] += len(packet)
            case "again":
                network.packets.append((at_s + 0.2, network.packets[-1][1]))
            case "changed":
                changed = bytes([*network.packets[-1][1][:-1], network.packets[-1][1][-1] ^ 0x63])
                network.packets.append((at_s + 0.2, changed))
            case "twice":
                network.packets.append((network.packets[-1][0], network.packets[-1][1]))
            case "reset":
                flow.reset(at_s, by_client=False)
            case kind:
                flow.send(at_s, message.is_request, body if "!" in kind else packet, acked=False)
    return network.pcap()


def _reads(lines: Iterable[str]) -> Iterator[tuple[bytes, int, list[int]]]:
    """What a tap with a clock of microseconds hears: a byte, when it came, and marks on it."""
    for message in messages(lines):
        for place, byte in enumerate(_wire(message)):
            pause_ns = 5_000_000 if message.kind == "<_" and place > 3 else 0
            time_ns = EPOCH_NS + message.ms * 1_000_000 + (place + 1) * CHARACTER_NS + pause_ns
            yield bytes([byte]), time_ns, [0] if message.kind == "<x" and place == 3 else []


@dataclass(frozen=True, slots=True)
class Recording:
    """How traffic is recorded, and the format as which a session reads it (None: its bytes)."""

    write: Callable[[Iterable[str]], bytes]
    format: str | None
    mode: str = "rtu"


RECORDINGS = {
    "raw": Recording(_raw, None),
    "ascii": Recording(_ascii, None, "ascii"),
    "log": Recording(_log, "hex"),
    "capture": Recording(_capture, "pcap", "tcp"),
}


@dataclass(frozen=True, slots=True)
class Decoded:
    """All cells of all tables as text, all counters, and what the doctor says."""

    tables: dict[str, list[dict[str, Any]]]
    statistics: dict[str, Any]
    document: dict[str, Any]

    def codes(self, table: str = "findings") -> set[str]:
        """The codes in the table of findings, or in the column `findings` of another one."""
        if table == "findings":
            return {row["code"] for row in self.tables[table]}
        return {code for row in self.tables[table] for code in row["findings"]}


def decoded(
    lines: Iterable[str],
    recording: str,
    *,
    frames: bool,
    block: int | None = None,
    profile: str | None = None,
) -> Decoded:
    """What a session makes of a recording in blocks of so many bytes, None: of all at once.

    A byte at a time, the slow path decides all of it: a request and its response are never there
    together. `profile` is that of unit 0x11. The recording `tap` is what a tap hears byte by byte.
    """
    tables = [table for table in TABLES if frames or table != "frames"]
    functions = _modlens.Functions()
    session = _modlens.Session(functions, tables=[*tables, "diagnoses"], overview="all")
    if profile is not None:
        session.bind(_modlens.Profile(profile, "toml"), [0x11])
    if recording == "tap":
        bus = session.add_bus("bus", source="tap", mode="rtu", line=LINE, clock="utc")
        for data, time_ns, errors in _reads(lines):
            session.feed(bus, data, time_ns, errors=errors)
    else:
        written = RECORDINGS[recording].write(lines)
        feed = _feeder(session, RECORDINGS[recording])
        for start in range(0, len(written), block or len(written)):
            feed(written[start : start + (block or len(written))], False)
        feed(b"", True)
    session.flush()
    batches = [session.take(), session.conclude()]
    rows = {table: list(_rows(batches, table)) for table in tables}
    return Decoded(rows, json.loads(session.stats()), json.loads(session.document()))


def _feeder(session: _modlens.Session, recording: Recording) -> Callable[[bytes, bool], None]:
    if recording.format == "pcap":
        number = session.add_capture("recording")
        return lambda data, final: session.feed_capture(number, data, final=final)
    bus = session.add_bus("bus", source="recording", mode=recording.mode)
    if recording.format is None:
        return lambda data, _: session.feed(bus, data)
    session.open_text(bus, recording.format)
    return lambda data, final: session.feed_text(bus, data, final=final)


def _rows(batches: Sequence[_modlens.Batch], table: str) -> Iterator[dict[str, Any]]:
    """The rows as JSON lines have them: empty cells are left out."""
    for batch in batches:
        rows: _modlens.Table = getattr(batch, table)
        text = b"".join(map(bytes, rows.lines("jsonl", COLUMNS[table])))
        yield from map(json.loads, text.splitlines())
