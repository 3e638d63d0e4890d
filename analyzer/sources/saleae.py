r"""Levels of channels as Saleae's Logic exports them: CSV with a line for each change.

The names of the channels are read here; that there are serial lines among them is found by the
core, which reads the rows.

>>> Levels("bus.csv", iter([b"Time [s],RX,TX\n0.000000000,1,1\n"])).names
{0: 'RX', 1: 'TX'}
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from types import TracebackType
from typing import Self

from analyzer.sources.sigrok import channel_numbers

__all__ = ["Levels"]


class Levels:
    """The rows of an export, in blocks; used as `analyzer.sources.sigrok.Samples` is.

    `unit` says that these are no samples, and `rate` how many places the core counts in a second.
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
        """The numbers of these channels; `UsageError` where there is no such."""
        return channel_numbers(self.names, names, self.name)

    def blocks(self) -> Iterator[bytes]:
        """The text."""
        yield self._first
        yield from self._blocks

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """The recording that gives the blocks is closed by its owner."""
