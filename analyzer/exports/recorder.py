"""Raw recording: every read of a tap with its time, in pcapng, flushed block by block.

The core documents the format (modlens-writers/src/recording.rs). A file can be read up to its
last complete block, however the tap ended. With rotation, or where the file exists, segments are
named as by dumpcap, `bus_00001_20261121101500.pcapng`. Nothing is ever overwritten, and nothing is
deleted but the oldest segments of the same name where `--keep` asks for it.

>>> parse_rotation("10min"), parse_rotation("64MB"), parse_retention("8"), parse_retention("2GB")
(Rotation(seconds=600, bytes=None), Rotation(seconds=None, bytes=64000000), ...)
"""

from __future__ import annotations

import contextlib
import os
import re
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import _modlens
from analyzer.durations import parse_duration
from analyzer.exports.output import GrowingFile
from dissectors.errors import SourceError, UsageError

__all__ = ["RecordedPort", "Recorder", "Retention", "Rotation", "parse_retention", "parse_rotation"]

BYTES_PER_UNIT = {"kb": 10**3, "mb": 10**6, "gb": 10**9, "kib": 2**10, "mib": 2**20, "gib": 2**30}
_AMOUNT = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]*)")


@dataclass(frozen=True, slots=True)
class Rotation:
    """When a segment ends: after this many seconds, or bytes; both None means never."""

    seconds: int | None = None
    bytes: int | None = None


@dataclass(frozen=True, slots=True)
class Retention:
    """How many segments are kept, or how many bytes of them; both None means all."""

    segments: int | None = None
    bytes: int | None = None


@dataclass(frozen=True, slots=True)
class RecordedPort:
    """A recorded port: its bus, its line (None for the only one), its name and settings."""

    bus: str
    line: str | None
    port: str
    settings: str | None


class Read(Protocol):
    """A read of a port, such as `analyzer.sources.serial.Chunk`."""

    @property
    def data(self) -> bytes:
        """The bytes."""

    @property
    def time_ns(self) -> int:
        """When the read returned, in ns since 1970."""


def parse_rotation(text: str) -> Rotation:
    """Parse `--rotate`: a time such as 10min, 1h, 1d, or a size such as 64MB."""
    with contextlib.suppress(UsageError):
        value, unit = _amount("--rotate", text)
        if unit in BYTES_PER_UNIT:
            return Rotation(bytes=round(value * BYTES_PER_UNIT[unit]))
    try:
        seconds = round(parse_duration(text, "--rotate") / 1e9)
    except UsageError:
        seconds = 0
    if not seconds or text.strip()[-1:].isdigit():
        raise UsageError(
            f"--rotate {text}: write a time such as 10min or 1h30m, or a size such as 64MB"
        )
    return Rotation(seconds=seconds)


def parse_retention(text: str) -> Retention:
    """Parse `--keep`: a number of segments, or a size such as 2GB."""
    value, unit = _amount("--keep", text)
    if unit in BYTES_PER_UNIT:
        return Retention(bytes=round(value * BYTES_PER_UNIT[unit]))
    if not unit and value == int(value):
        return Retention(segments=int(value))
    raise UsageError(f"--keep {text}: give a number of files, or a size such as 2GB")


def _amount(option: str, text: str) -> tuple[float, str]:
    match = _AMOUNT.fullmatch(text.strip().lower())
    if match is None or not float(match[1]):
        raise UsageError(f"{option} {text}: write a number and a unit, as 10min, 64MB or 2GB")
    return float(match[1]), match[2]


