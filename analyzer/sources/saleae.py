r"""Exports of Saleae's Logic: CSV with the levels of all channels, one line for each change.

Here only the names of the channels are read. The core reads the rows and finds the serial lines.

>>> Levels("bus.csv", iter([b"Time [s],RX,TX\n0.000000000,1,1\n"])).names
{0: 'RX', 1: 'TX'}
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from typing import Self

from analyzer.sources.sigrok import channel_numbers

__all__ = ["Levels"]


class Levels:
    """An export in blocks of text, with the interface of `analyzer.sources.sigrok.Samples`.

    `unit` 0 says that these are level changes and not samples; `rate` is the resolution
    in which it counts their times, a nanosecond.
    """

    unit = 0
    rate = 1e9

    def __init__(self, name: str, blocks: Iterator[bytes]) -> None:
        self.name = name
        self._blocks = blocks
        self._first = next(blocks, b"")
        line = self._first.partition(b"\n")[0].decode("utf-8", "replace").strip("\ufeff\r ")
        cells = next(csv.reader([line.replace("\t", ",")], skipinitialspace=True), [])
        self.names = dict(enumerate(cells[1:]))

    def channels(self, names: Sequence[str]) -> list[int]:
        """The numbers of the channels of these names; `UsageError` for an unknown name."""
        return channel_numbers(self.names, names, self.name)

    def blocks(self) -> Iterator[bytes]:
        """The text of the export, in blocks."""
        yield self._first
        yield from self._blocks

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing to close: the recording that gives the blocks is closed by its owner."""
