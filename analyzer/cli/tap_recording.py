"""The raw recording that a tap makes beside everything else."""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack

import _modlens
from analyzer.cli.tap_messages import TapMessages
from analyzer.counts import count_of
from analyzer.exports.recorder import (
    Recorder,
    RecordingStatus,
    parse_retention,
    parse_rotation,
)
from dissectors.errors import SourceError, UsageError

__all__ = ["TapRecording"]

REMIND_S = 60.0
"""How often it is said again that nothing can be recorded."""


class TapRecording:
    """The raw recording of `--record`; an observer of the run, because it reports trouble."""

    name = "the recording"

    def __init__(self, options: argparse.Namespace, tap_messages: TapMessages) -> None:
        self._path: str | None = options.record
        self._tap_messages = tap_messages
        self._recorder: Recorder | None = None
        self.status: RecordingStatus | None = None
        self._remind_at_s = 0.0
        if self._path is None and (options.rotate or options.keep):
            raise UsageError("--rotate and --keep are for --record FILE")
        self._rotate = None if options.rotate is None else parse_rotation(options.rotate)
        self._keep = None if options.keep is None else parse_retention(options.keep)

    @property
    def exit_status(self) -> int:
        """That of the tap: there was trouble, or all is well."""
        has_failed = self.status is not None and (self.status.had_trouble or self.status.lost)
        return SourceError.exit_status if has_failed else 0

    def open(self, opened: ExitStack) -> None:
        """Begin to record, if that is wanted; `opened` ends it."""
        if self._path is None:
            return
        self._recorder = Recorder(self._path, rotate=self._rotate, keep=self._keep)
        opened.callback(self.close)
        self._report()

    @property
    def core(self) -> _modlens.Recorder | None:
        """What takes the reads; None where nothing is recorded."""
        return None if self._recorder is None else self._recorder.core

    def put(self, batch: _modlens.Batch) -> None:
        """Tell what has happened to the recording since the last batch."""
        self._report()

    def current(self) -> RecordingStatus | None:
        """How the recording is going; None where there is none."""
        return None if self._recorder is None else self._recorder.status()

    def file(self) -> str | None:
        """The file that is written at the moment; None where nothing is recorded."""
        status = self.current()
        return None if status is None else str(status.file)

    def trouble(self) -> str | None:
        """Why nothing can be recorded at the moment."""
        status = self.current()
        return None if status is None else status.trouble

    def close(self) -> None:
        """End the recording."""
        if self._recorder is None or self.status is not None:
            return
        self.status = self._recorder.close()
        self._report()
        if self.status.lost:
            self._tap_messages.info(
                f"{self.status.file}: {count_of(self.status.lost, 'byte')} of the line"
                " could not be recorded"
            )

    def _report(self) -> None:
        if self._recorder is None:
            return
        now = time.monotonic()
        for text in self._recorder.take_messages():
            self._tap_messages.info(text)
            self._remind_at_s = now + REMIND_S
        if now >= self._remind_at_s:
            self._remind_at_s = now + REMIND_S
            trouble = self.trouble()
            if trouble is not None:
                self._tap_messages.info(f"still not recording: {trouble}")
