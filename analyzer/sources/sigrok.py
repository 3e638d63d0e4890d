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
from collections.abc import Iterator, Mapping, Sequence
from typing import BinaryIO, Self

from analyzer.sources.compression import damage_kinds
from dissectors.errors import CaptureError, UsageError

__all__ = ["Samples", "channel_numbers", "parse_sample_rate"]

BLOCK = 1 << 20

_MAX_METADATA_BYTES = 1 << 20
_MAX_UNIT_BYTES = 32
"""Bytes of a sample: sigrok has devices with up to 128 channels; twice as many are no session."""

_ODD: tuple[type[Exception], ...] = (NotImplementedError, RuntimeError, ValueError)
"""What zipfile raises for a member that is packed oddly, or encrypted."""

_UNDESCRIBED: tuple[type[Exception], ...] = (KeyError, StopIteration, configparser.Error)
"""What a session raises that lacks a key of its metadata."""

_RATE = re.compile(r"([\d.]+)\s*([kKMG]?)(?:Hz)?")
_FACTORS = {"": 1.0, "k": 1e3, "K": 1e3, "M": 1e6, "G": 1e9}
_LOGIC = re.compile(r"(?P<stem>.+?)(?:-(?P<number>\d{1,9}))?")


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
        except damage_kinds() + _ODD as error:
            raise CaptureError(f"not a sigrok session: {error}", path=name) from error
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
            except damage_kinds() + _ODD as error:
                raise CaptureError(f"{part} cannot be read: {error}", path=self.name) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._zip.close()

    def _read_metadata(self) -> None:
        """Read sample rate, sample size, channel names, and the list of files with samples."""
        parser = configparser.ConfigParser(interpolation=None, strict=False)
        try:
            with self._zip.open("metadata") as file:
                text = file.read(_MAX_METADATA_BYTES).decode("utf-8", "replace")
            parser.read_file(io.StringIO(text))
            device = next(parser[name] for name in parser.sections() if name.startswith("device"))
            stem = device["capturefile"]
            self.unit = int(device.get("unitsize", "1"))
            if not 0 < self.unit <= _MAX_UNIT_BYTES:
                raise ValueError(f"samples of {self.unit} bytes")
            self.rate = parse_sample_rate(device["samplerate"])
        except damage_kinds() + _ODD + _UNDESCRIBED as error:
            raise CaptureError(
                f"the session does not describe its samples: {error}", path=self.name
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