class Recorder:
    """Writes the reads of ports to a file, or to a sequence of segments.

    `notify` gets a message when a segment begins. `SourceError` if the first segment cannot be
    created; a later error is passed to `on_failure` once and ends the recording, not the tap.
    """

    def __init__(  # noqa: PLR0913 - what can be said of a recording
        self,
        path: str,
        ports: Sequence[RecordedPort],
        *,
        rotate: Rotation | None = None,
        keep: Retention | None = None,
        notify: Callable[[str], None] = lambda _: None,
        on_failure: Callable[[SourceError], None] | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        if keep is not None and rotate is None:
            raise UsageError("--keep is for segments; add --rotate, as --rotate 1h")
        self._path = path if path.endswith(".pcapng") else f"{path}.pcapng"
        self._ports = list(ports)
        self._rotation, self._retention = rotate or Rotation(), keep or Retention()
        self._notify, self._on_failure, self._clock = notify, on_failure, clock
        self._numbered = rotate is not None or os.path.lexists(self._path)
        self._session = uuid.uuid4().hex[:16]
        self._segment = 0
        self._port_numbers = {(one.bus, one.line): at for at, one in enumerate(ports)}
        self._file: GrowingFile | None = None
        self._begin_segment()

    def add_port(self, port: RecordedPort) -> None:
        """Add a port, when its line settings have been found."""
        self._port_numbers[port.bus, port.line] = len(self._ports)
        self._ports.append(port)
        if self._file is not None:
            self._write(_modlens.recording_port(*self._description(port)), may_rotate=False)

    def write_read(self, bus: str, line: str | None, read: Read) -> None:
        """Record a read of a port."""
        if self._file is None:
            return
        errors = list(getattr(read, "errors", ())) or None
        block = _modlens.recording_read(
            self._port_numbers[bus, line],
            read.time_ns,
            read.data,
            errors=errors,
            hole=getattr(read, "hole", False),
        )
        self._write(block, may_rotate=True)

    def _write(self, block: bytes, *, may_rotate: bool) -> None:
        """Append a block, to a new segment if the present one is full and `may_rotate`.

        After an error the recording has ended: `on_failure` gets it, or it is raised where there is
        none.
        """
        try:
            if may_rotate and self._segment_is_full(len(block)):
                self._begin_segment()
            assert self._file is not None
            self._file.append(block)
            self._segment_bytes += len(block)
        except SourceError as error:
            self._file = None
            if self._on_failure is None:
                raise
            self._on_failure(error)

    def close(self) -> None:
        """Close the file, which has been readable all the time."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _segment_is_full(self, size: int) -> bool:
        """Whether the next block begins a new segment; each segment has at least one read."""
        if self._rotation.bytes is not None:
            return self._has_reads() and self._segment_bytes + size > self._rotation.bytes
        if self._rotation.seconds is not None:
            return self._clock() - self._segment_began_s >= self._rotation.seconds
        return False

    def _has_reads(self) -> bool:
        return self._segment_bytes > self._header_bytes

    def _begin_segment(self) -> None:
        """Close the present segment, open the next one, and write its header.

        Old segments are deleted afterwards, because the retention counts the new one, too.
        """
        if self._file is not None:
            self._file.close()
        self._segment += 1
        self._segment_began_s = self._clock()
        self.name = self._next_name() if self._numbered else self._path
        self._file = GrowingFile(self.name)
        ports = [self._description(one) for one in self._ports]
        head = _modlens.recording_head(self._session, self._segment, ports)
        self._file.append(head)
        self._header_bytes = self._segment_bytes = len(head)
        self._notify(f"recording to {self.name}")
        self._delete_old_segments()

    def _description(self, port: RecordedPort) -> tuple[str, int, str, str | None, str | None]:
        buses = list(dict.fromkeys(one.bus for one in self._ports))
        return port.port, buses.index(port.bus), port.bus, port.line, port.settings

    def _next_name(self) -> str:
        """The name of the next segment as dumpcap makes it: number and time in UTC."""
        base = self._path.removesuffix(".pcapng")
        last = max((number for number, _ in self._segments()), default=0)
        moment = time.strftime("%Y%m%d%H%M%S", time.gmtime(self._segment_began_s))
        return f"{base}_{last + 1:05}_{moment}.pcapng"

    def _segments(self) -> list[tuple[int, str]]:
        """Number and path of every existing segment of this name, the oldest first."""
        folder, base = os.path.split(self._path.removesuffix(".pcapng"))
        pattern = re.compile(re.escape(base) + r"_(\d{5,})_\d{14}\.pcapng")
        try:
            names = os.listdir(folder or ".")
        except OSError:
            return []
        matches = ((pattern.fullmatch(name), name) for name in names)
        return sorted(
            (int(match[1]), os.path.join(folder, name)) for match, name in matches if match
        )

    def _delete_old_segments(self) -> None:
        """Delete the oldest segments beyond the retention; never the one being written."""
        segments = [path for _, path in self._segments() if path != self.name]
        if self._retention.segments is not None:
            excess = len(segments) + 1 - self._retention.segments
        elif self._retention.bytes is not None:
            excess, room = len(segments), self._retention.bytes - (self._rotation.bytes or 0)
            for path in reversed(segments):
                with contextlib.suppress(OSError):
                    room -= os.path.getsize(path)
                if room < 0:
                    break
                excess -= 1
        else:
            return
        for path in segments[: max(excess, 0)]:
            with contextlib.suppress(OSError):
                os.unlink(path)
