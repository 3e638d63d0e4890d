"""A recording as the tools read it: within the fence, with the caller's settings, for a while."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import _modlens
from analyzer.assistants.fence import Fence
from analyzer.line import parse_line
from analyzer.profiles import Binding, parse_binding, with_vendor_functions
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from dissectors.profile import FORMS

__all__ = ["Reading"]

MAX_SECONDS = 20.0
"""After this time the rest of a recording is left unread: clients wait for a minute or less."""


class Reading:
    """One pass over the recording that the arguments of a tool name.

    `UsageError` for arguments without a meaning, `SourceError` where the file cannot be read.
    """

    def __init__(self, fence: Fence, arguments: Mapping[str, Any]) -> None:
        self.name: str = arguments["file"]
        self.path = fence.resolve(self.name)
        bound = _bindings(fence, arguments.get("profile"))
        line, ports = arguments.get("line"), arguments.get("ports")
        self.settings = Settings(
            line=None if line is None else parse_line(line),
            profiles=bound,
            functions=with_vendor_functions(_modlens.Functions(), bound),
            ports=None if ports is None else tuple(ports),
        )
        self._statuses: dict[str, RecordingStatus] = {}
        self._is_cut = False
        self._run: FileRun | None = None

    def batches(self, *tables: str) -> Iterator[_modlens.Batch]:
        """The rows of these tables, until the recording ends or the time is over."""
        settings = replace(self.settings, tables=tables)
        run = self._run = FileRun([self.path], settings, on_status=self._note)
        end = time.monotonic() + MAX_SECONDS
        for batch in run.batches():
            yield batch
            if time.monotonic() > end:
                self._is_cut = True
                yield run.finish()
                return

    def rows(self, table: str, where: str | None = None) -> Iterator[_modlens.Table]:
        """The rows of a table that match a filter; `FilterError` if that cannot be understood."""
        from analyzer.filters import parse  # noqa: PLC0415 - 10 ms, which other tools do without

        predicate = None if where is None else parse(where, table).predicate()
        for batch in self.batches(table):
            rows: _modlens.Table = getattr(batch, table)
            yield rows if predicate is None else rows.where(predicate)

    def doctor(self) -> dict[str, Any]:
        """Returns the verdict on the rows so far; `diagnoses` has to be among the tables."""
        return {} if self._run is None else self._run.doctor()

    def stats(self) -> dict[str, Any]:
        """Statistics of the rows so far."""
        return {} if self._run is None else self._run.stats()

    @property
    def head(self) -> dict[str, Any]:
        """The beginning of an answer: the file, and that it was not read to its end."""
        found: dict[str, Any] = {"file": self.name}
        if self._is_cut:
            found["incomplete"] = f"only what could be read in {MAX_SECONDS:.0f} s is counted"
        return found

    @property
    def sources(self) -> list[dict[str, Any]]:
        """What the recordings turned out to be, and what of them could not be read."""
        return [_source(one) for one in self._statuses.values()]

    @property
    def has_dates(self) -> bool:
        """Whether a recording has moments in UTC; rows of others have no time."""
        return any(one.details.get("clock") == "utc" for one in self._statuses.values())

    def _note(self, status: RecordingStatus) -> None:
        self._statuses[status.name] = status


def _bindings(fence: Fence, text: str | None) -> tuple[Binding, ...]:
    """The profiles of `UNITS=NAME|FILE`; a file has to be inside the fence, too."""
    if text is None:
        return ()
    head, equals, word = text.rpartition("=")
    if any(mark in word for mark in "/\\") or word.lower().endswith(tuple(FORMS)):
        word = fence.resolve(word)
    return (parse_binding(f"{head}{equals}{word}"),)


def _source(status: RecordingStatus) -> dict[str, Any]:
    details = status.details
    if not status.format:
        return {"name": status.name, "skipped": status.reason}
    found = {
        "name": status.name,
        "format": status.format,
        "certainty": round(status.confidence, 2),
        "clock": details.get("clock") or "none",
        "resolution_ns": details.get("resolution_ns"),
        "trouble": details.get("trouble"),
        "skipped_records": details.get("dropped"),
        "lines_not_understood": details.get("unparsed") or None,
    }
    return {key: value for key, value in found.items() if value not in (None, {})}
