"""Finds the settings of a line by listening: the core's search, as a tap in Python drives it.

How it goes about it stands in `crates/modlens-engine/src/line_search`; the tap for gateways has the
same. The owner of the port sets it to `line` whenever that has changed.

>>> search = SettingsSearch()
>>> str(search.line)
'115200-8E1'
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from types import MappingProxyType

import _modlens
from analyzer.line import Line, parse_line
from analyzer.sources.serial import Chunk

__all__ = ["BAUDS", "FoundSettings", "SettingsSearch"]

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
        """Leave out what comes right behind: it may have been received with the old settings."""
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
