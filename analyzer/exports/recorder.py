"""Raw recording: every read of a tap with its time, in pcapng.

The core writes it in a thread of its own (`modlens-recorder`), and documents the format
(modlens-pcapng/src/recording.rs). A file can be read up to its last complete block, however the
tap ended. With rotation, or where the file exists, segments are named as by dumpcap,
`bus_00001_20261121101500.pcapng`. Nothing is ever overwritten, and nothing is deleted but the
oldest segments of the same name where `--keep` asks for it; never those of another tap that runs.

>>> parse_rotation("10min"), parse_rotation("64MB"), parse_retention("8"), parse_retention("2GB")
(Rotation(seconds=600, bytes=None), Rotation(seconds=None, bytes=64000000), ...)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import _modlens
from analyzer.exports.output import as_source_error
from dissectors.errors import UsageError

__all__ = [
    "RecordedPort",
    "Recorder",
    "RecordingStatus",
    "Retention",
    "Rotation",
    "parse_retention",
    "parse_rotation",
]

CLOSE_S = 5.0
"""For how long the end of a recording waits for a disk that hangs."""


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
    """A read of a port."""

    @property
    def data(self) -> bytes:
        """The bytes."""

    @property
    def time_ns(self) -> int:
        """When the read returned, in ns since 1970."""


def parse_rotation(text: str) -> Rotation:
    """Parse `--rotate`: a time such as 10min, 1h, 1d, or a size such as 64MB."""
    try:
        return Rotation(*_modlens.parse_rotation(text))
    except ValueError as error:
        raise UsageError(f"--rotate {text}: {error}") from error


def parse_retention(text: str) -> Retention:
    """Parse `--keep`: a number of segments, or a size such as 2GB."""
    try:
        return Retention(*_modlens.parse_retention(text))
    except ValueError as error:
        raise UsageError(f"--keep {text}: {error}") from error


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """How a recording is going.

    `trouble` says why nothing can be written at the moment, `had_trouble` that it was so at any
    time. `recorded` and `lost` are bytes of the line, `waiting` is the memory of what is not
    written yet.
    """

    file: str
    trouble: str | None
    had_trouble: bool
    recorded: int
    lost: int
    waiting: int


class Recorder:
    """Writes the reads of ports to a file, or to a sequence of segments, in a thread of the core.

    `core` is what `LiveRun.record` takes. Nothing here waits for the disk but `flush` and `close`.
    `SourceError` if the first file cannot be created. Later reads wait in `memory` while the disk
    does not take them; what does not fit is counted, and marked in the recording.
    """

    def __init__(
        self,
        path: str,
        ports: Sequence[RecordedPort] = (),
        *,
        rotate: Rotation | None = None,
        keep: Retention | None = None,
        memory: int | None = None,
    ) -> None:
        if keep is not None and rotate is None:
            raise UsageError("--keep is for segments; add --rotate, as --rotate 1h")
        rotation, retention = rotate or Rotation(), keep or Retention()
        try:
            self.core = _modlens.Recorder(
                path,
                rotate_seconds=rotation.seconds,
                rotate_bytes=rotation.bytes,
                keep_segments=retention.segments,
                keep_bytes=retention.bytes,
                memory=memory,
            )
        except OSError as error:
            raise as_source_error(path, error) from error
        self._numbers: dict[tuple[str, str | None], int] = {}
        for port in ports:
            self.add_port(port)

    def add_port(self, port: RecordedPort) -> None:
        """Add a port for `write_read`."""
        number = self.core.add_port(port.port, port.bus, port.line, port.settings)
        self._numbers[port.bus, port.line] = number

    def write_read(self, bus: str, line: str | None, read: Read) -> None:
        """Record a read of a port."""
        self.core.write(
            self._numbers[bus, line],
            read.time_ns,
            read.data,
            errors=list(getattr(read, "errors", ())) or None,
            hole=getattr(read, "hole", False),
        )

    def status(self) -> RecordingStatus:
        """How the recording is going."""
        return RecordingStatus(*self.core.status())

    def take_messages(self) -> list[str]:
        """Sentences for the user since the last call: files that have begun, trouble, its end."""
        return self.core.take_messages()

    def flush(self, timeout: float = CLOSE_S) -> bool:
        """Wait until everything is written; False if it is not in time."""
        return self.core.flush(timeout)

    def close(self, timeout: float = CLOSE_S) -> RecordingStatus:
        """Write what is waiting and close the file; waits for the disk no longer than `timeout`."""
        return RecordingStatus(*self.core.close(timeout))
