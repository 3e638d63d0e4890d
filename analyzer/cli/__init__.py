"""The command line: `modlens COMMAND ...`.

Nothing but the table of commands is loaded before a command is chosen.

Each command is a module of its name: `add_arguments(parser)`, and `run(options)`, which gives the
exit status. Exit statuses: 0 done; 1 done, but `--strict` and something was damaged; 2 wrong use; 3
input unreadable or output not writable; 4 port trouble.
"""

from __future__ import annotations

import gc
import importlib
import os
import stat
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, TextIO

from analyzer.cli.standard_streams import (
    STDOUT,
    discard_output,
    open_missing_streams,
)
from analyzer.cli.standard_streams import report as write_message

if TYPE_CHECKING:
    from analyzer.cli.parser import Parser
    from dissectors.errors import ModlensError

__all__ = ["COMMANDS", "main", "module_of", "parser_of"]

COMMANDS = {
    "tap": "listen to a serial line and decode its traffic live",
    "decode": "decode recordings into a table on the screen, or into files",
    "export": "convert recordings to files without printing a table (for scripts)",
    "show": "show the bytes of one frame or transaction and what they mean",
    "doctor": "say what is wrong on the line, why, and what to do",
    "stats": "statistics: traffic, errors, response times and findings",
    "security": "say who does on the bus what nobody should, and what is not usual",
    "baseline": "describe what is usual on the bus, to compare with later",
    "diff": "say what differs between two recordings",
    "join": "say which client of a gateway caused what on its serial line",
    "report": "write one page: what is on the bus, whether it is healthy, what to do",
    "page": "write a page that decodes recordings in a browser, with nothing installed",
    "plot": "draw readings over time, in the terminal or as a picture",
    "ports": "list this computer's serial ports",
    "explain": "explain a function code, exception code, finding or status",
    "craft": "build a frame from a function and its field values",
    "formats": "list the formats that can be read and written, with samples",
    "profiles": "list, check or convert device profiles",
    "import": "convert another program's register map to a profile",
    "map": "show each register's last value, range and number of changes",
    "learn": "generate a draft device profile from recorded traffic",
    "match": "find the known profile that best matches a unit",
    "find": "find the register that holds a value, by history or changes",
    "extcap": "add serial lines to Wireshark's list of interfaces",
    "dashboards": "write a dashboard for Grafana or Home Assistant, ready to import",
    "mcp": "serve recordings to an assistant as read-only tools (MCP)",
    "wireshark-setup": "install a Wireshark profile with columns and colours",
}
"""The commands, with one line about each; `module_of` gives a command's module."""

INTERRUPTED = 130
NO_PAGER = "--no-pager"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status; every error is printed as one line."""
    open_missing_streams()
    _survive_odd_text(sys.stdout, sys.stderr)
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] == [NO_PAGER]:
        words = [*words[1:2], NO_PAGER, *words[2:]]
    if not words or words[0] in ("-h", "--help", "help"):
        return _run_help(words[1:])
    if words[0] in ("-V", "--version", "version"):
        return _version()
    if words[0] not in COMMANDS:
        words = [*_implied_command(words[0]), *words]
    try:
        return _run(words[0], words[1:], is_program=arguments is None)
    except BrokenPipeError:
        discard_output(STDOUT)
        return 0
    except KeyboardInterrupt:
        return INTERRUPTED


def _implied_command(name: str) -> list[str]:
    """The command that a name in its place stands for: a port is tapped, a recording decoded."""
    if "://" in name:
        return ["tap"]
    try:
        mode = os.stat(name).st_mode
    except (OSError, ValueError):
        return ["decode"] if name == "-" else []
    return ["tap" if stat.S_ISCHR(mode) else "decode"]


def _run(command: str, words: list[str], *, is_program: bool) -> int:
    """Run one command; errors that the user can correct become lines on standard error.

    Gives the exit status of the command, or that of the error. `is_program` says that nothing else
    runs in this interpreter.
    """
    from dissectors.errors import ModlensError  # noqa: PLC0415

    try:
        if command not in COMMANDS:
            return _unknown(command)
        from analyzer.cli.pager import paged, wants_pager  # noqa: PLC0415

        # Modules, classes and parsers stay. To go through them again and again, and at the end,
        # finds no garbage and is a twentieth of a short run.
        if is_program:
            gc.disable()
        module = importlib.import_module(module_of(command))
        options = parser_of(command).parse_intermixed_args(words)
        if is_program:
            gc.freeze()
            gc.enable()
        status: int
        with paged(wanted=wants_pager(command, options)):
            try:
                status = module.run(options)
                _flush(reported=status != 0)
            except ModlensError as error:
                return _report_error(error)
    except ModlensError as error:
        return _report_error(error)
    return status


def _report_error(error: ModlensError) -> int:
    for line in error.message.split("\n"):
        write_message(f"modlens: {line}")
    _flush(reported=True)
    return error.exit_status


def parser_of(command: str) -> Parser:
    """The parser of a command's words."""
    from analyzer.cli.pager import PAGED  # noqa: PLC0415
    from analyzer.cli.parser import Parser  # noqa: PLC0415

    parser = Parser(prog=f"modlens {command}", description=f"{COMMANDS[command]}.")
    importlib.import_module(module_of(command)).add_arguments(parser)
    if command in PAGED:
        parser.add_argument(NO_PAGER, action="store_true", help="never show output in a pager")
    return parser


