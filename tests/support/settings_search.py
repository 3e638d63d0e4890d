"""The core's search for line settings, driven by hand, and a simulated line to run it on.

`SettingsSearch` is what `_modlens.LiveRun` does in the core. `search_settings` runs it on traffic
at 20 % load, bits, and a UART (`tests.support.uart`), and gives the seconds of traffic needed.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from types import MappingProxyType

import _modlens
from analyzer.line import Line, parse_line
from tests.support.uart import ReceivedCharacter, Uart, Wire

LOAD = 0.2
MAX_S = 10.0
"""Seconds of traffic at 20 % bus load within which the settings have to be found."""

NS = 1_000_000_000
READ_S, FLUSH_S = 0.001, 0.016
RTU = ("8E1", "8O1", "8N1", "8N2")
ASCII = ("7E1", "7O1", "7N2", "8N1", "8E1", "7E2")


@dataclass(frozen=True, slots=True)
class Chunk:
    """The bytes of one read, and the time at which it returned (ns since 1970).

    That is never before the stop bit of the last byte. `errors` are the positions of bytes that the
    receiver has marked (parity, framing, break); `hole` says that bytes were lost before these, and
    `recorded` that the recorder has them.
    """

    data: bytes
    time_ns: int
    errors: Sequence[int] = ()
    hole: bool = False
    recorded: bool = False


BAUDS: Mapping[int, float] = MappingProxyType(dict(_modlens.usual_rates()))
"""The baud rates that are tried -> their prior probability."""

_ReadTuple = tuple[int, bytes, int, list[int], bool, bool]


@dataclass(frozen=True, slots=True)
class FoundSettings:
    """The settings found, `rtu` or `ascii`, the evidence, and the reads made with them."""

    line: Line
    mode: str
    evidence: str
    chunks: tuple[tuple[int, Chunk], ...]


class SettingsSearch:
    """Searches the settings of a line; `found` is set when they are known.

    Call `feed` for every read, `advance` when time has passed, and `line_was_set` after the port
    was set to `line`. `notify` gets messages on what was tried and why it was given up.
    `marks_errors` says whether the driver marks line errors; `labels` names the lines of a two-line
    tap by port number.
    """

    def __init__(
        self,
        notify: Callable[[str], None] = lambda _: None,
        *,
        marks_errors: bool = True,
        labels: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        self.found: FoundSettings | None = None
        self._notify = notify
        self._labels = labels
        self._core = _modlens.LineSearch(marks_errors=marks_errors)

    @property
    def line(self) -> Line:
        """The settings to listen with now."""
        return parse_line(self._core.line())

    def line_was_set(self, now_ns: int) -> None:
        """Leave out what comes right after: it may have been received with the old settings."""
        self._core.line_was_set(now_ns)

    def feed(self, port: int, chunk: Chunk) -> None:
        """Evaluate a read made with the present settings."""
        self._core.feed(
            port,
            chunk.data,
            chunk.time_ns,
            line=self._labels.get(port),
            errors=chunk.errors or None,
            hole=chunk.hole,
            recorded=chunk.recorded,
        )
        self._follow()

    def advance(self, now_ns: int) -> None:
        """Tell the search that nothing was received until now: a silence may complete a frame."""
        self._core.advance(now_ns)
        self._follow()

    def heard(self) -> Iterator[tuple[Line, list[tuple[int, Chunk]]]]:
        """All reads so far, or the newest where they are too many, by the settings of the time."""
        for line, reads in groupby(self._core.heard(), key=lambda read: read[0]):
            yield parse_line(line), [_arrival(read) for _, read in reads]

    def diagnosis(self) -> str:
        """What can be said when the search ends without a result."""
        return self._core.diagnosis()

    def _follow(self) -> None:
        for text in self._core.take_messages():
            self._notify(text)
        found = None if self.found is not None else self._core.found()
        if found is not None:
            line, mode, evidence, reads = found
            self.found = FoundSettings(
                parse_line(line), mode, evidence, tuple(_arrival(read) for read in reads)
            )


def _arrival(read: _ReadTuple) -> tuple[int, Chunk]:
    port, data, time_ns, errors, hole, recorded = read
    return port, Chunk(data, time_ns, errors, hole, recorded)


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
