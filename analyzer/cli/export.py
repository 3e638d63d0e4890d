"""`modlens export`: convert recordings to files; prints nothing unless something is wrong."""

from __future__ import annotations

import argparse

from analyzer.cli.outputs import run_files
from analyzer.cli.parser import add_archive, add_decoding, add_input, add_line, add_rows

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens export bus.bin -o bus.csv
  modlens export *.hex -o all.jsonl -o findings:findings.csv --strict
  modlens export bus.bin -o bus.pcapng            (for Wireshark)
  modlens export 'archive/**/*' -o out/ --style partitions

With --style partitions and a folder for -o, recordings are exported side by
side into out/date=.../bus=.../*.parquet: the rows of each recording in a file
for each day. The same command again exports what is new or has changed, and
goes on where it was interrupted. modlens wireshark-setup gives Wireshark
columns and colours for a pcapng.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    add_rows(parser)
    add_decoding(parser)
    add_line(parser)
    add_archive(
        parser,
        "recordings exported side by side with --style partitions; without it, threads that share"
        " the work on large files, of which more than four gain nothing",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Export; gives the exit status."""
    if options.style == "partitions":
        # What works on many files at once is loaded for them only.
        from analyzer.cli.archive_export import (  # noqa: PLC0415
            is_archive_export,
            run_archive_export,
        )

        if is_archive_export(options):
            return run_archive_export(options)
    return run_files(options, to=options.to, quiet=True)
