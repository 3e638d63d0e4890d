"""`modlens security`: who does on the bus what nobody should, and what differs from a baseline."""

from __future__ import annotations

import argparse

from analyzer.baseline_file import dumps, merge
from analyzer.cli.import_ import write_text
from analyzer.cli.live_watch import check_codes
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED
from analyzer.cli.parser import add_decoding, add_input, add_line, add_list
from analyzer.cli.selection import add_selection
from analyzer.cli.standard_streams import print_text
from analyzer.cli.watched_files import read_baseline, watched
from analyzer.security import SEVERITIES, Finding, Rule, load_rules, rules
from analyzer.views.screen import Screen, stdout
from analyzer.views.security import FORMATS, render, show_findings
from dissectors.errors import ProfileError, SourceError, UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens security capture.pcap
  modlens baseline monday.pcap -o usual.toml
  modlens security tuesday.pcap --baseline usual.toml --to md
  modlens security tuesday.pcap --baseline usual.toml --accept new_client

The rules, their thresholds and what each means: modlens security --list
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    add_input(parser)
    parser.add_argument(
        "--baseline", metavar="TOML", help="also report what differs from this baseline"
    )
    parser.add_argument(
        "--accept",
        action="append",
        default=[],
        metavar="CODE",
        help="with --baseline: add what findings of this code report to the baseline; repeatable",
    )
    parser.add_argument(
        "--rules", action="append", default=[], metavar="TOML", help="further rules; repeatable"
    )
    add_list(parser, _list, "list the rules of modlens with their limits")
    parser.add_argument("--to", choices=FORMATS, help="write to standard output, instead of text")
    parser.add_argument(
        "--strict",
        action="store_true",
        help="exit with status 1 if there is a finding of severity high or medium",
    )
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Decode the recordings, then show the findings; gives the exit status."""
    table = [*rules(), *(rule for path in options.rules for rule in _rules_of(path))]
    if options.accept and options.baseline is None:
        raise UsageError("security: --accept needs --baseline")
    check_codes(set(options.accept))
    usual = None if options.baseline is None else read_baseline(options.baseline)
    messages = Messages(quiet=options.to is not None, timezone=options.timezone)
    watch, status = watched(options, table, messages)
    found = watch.alerts()
    if usual is not None:
        try:
            found += watch.deviations(usual)
        except ValueError as error:
            raise ProfileError(str(error), path=options.baseline) from error
        if options.accept:
            accepted = [one.facts for one in found if one.rule.code in options.accept]
            text = dumps(merge(usual, watch.usage(), accepted))
            write_text(text, options.baseline)
            found = [one for one in found if one.rule.code not in options.accept]
    found.sort(key=lambda one: SEVERITIES.index(one.rule.severity))
    _show(options.to, found, watch.not_judged())
    is_bad = any(one.rule.severity in ("high", "medium") for one in found)
    return status or (DAMAGED if options.strict and is_bad else 0)


def _rules_of(path: str) -> tuple[Rule, ...]:
    try:
        with open(path, encoding="utf-8") as file:
            return load_rules(file.read(), path)
    except (OSError, UnicodeError) as error:
        raise SourceError(f"--rules {path}: cannot be read: {error}") from error


def _show(form: str | None, found: list[Finding], not_judged: list[str]) -> None:
    rows = [one.row() for one in found]
    if form is not None:
        print_text(render(rows, form))
        return
    screen = stdout()
    if not rows:
        screen.line("No finding.", "ok")
    show_findings(rows, screen)
    if not_judged:
        screen.line(
            f"Not judged, because the recording has no times: {', '.join(not_judged)}.", "dim"
        )


def _list(screen: Screen) -> None:
    """Show each rule in a line."""
    for rule in rules():
        limit = ""
        if "count" in rule.condition:
            limit = f" ({rule.condition['count']} within {rule.condition['within_s']:g} s)"
        kind = "" if rule.condition else " (with --baseline)"
        screen.line(f"{rule.severity:<6} {rule.code:<22} {rule.title}{limit}{kind}")
