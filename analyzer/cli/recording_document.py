"""Recordings that are read to their end, and the document of what they hold."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

from analyzer.bus_file import choose_bus
from analyzer.cli.chosen_settings import settings
from analyzer.cli.ignored import ignored_for
from analyzer.cli.messages import Messages
from analyzer.cli.segmentation import report_silence_limits
from analyzer.cli.selection import check_selected, selection_text
from analyzer.cli.standard_streams import print_text
from analyzer.cli.stop_signals import StopSignals
from analyzer.session import FileRun, RecordingStatus
from dissectors.errors import SourceError

__all__ = ["RecordingDocument", "write_page"]


class RecordingDocument:
    """The document of the recordings that the options name; it is made when they have been read.

    A signal ends the reading; the document then holds what was read until it came. Its `overview`
    is whole, or has the time series alone that `modlens stats` draws.
    """

    def __init__(
        self,
        options: argparse.Namespace,
        messages: Messages,
        stop_signals: StopSignals,
        *,
        overview: Literal["series", "all"] = "all",
    ) -> None:
        self._statuses: list[RecordingStatus] = []
        self._options = options
        self._settings = replace(settings(options), tables=("diagnoses",), overview=overview)
        self._title = _title(options)
        self._messages = messages
        report_silence_limits(self._settings, messages)
        self._files = FileRun(
            options.files,
            self._settings,
            read_as=options.read_as,
            on_status=self._note,
            notify=messages.info,
            progress=messages.progress,
        )
        for _ in self._files.batches():
            if stop_signals.received():
                self._files.finish()
                break
        check_selected(options, self._files.stats(), messages)

    @cached_property
    def document(self) -> dict[str, Any]:
        """The document; docs/stats.schema.json describes it."""
        from analyzer.report.document import complete  # noqa: PLC0415

        functions = self._settings.functions
        made = complete(self.counted, self._statuses, functions, title=self._title)
        if selected := selection_text(self._options):
            made["summary"]["period"] += f" Only what meets {selected}."
        return made

    @cached_property
    def counted(self) -> dict[str, Any]:
        """What the core has counted: all of the document that `modlens stats` shows as text."""
        return self._files.document()

    @property
    def unreadable(self) -> int:
        """The recordings that could not be read, or not to their end."""
        return self._files.unreadable

    def _note(self, status: RecordingStatus) -> None:
        self._statuses.append(status)
        self._messages.recording_status(status)
        if status.format and not status.ended:
            for text in ignored_for(self._options, status.format):
                self._messages.info(f"{status.name}: {text}")


def _title(options: argparse.Namespace) -> str | None:
    """Returns the name of the plant or bus in the options: `--title`, or that of the bus file."""
    title: str | None = getattr(options, "title", None)
    return title or (None if options.bus is None else choose_bus(options.bus).name)


def write_page(name: str, content: bytes) -> None:
    """Write a page to a file, or to standard output; `SourceError` where that is not possible."""
    if name == "-":
        print_text(content.decode())
        return
    from pathlib import Path  # noqa: PLC0415

    target = Path(name)
    partial = target.with_name(f"{target.name}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(target)
    except OSError as error:
        raise SourceError(f"{name}: {error.strerror or error}") from error
