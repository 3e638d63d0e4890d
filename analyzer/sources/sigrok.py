r"""Sessions of sigrok (`.sr`): a zip archive of samples and metadata.

Here only the samples and their metadata are read; the core finds the serial lines.

>>> parse_sample_rate("4 MHz"), parse_sample_rate("24000")
(4000000.0, 24000.0)
"""

from __future__ import annotations

import configparser
import io
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from types import TracebackType
from typing import BinaryIO, Self

from dissectors.errors import SourceError, UsageError

__all__ = ["Samples", "channel_numbers", "parse_sample_rate"]

BLOCK = 1 << 20

_RATE = re.compile(r"([\d.]+)\s*([kKMG]?)(?:Hz)?")
_FACTORS = {"": 1.0, "k": 1e3, "K": 1e3, "M": 1e6, "G": 1e9}
_LOGIC = re.compile(r"(?P<stem>.+?)(?:-(?P<number>\d+))?")


class Samples:
    """The samples in a session file; use it in `with`.

    `name` is the file's name in errors; `rate` is in samples per second, `unit` the bytes of a
    sample, `names` the channels by number. `SourceError` if it is not a session or lacks a sample
    rate.
    """

    def __init__(self, name: str, file: str | BinaryIO) -> None:
        self.name = name
        try:
            self._zip = zipfile.ZipFile(file)
        except (OSError, zipfile.BadZipFile) as error:
            raise SourceError(f"{name}: not a sigrok session: {error}") from error
        try:
            self._read_metadata()
        except BaseException:
            self._zip.close()
            raise

    def channels(self, names: Sequence[str]) -> list[int]:
        """The numbers of the channels of these names; `UsageError` for an unknown name."""
        return channel_numbers(self.names, names, self.name)

    def blocks(self) -> Iterator[bytes]:
        """The samples, `unit` bytes each."""
        for part in self._parts:
            try:
                with self._zip.open(part) as file:
                    while block := file.read(BLOCK):
                        yield block
            except (OSError, zipfile.BadZipFile, zlib.error, EOFError) as error:
                raise SourceError(f"{self.name}: {part} cannot be read: {error}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._zip.close()

    def _read_metadata(self) -> None:
        """Read sample rate, sample size, channel names, and the list of files with samples."""
        parser = configparser.ConfigParser(interpolation=None, strict=False)
        try:
            parser.read_file(io.StringIO(self._zip.read("metadata").decode("utf-8", "replace")))
            device = next(parser[name] for name in parser.sections() if name.startswith("device"))
            stem = device["capturefile"]
            self.unit = int(device.get("unitsize", "1"))
            self.rate = parse_sample_rate(device["samplerate"])
        except (KeyError, StopIteration, ValueError, configparser.Error) as error:
            raise SourceError(
                f"{self.name}: the session does not describe its samples: {error}"
            ) from error
        self.names = {
            int(key.removeprefix("probe")) - 1: name
            for key, name in device.items()
            if key.removeprefix("probe").isdecimal()
        }
        found = [(_LOGIC.fullmatch(part), part) for part in self._zip.namelist()]
        parts = [
            (int(match["number"] or 0), part)
            for match, part in found
            if match is not None and stem in (part, match["stem"])
        ]
        self._parts = [part for _, part in sorted(parts)]


def channel_numbers(channels: Mapping[int, str], names: Sequence[str], recording: str) -> list[int]:
    """The numbers of the channels of these names; `UsageError` names those the recording has."""
    known = {name: number for number, name in channels.items()}
    for name in names:
        if name not in known:
            there = ", ".join(channels.values())
            raise UsageError(f"--channels {name}: {recording} has {there}")
    return [known[name] for name in names]


def parse_sample_rate(text: str) -> float:
    """Parse a sample rate such as `1 MHz`; gives samples per second, `ValueError` if it is none."""
    match = _RATE.fullmatch(text.strip())
    if match is None or not float(match[1]):
        raise ValueError(f"sample rate {text!r}")
    return float(match[1]) * _FACTORS[match[2]]
