"""The argument parser, and the options that several commands share.

Errors of use are one line without the usage text.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NoReturn

from analyzer.addresses import BASES
from analyzer.archive import BUS_NAMES
from analyzer.cli.segmentation import add_segmentation
from analyzer.columns import TABLES
from analyzer.line import EXAMPLE
from analyzer.settings import MODES
from analyzer.views.screen import Screen, stdout
from dissectors.errors import UsageError

__all__ = [
    "Parser",
    "add_archive",
    "add_decoding",
    "add_dialects",
    "add_functions",
    "add_input",
    "add_line",
    "add_list",
    "add_rows",
    "add_strict",
]

TIMES = ("local", "utc", "elapsed", "delta")

_ROWS_OF_ONE = "which rows is a condition: {prog} FILE --where 'unit == 3'"
_HINTS = (
    ("--between: expected", "it takes a beginning and an end, such as --between yesterday today"),
    (
        "argument --txn: invalid int",
        "show takes one; for several: modlens decode FILE --where '10 <= txn <= 20'",
    ),
    ("required: -o", "it names the file to write: {prog} FILE -o report.html"),
    *((f"unrecognized arguments: --{word}", _ROWS_OF_ONE) for word in ("unit", "slave", "filter")),
)
"""Words of a message -> what to say after it."""


class Parser(argparse.ArgumentParser):
    """An argument parser that raises `UsageError` where argparse would print its usage and exit."""

    def __init__(self, *, prog: str, description: str) -> None:
        super().__init__(
            prog=prog,
            description=description,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    def error(self, message: str) -> NoReturn:
        """Raise the message as `UsageError`."""
        hint = next((hint for words, hint in _HINTS if words in message), "see {prog} --help")
        selects = "--where" in self._option_string_actions or hint != _ROWS_OF_ONE
        hint = hint.format(prog=self.prog if selects else "modlens decode")
        raise UsageError(f"{self.prog.removeprefix('modlens ')}: {message}; {hint}")


def add_line(parser: argparse.ArgumentParser) -> None:
    """Add `--line`, and `--baud`, `--bits`, `--parity`, `--stop` for its parts."""
    group = parser.add_argument_group("line settings")
    group.add_argument(
        "--line",
        metavar=EXAMPLE,
        help="all line settings at once: baud rate, data bits, parity, stop bits",
    )
    group.add_argument(
        "--baud",
        type=int,
        metavar="N",
        help="baud rate (instead of --line; omitted settings use their defaults)",
    )
    group.add_argument(
        "--bits",
        type=int,
        metavar="N",
        help="with --baud: data bits (default: 8, or 7 with --mode ascii)",
    )
    group.add_argument(
        "--parity",
        metavar="P",
        help="with --baud: parity, N none, E even, O odd, M mark, S space (default: E)",
    )
    group.add_argument(
        "--stop",
        type=float,
        metavar="N",
        help="with --baud: stop bits, 1, 1.5 or 2 (default: 1)",
    )


def add_decoding(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how bytes become transactions: `--mode`, `--timeout` ..."""
    group = parser.add_argument_group("decoding")
    group.add_argument("--mode", choices=MODES, default="auto", help="framing (default: auto)")
    group.add_argument(
        "--port",
        dest="tcp_ports",
        action="append",
        default=[],
        metavar="N",
        help="network captures only: TCP and UDP ports that carry Modbus, such as 502,1502,"
        " or any for all ports (default: 502)",
    )
    group.add_argument(
        "--channels",
        metavar="A,B",
        help="logic-analyzer samples only: channels to use, such as RX,TX; write !RX if the"
        " line is inverted (default: detected)",
    )
    group.add_argument(
        "--timeout",
        metavar="TIME",
        help="response timeout, such as 500ms or 1.5s (default: estimated from the traffic,"
        " else until the next request)",
    )
    group.add_argument(
        "--profile",
        dest="profiles",
        action="append",
        default=[],
        metavar="[UNITS=]NAME|FILE",
        help="device profile, which names the registers and scales their values; optionally for"
        " certain units, such as 1=mightyzap or 2-7=pump.yaml; repeatable",
    )
    group.add_argument(
        "--bus",
        metavar="FILE[:NAME]",
        help="bus file with the port, the line settings and the profiles of the units",
    )
    add_segmentation(group)
    add_functions(group)


def add_archive(parser: argparse.ArgumentParser, threads: str) -> None:
    """Add the options for many recordings of many buses; `threads` says what is in one each."""
    group = parser.add_argument_group("archives")
    group.add_argument(
        "--threads",
        type=int,
        metavar="N",
        help=f"{threads} (default: one for each processor core)",
    )
    group.add_argument(
        "--bus-names",
        choices=BUS_NAMES,
        default=BUS_NAMES[0],
        help="how to name a bus that its recording does not name: after the recording's folder in"
        " the archive (default), its file name without suffix (stem), or its path",
    )


