"""`modlens mcp`: read-only tools over recordings, for assistants that speak MCP."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import _modlens
from analyzer.assistants.fence import Fence
from analyzer.assistants.protocol import Server
from analyzer.assistants.tools import INSTRUCTIONS, RecordingTools
from analyzer.cli.standard_streams import print_text

__all__ = ["add_arguments", "run"]

SKILL = Path(__file__).parents[1] / "assistants" / "SKILL.md"

EPILOG = """\
examples:
  modlens mcp recordings/
  modlens mcp --skill > .claude/skills/modlens/SKILL.md

An assistant starts this command itself; its configuration names it:

  {"mcpServers": {"modlens":
    {"command": "modlens", "args": ["mcp", "/home/me/recordings"]}}}

The server speaks the Model Context Protocol on standard input and output. It
reads recordings in the folders and nothing else, and writes nothing.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "folders",
        nargs="*",
        metavar="DIR",
        help="a folder with recordings that may be read (default: the current folder)",
    )
    parser.add_argument(
        "--skill",
        action="store_true",
        help="print a SKILL.md that teaches an assistant with a shell the command line, and exit",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Serve until standard input ends; gives the exit status."""
    if options.skill:
        print_text(SKILL.read_text(encoding="utf-8"))
        return 0
    server = Server(
        RecordingTools(Fence(options.folders or ["."])),
        name="modlens",
        version=_modlens.__version__,
        instructions=INSTRUCTIONS,
    )
    server.serve(sys.stdin.buffer, sys.stdout.buffer)
    return 0
