"""Security findings and deviations from a baseline while a recording is read or a line is tapped.

`--security`, `--baseline` and `--accept` of decode, doctor and tap. `modlens security` shows the
same findings with all their texts.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

import _modlens
from analyzer.baseline_file import dumps, merge
from analyzer.cli.import_ import write_text
from analyzer.cli.watched_files import read_baseline
from analyzer.pump import PartialBatch
from analyzer.security import Finding, Watch, rules
from analyzer.settings import Settings
from analyzer.views.security import time_text
from dissectors.errors import ProfileError, UsageError

__all__ = ["LiveWatch", "add_watch", "check_codes", "live_watch", "with_watched_tables"]

_WATCHED = ("transactions", "frames", "connections")


def add_watch(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    group = parser.add_argument_group("security")
    group.add_argument(
        "--security",
        action="store_true",
        help="report security findings as they begin (modlens security --list prints the rules)",
    )
    group.add_argument(
        "--baseline",
        metavar="TOML",
        help="with the findings of --security, report what differs from this baseline, which"
        " modlens baseline wrote",
    )
    group.add_argument(
        "--accept",
        action="append",
        default=[],
        metavar="CODE",
        help="with --baseline: at the end, add what findings of this code report to the baseline;"
        " repeatable",
    )


def with_watched_tables(options: argparse.Namespace, settings: Settings) -> Settings:
    """The settings with the tables that the options need."""
    if not (getattr(options, "security", False) or getattr(options, "baseline", None)):
        return settings
    return replace(settings, tables=tuple(sorted({*settings.tables, *_WATCHED})))


def live_watch(options: argparse.Namespace, notify: Callable[[str], None]) -> LiveWatch | None:
    """What the options ask for; None where they are not given. Findings go to `notify`."""
    accepted = set(getattr(options, "accept", ()))
    baseline = getattr(options, "baseline", None)
    if accepted and baseline is None:
        raise UsageError("--accept needs --baseline")
    check_codes(accepted)
    if baseline is None and not getattr(options, "security", False):
        return None
    return LiveWatch(baseline, accepted, notify)


def check_codes(accepted: set[str]) -> None:
    """Raise `UsageError` for a code of `--accept` that no deviation has."""
    known = {rule.code for rule in rules() if not rule.condition}
    for code in sorted(accepted - known):
        raise UsageError(f"--accept {code}: it is one of {', '.join(sorted(known))}")


class LiveWatch:
    """A sink that reports each finding once, when it begins. `found` are all of them."""

    name = "security"

    def __init__(
        self, baseline: str | None, accepted: set[str], notify: Callable[[str], None]
    ) -> None:
        self.found: list[Finding] = []
        self._right: list[Finding] = []
        self._path = baseline
        self._accepted = accepted
        self._notify = notify
        self._usual = None if baseline is None else read_baseline(baseline)
        try:
            self._watch = Watch(rules(), self._usual)
        except ValueError as error:
            raise ProfileError(str(error), path=baseline or "") from error

    def put(self, batch: _modlens.Batch) -> None:
        """Look at the rows of a batch."""
        self._watch.add(batch.whole if isinstance(batch, PartialBatch) else batch)
        self._report()

    def finish(self) -> None:
        """Report what waited for more rows, and edit the baseline as `--accept` says."""
        self._watch.finish()
        self._report()
        if self._accepted and self._path is not None and self._usual is not None:
            facts = [one.facts for one in self._right]
            write_text(dumps(merge(self._usual, self._watch.usage(), facts)), self._path)
            self._notify(f"{self._path}: {', '.join(sorted(self._accepted))} accepted")

    def _report(self) -> None:
        for one in self._watch.news():
            if one.rule.code in self._accepted:
                self._right.append(one)
                continue
            self.found.append(one)
            since = one.facts.get("since_ns")
            when = "" if since is None else f"{time_text(since)} "
            self._notify(f"{when}{one.rule.severity} {one.rule.code}: {one.sentence}")
