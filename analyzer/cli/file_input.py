"""The run of a command over its input files."""

from __future__ import annotations

import argparse

from analyzer.cli.messages import Messages
from analyzer.session import FileRun
from analyzer.settings import Settings

__all__ = ["file_run"]


def file_run(
    options: argparse.Namespace, settings: Settings, messages: Messages, *, follow: bool = False
) -> FileRun:
    """The run over the files that the options name; what is detected goes to `messages`."""
    return FileRun(
        options.files,
        settings,
        read_as=options.read_as,
        replay=getattr(options, "replay", False),
        on_status=messages.recording_status,
        follow=follow,
        progress=messages.progress,
    )