def add_functions(parser: argparse._ActionsContainer) -> None:
    """Add `--functions`, which can be repeated."""
    parser.add_argument(
        "--functions",
        action="append",
        default=[],
        metavar="NAME|FILE",
        help="additional function codes: the name of a vendor or a TOML file; repeatable",
    )


def add_input(parser: argparse.ArgumentParser, *, optional: bool = False) -> None:
    """Add `FILE...`, `--from` and what text recordings leave open: `--timezone`, `--date`."""
    parser.add_argument(
        "files",
        nargs="*" if optional else "+",
        metavar="FILE",
        help="a recording, or an archive, e-mail or directory that contains recordings; -"
        " reads standard input",
    )
    parser.add_argument(
        "--from",
        dest="read_as",
        metavar="FORMAT",
        help="format of the files, instead of detecting it (modlens formats lists them)",
    )
    parser.add_argument(
        "--timezone",
        metavar="ZONE",
        help="time zone of timestamps that do not state one: local, Europe/Berlin or +01:00"
        " (without it, such a recording has only times since its start)",
    )
    parser.add_argument(
        "--date",
        metavar="DAY",
        help="date of the first entry, if timestamps carry no date, such as 2026-11-21",
    )
    add_dialects(parser)


def add_dialects(parser: argparse._ActionsContainer) -> None:
    """Add `--dialects`, which can be repeated."""
    parser.add_argument(
        "--dialects",
        action="append",
        default=[],
        metavar="FILE",
        help="TOML file that defines additional formats of text logs (dialects); repeatable",
    )


def add_rows(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose rows (`--table`, `--where`) and outputs (`-o`, `--to`)."""
    group = parser.add_argument_group("rows")
    group.add_argument(
        "--table",
        choices=TABLES,
        default=TABLES[0],
        metavar="TABLE",
        help=f"table to print or export: {', '.join(TABLES)} (default: {TABLES[0]})",
    )
    group.add_argument(
        "--columns",
        metavar="A,B,C",
        help="columns to write, in this order (with --to csv or -o FILE, for example)",
    )
    group.add_argument(
        "--where",
        metavar="EXPR",
        help="only rows that meet this condition, such as \"unit == 1 and 'retry' in findings\" or"
        " \"write and address == '40001'\"; modlens explain list prints the names",
    )
    group.add_argument(
        "--between",
        nargs=2,
        metavar=("T1", "T2"),
        help="only rows from T1 up to, but not including, T2: times as the table shows them, with"
        " or without a date, in the same zone (--times), or yesterday, today, or seconds from"
        " the start",
    )
    group.add_argument(
        "--limit", type=int, metavar="N", help="at most N rows in the table and in each file"
    )
    _add_output(parser)


def _add_output(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("output")
    group.add_argument(
        "--address",
        choices=BASES,
        default="wire",
        help="address notation in tables: wire counts from 0, as sent (default)",
    )
    group.add_argument(
        "--times",
        choices=TIMES,
        default="local",
        help="how tables show times (default: local: this computer's zone, not that of --timezone)",
    )
    group.add_argument(
        "--to",
        metavar="FORMAT",
        help="format for standard output: table, csv, jsonl, ... (modlens formats lists them)",
    )
    group.add_argument(
        "-o",
        dest="outputs",
        action="append",
        default=[],
        metavar="OUT",
        help="output file; its extension selects the format, a prefix the table, as in"
        " frames:OUT.csv; repeatable",
    )
    group.add_argument(
        "--style",
        metavar="WORD",
        help="variant of the output format. pcapng: udp (Modbus/UDP, every function decoded by"
        " Wireshark; default), rtu (for its RTU dissector), tcp (dressed as Modbus/TCP), original"
        " (the recording's own packets); zeek, icsnpp: tsv (default) or json; parquet: partitions"
        " (a folder for each day and bus); csv: excel (with times that Excel reads)",
    )
    group.add_argument(
        "--context",
        type=int,
        default=0,
        metavar="N",
        help="when writing pcap or pcapng, also keep the N frames before and after each match",
    )
    add_strict(group)


def add_strict(parser: argparse._ActionsContainer) -> None:
    """Add `--strict` for commands that read recordings."""
    parser.add_argument(
        "--strict",
        action="store_true",
        help="exit with status 1 if any frame was damaged or any line of a text recording could not"
        " be parsed",
    )


def add_list(parser: argparse.ArgumentParser, show: Callable[[Screen], None], what: str) -> None:
    """Add `--list`, which shows `what` and exits; no other argument is needed then."""

    class List(argparse.Action):
        def __call__(
            self,
            parser: argparse.ArgumentParser,
            _namespace: argparse.Namespace,
            _values: object,
            _option: str | None = None,
        ) -> None:
            show(stdout())
            parser.exit()

    parser.add_argument("--list", action=List, nargs=0, help=f"{what}, and exit")
