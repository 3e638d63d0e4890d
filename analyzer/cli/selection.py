"""`--where` and `--between` of commands that count: which part of the recordings they look at."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from analyzer.counts import count_of
from dissectors.errors import UsageError

if TYPE_CHECKING:
    import _modlens
    from analyzer.cli.messages import Messages

__all__ = ["add_selection", "check_selected", "selected_rows", "selection_text"]


def add_selection(parser: argparse.ArgumentParser, *, times: bool = True) -> None:
    """Add `--where`, `--between` and, unless the command has its own, `--times`."""
    group = parser.add_argument_group("selection")
    group.add_argument(
        "--where",
        dest="select_where",
        metavar="EXPR",
        help='only transactions that meet this condition, such as "unit == 3" or "function in'
        ' (3, 4)", and their frames; modlens explain list prints the names',
    )
    group.add_argument(
        "--between",
        dest="select_between",
        nargs=2,
        metavar=("T1", "T2"),
        help="only what happened from T1 up to, but not including, T2: times with or without a"
        " date, yesterday, today, or seconds from the start",
    )
    if times:
        group.add_argument(
            "--times",
            choices=("local", "utc"),
            default="local",
            help="zone of times in --between that state none (default: local)",
        )


def selected_rows(options: argparse.Namespace) -> tuple[_modlens.Predicate, ...]:
    """What `--where` and `--between` choose, for `Settings.select`; empty where neither is given.

    `FilterError` or `UsageError` for a condition or times that cannot be understood.
    """
    if selection_text(options) is None:
        return ()
    from analyzer.filters import selection  # noqa: PLC0415 - rarely given

    return selection(lambda table: selection_text(options, table) or "")


def selection_text(options: argparse.Namespace, table: str = "transactions") -> str | None:
    """The condition that the two options make together; None where neither is given."""
    where: str | None = getattr(options, "select_where", None)
    between = getattr(options, "select_between", None)
    if between is None:
        return where
    from analyzer.cli.between import combine_filters  # noqa: PLC0415 - rarely given

    return combine_filters(where, between, zone=options.times, table=table)


def check_selected(
    options: argparse.Namespace, stats: Mapping[str, Any], messages: Messages
) -> None:
    """Report how many transactions were selected; nothing where only frames were.

    `UsageError` where the selection leaves neither transactions nor frames.
    """
    text = selection_text(options)
    if text is None:
        return
    if stats["transactions"]:
        count = count_of(sum(stats["transactions"].values()), "transaction")
        messages.info(f"only what meets {text}: {count}")
        return
    if any(count for bus in stats["buses"] for count in bus["frames"].values()):
        return
    given = [
        option
        for option, name in (("--where", "select_where"), ("--between", "select_between"))
        if getattr(options, name) is not None
    ]
    hint = "" if options.select_between is None else (
        "; times without a zone are local ones (--times utc), and a log without a date or zone has"
        " none but seconds since its start (--date and --timezone give them)"
    )  # fmt: skip
    raise UsageError(f"{' and '.join(given)}: nothing in this recording meets this{hint}")
