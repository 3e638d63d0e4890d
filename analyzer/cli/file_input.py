"""The run of a command over its input files."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from analyzer.cli.messages import Messages
from analyzer.session import FileRun
from analyzer.settings import Settings

__all__ = ["file_run"]


def file_run(
    options: argparse.Namespace,
    settings: Settings,
    messages: Messages,
    *,
    files: Sequence[str] | None = None,
    follow: bool = False,
) -> FileRun:
    """The run over `files`, or those that the options name; what is detected goes to `messages`."""
    return FileRun(
        options.files if files is None else files,
        settings,
        read_as=options.read_as,
        replay=getattr(options, "replay", False),
        on_status=messages.recording_status,
        follow=follow,
        progress=messages.progress,
    )
