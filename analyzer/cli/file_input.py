"""The run of a command over its input files."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from analyzer.cli.ignored import ignored_for
from analyzer.cli.messages import Messages
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings

if TYPE_CHECKING:
    from analyzer.pool import Pool

__all__ = ["file_run"]


def file_run(  # noqa: PLR0913 - three by keyword
    options: argparse.Namespace,
    settings: Settings,
    messages: Messages,
    *,
    files: Sequence[str] | None = None,
    follow: bool = False,
    pool: Pool | None = None,
) -> FileRun:
    """The run over `files`, or those that the options name; what is detected goes to `messages`.

    The threads of a `pool` read what is decoded next.
    """

    def note(status: RecordingStatus) -> None:
        messages.recording_status(status)
        if status.format and not status.ended:
            for text in ignored_for(options, status.format):
                messages.info(f"{status.name}: {text}")

    return FileRun(
        options.files if files is None else files,
        settings,
        read_as=options.read_as,
        replay=getattr(options, "replay", False),
        on_status=note,
        notify=messages.info,
        follow=follow,
        progress=messages.progress,
        ahead=None if pool is None else pool.ahead,
    )