def module_of(command: str) -> str:
    """The module of a command; a Python keyword such as `import` gets an underscore after it.

    >>> module_of("wireshark-setup"), module_of("import")
    ('analyzer.cli.wireshark_setup', 'analyzer.cli.import_')
    """
    name = command.replace("-", "_")
    return f"analyzer.cli.{name}{'_' if name == 'import' else ''}"


def _flush(*, reported: bool) -> None:
    """Flush standard output; `SourceError` if that fails and no error has been reported yet."""
    from dissectors.errors import SourceError  # noqa: PLC0415

    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        discard_output(STDOUT)
        if not reported:
            message = f"standard output: cannot be written: {error.strerror}"
            raise SourceError(message) from error


def _run_help(words: list[str]) -> int:
    """Print the list of commands, or the help of one; gives the exit status."""
    if words and words[0] in COMMANDS:
        return main([words[0], "--help"])
    out = sys.stdout
    out.write("modlens: a passive Modbus sniffer and protocol analyzer; it never transmits\n\n")
    out.write("usage: modlens COMMAND ...       modlens COMMAND --help for details\n\n")
    for name, summary in COMMANDS.items():
        out.write(f"  {name:<16} {summary}\n")
    out.write("\n  modlens FILE decodes a recording, modlens PORT taps a serial port.\n")
    out.write("\n  modlens decode bus.hex                       a recording as a table\n")
    out.write("  modlens tap /dev/ttyUSB0                     a serial line, decoded live\n")
    out.write("  modlens show 01 03 00 6B 00 03 74 17         one frame, byte by byte\n")
    out.write(
        "\nexit status: 0 done, 1 damage found with --strict, 2 wrong use, 3 a file cannot be read"
    )
    out.write(" or written,\n4 port trouble\n")
    return 0


def _version() -> int:
    import _modlens  # noqa: PLC0415

    sys.stdout.write(f"modlens {_modlens.__version__}\n")
    return 0


def _unknown(command: str) -> int:
    from dissectors.errors import UsageError  # noqa: PLC0415
    from dissectors.function_lookup import similar_name  # noqa: PLC0415

    hint = similar_name(command, COMMANDS)
    question = f"did you mean {hint!r}?" if hint else f"choose from {', '.join(COMMANDS)}"
    if any(mark in command for mark in "./\\"):
        raise UsageError(f"{command}: no such file, and no command (modlens --help lists them)")
    raise UsageError(f"unknown command {command!r}; {question}")


def _survive_odd_text(*streams: TextIO) -> None:
    """Make characters that a terminal's encoding lacks appear as escapes instead of raising."""
    for stream in streams:
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="backslashreplace")
