"""`modlens find`: find the register that holds a value that is known from elsewhere."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any

import _modlens
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.find_times import RecordedTimes, parsed_time
from analyzer.cli.history_file import History, load_history
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.selection import add_selection
from analyzer.cli.standard_streams import print_text
from analyzer.marks import marks_of
from analyzer.views.candidates import show_candidates
from analyzer.views.screen import stdout
from dissectors.errors import UsageError

__all__ = ["Search", "add_arguments", "add_known_value", "check_times", "run"]

CHANGES = ("up", "down", "same", "changed")
DEFAULT_WITHIN = "10s"

COLUMNS = (
    "unit", "register_type", "address", "count", "bit", "type", "order", "scale", "offset",
    "odds_bits", "rank",
)  # fmt: skip
"""The columns of `--to jsonl`."""

EPILOG = """\
examples:
  modlens find day.pcapng --value 231.4 --at 12:03:10 --within 5s
  modlens find day.pcapng --value 231.4 --at 12:03 --value 229.8 --at 12:40
  modlens find day.pcapng --like history.csv
  modlens find day.pcapng --same 9:00..9:30 --up 9:30..9:32 --down 10:05..10:10
  modlens find day.pcapng --up k1..k2 --down k2..k3

Times are those of the recording: 12:03:10, 2026-11-21T12:03:10Z, seconds since
its start, or k1, the first mark that k set while it was tapped. Write a value
with the digits that the display showed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    group = add_known_value(parser)
    for word, meaning in zip(
        CHANGES, ("went up", "went down", "was the same", "changed"), strict=True
    ):
        group.add_argument(
            f"--{word}", action="append", default=[], metavar="A..B",
            help=f"the value {meaning} from time A to time B; repeatable",
        )  # fmt: skip
    group = parser.add_argument_group("output")
    group.add_argument(
        "--times", choices=("local", "utc"), default="local",
        help="zone of times that state none, here and in the output (default: local)",
    )  # fmt: skip
    group.add_argument("--limit", type=int, default=5, metavar="N", help="show N (default: 5)")
    group.add_argument("--to", choices=("jsonl",), help="write one JSON object per candidate")
    add_selection(parser, times=False)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def add_known_value(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The options that say what is known of a value."""
    group = parser.add_argument_group("what is known of the value")
    group.add_argument(
        "--value", dest="values", action="append", default=[], metavar="X",
        help="a display showed X, such as 231.4; repeatable, each with its --at",
    )  # fmt: skip
    group.add_argument(
        "--at", dest="times_shown", action="append", default=[], metavar="T",
        help="when the value before it was shown (without: at some time in the recording)",
    )  # fmt: skip
    group.add_argument(
        "--within", metavar="TIME", default=DEFAULT_WITHIN,
        help=f"how far the clocks may differ (default: {DEFAULT_WITHIN})",
    )  # fmt: skip
    group.add_argument(
        "--like", metavar="FILE[:NAME]",
        help="a history of the value: a CSV file with times and numbers, exported from Home"
        " Assistant, Grafana or a web page; NAME chooses a column or an entity",
    )  # fmt: skip
    return group


def run(options: argparse.Namespace) -> int:
    """Search the recordings; gives the exit status."""
    _check(options)
    search = Search(options)
    messages = Messages(quiet=options.to is not None, timezone=options.timezone)
    files = file_run(options, replace(settings(options), tables=("transactions",)), messages)
    for batch in files.batches():
        search.add(batch)
    times, found = search.found()
    if options.to == "jsonl":
        print_text(_jsonl(found["candidates"][: options.limit]))
    else:
        show_candidates(found, options.limit, times.text, stdout())
    return 0


class Search:
    """The search for the register that holds what the options say of a value."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._history = _history(options.like)
        within = _modlens.parse_duration(options.within) if options.within else None
        if within is None:
            raise UsageError(f"--within {options.within}: not a duration; write 5s or 500ms")
        self._within = within
        self._marks = marks_of(options.files)
        self._finder = _modlens.Finder(_kept(options, within, self._marks))

    def add(self, batch: _modlens.Batch) -> None:
        """Add what a batch read and wrote."""
        self._finder.add(batch)

    def found(self) -> tuple[RecordedTimes, dict[str, Any]]:
        """The times of the recording, and the candidates, best first."""
        if self._finder.span is None:
            raise UsageError(
                "find: no register was read or written at a known time in this recording"
            )
        local = self._options.times == "local"
        times = RecordedTimes(*self._finder.span, self._marks, local=local)
        query = _query(self._options, times, self._within, self._history)
        found: dict[str, Any] = json.loads(self._finder.find(json.dumps(query)))
        return times, found


def _check(options: argparse.Namespace) -> None:
    """`UsageError` where nothing is known, or not every value has a time."""
    moves = any(getattr(options, word) for word in CHANGES)
    check_times(options)
    if not (options.values or options.like or moves):
        raise UsageError("find: say what is known of the value: --value, --like, --up, --down ...")
    if options.limit < 1:
        raise UsageError(f"--limit {options.limit}: at least 1")


def check_times(options: argparse.Namespace) -> None:
    """`UsageError` where only some values have a time."""
    if options.times_shown and len(options.times_shown) != len(options.values):
        raise UsageError(
            f"find: {len(options.values)} --value and {len(options.times_shown)} --at;"
            " give a time for each value, or for none"
        )


def _history(name: str | None) -> History | None:
    """The history that `--like` names."""
    if name is None:
        return None
    path, colon, column = name, "", ""
    if not Path(name).exists() and ":" in name:
        path, colon, column = name.rpartition(":")
    return load_history(path, column if colon else None)


def _kept(
    options: argparse.Namespace, within: int, marks: Mapping[int, int]
) -> list[tuple[int, int]]:
    """The times near which no sample may be dropped, where they are known before reading."""
    margin = within + 60_000_000_000
    texts = [*options.times_shown]
    for word in CHANGES:
        texts += [part for text in getattr(options, word, ()) for part in text.split("..")]
    local = options.times == "local"
    moments = [parsed_time(text, marks, local=local) for text in texts]
    return [(moment - margin, moment + margin) for moment in moments if moment is not None]


def _query(
    options: argparse.Namespace, times: RecordedTimes, within: int, history: History | None
) -> dict[str, Any]:
    shown = []
    for at, text in enumerate(options.values):
        value = _value(text)
        shown.append([float(value), max(0, -int(value.as_tuple().exponent)), None, None])
        if options.times_shown:
            shown[-1][2:] = [times.moment(options.times_shown[at], "--at"), within]
    moves = []
    for word in CHANGES:
        for text in getattr(options, word, ()):
            first, dots, last = text.partition("..")
            if not dots:
                raise UsageError(f"--{word} {text}: write two times, such as 9:30..9:35")
            pair = [times.moment(first, f"--{word}"), times.moment(last, f"--{word}")]
            if pair[1] <= pair[0]:
                raise UsageError(f"--{word} {text}: the second time is not after the first")
            moves.append([word, *pair])
    series = None
    if history is not None:
        series = {
            "times": history.times, "values": history.values, "has_zone": history.has_zone
        }  # fmt: skip
    return {"shown": shown, "moves": moves, "history": series}


def _value(text: str) -> Decimal:
    try:
        value = Decimal(text.replace(",", "."))
    except InvalidOperation:
        value = Decimal("NaN")
    if not value.is_finite():
        raise UsageError(
            f"--value {text}: not a number; write it with all its digits and without its unit,"
            " such as 231.4"
        )
    return value


def _jsonl(candidates: Sequence[Mapping[str, Any]]) -> str:
    lines = []
    for rank, one in enumerate(candidates, 1):
        row = {**one, "rank": rank}
        lines.append(json.dumps({key: row[key] for key in COLUMNS}) + "\n")
    return "".join(lines)
