"""`modlens dashboards`: files for Grafana and Home Assistant, ready to import."""

from __future__ import annotations

import argparse

from analyzer.cli.recording_document import write_page
from analyzer.dashboards import DASHBOARDS

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens dashboards grafana -o bus-health.json
  modlens dashboards home-assistant -o modlens.yaml

Grafana imports the file under Dashboards, New, Import. The cookbook has the
commands that fill them.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    about = "; ".join(f"{name}: {one.title}" for name, one in DASHBOARDS.items())
    parser.add_argument("name", choices=DASHBOARDS, metavar="NAME", help=about)
    parser.add_argument(
        "-o", dest="output", default="-", metavar="FILE", help="file to write (default: print it)"
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Write the file; gives the exit status."""
    write_page(options.output, DASHBOARDS[options.name].text().encode())
    return 0
