"""Security rules and the comparison with a baseline: the table `security.toml`, and its findings.

A rule is a filter over transactions, frames or connections, with a count and a window of time. The
core counts (`_modlens.Watch`); this module reads the table and writes the sentences.

>>> next(rule.title for rule in rules() if rule.code == "listen_only")
'a device was ordered to stop responding'
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

import _modlens
from analyzer import filters
from analyzer.columns import TABLES
from dissectors.errors import FilterError, ProfileError

__all__ = ["SEVERITIES", "Finding", "Rule", "Watch", "load_rules", "rules"]

SEVERITIES = ("high", "medium", "low", "info")
_TEXTS = ("code", "title", "severity", "meaning", "evidence", "check", "normal")
_CONDITION = ("where", "table", "pdu", "per", "count", "within_s", "distinct", "only_once")
_KEYS = {*_TEXTS, *_CONDITION, "technique", "deviation"}
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Rule:
    """A row of the table of rules."""

    code: str
    title: str
    severity: str
    technique: tuple[str, str]
    meaning: str
    evidence: str
    check: str
    normal: str
    condition: Mapping[str, Any] = field(default_factory=dict)
    """What the core needs: empty for deviations from a baseline."""


@dataclass(frozen=True, slots=True)
class Finding:
    """An alert of a rule, or a deviation from a baseline. Times are nanoseconds."""

    rule: Rule
    sentence: str
    facts: Mapping[str, Any]

    def row(self) -> dict[str, Any]:
        """The finding as a flat row, in the order of its columns."""
        technique, technique_name = self.rule.technique
        keys = ("bus", "client", "unit", "function", "address", "quantity", "count")
        return {
            "code": self.rule.code,
            "severity": self.rule.severity,
            "technique": technique,
            "technique_name": technique_name,
            **{key: self.facts.get(key) for key in keys},
            "since_ns": self.facts.get("since_ns"),
            "until_ns": self.facts.get("until_ns"),
            "sentence": self.sentence,
            "meaning": self.rule.meaning,
            "check": self.rule.check,
            "normal": self.rule.normal,
            "examples": list(self.facts.get("examples", [])),
        }


@cache
def rules() -> tuple[Rule, ...]:
    """The rules of modlens, in the order of their table."""
    text = resources.files("analyzer").joinpath("security.toml").read_text(encoding="utf-8")
    return load_rules(text, "security.toml")


def load_rules(text: str, path: str) -> tuple[Rule, ...]:
    """Read a table of rules; `ProfileError` names the file, the rule and the key that is wrong."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(str(error), path=path) from error
    found = table.get("rule", [])
    if table.get("format") != 1 or not isinstance(found, list):
        raise ProfileError(
            "a table of rules begins with format = 1 and has rows [[rule]]", path=path
        )
    return tuple(_rule(number, row, path) for number, row in enumerate(found, 1))


def _rule(number: int, row: Mapping[str, Any], path: str) -> Rule:
    name = row.get("code", f"number {number}")
    unknown = [key for key in row if key not in _KEYS]
    missing = [key for key in _TEXTS if not isinstance(row.get(key), str)]
    if unknown or missing:
        what = f"unknown key {unknown[0]}" if unknown else f"{missing[0]} is missing"
        raise ProfileError(f"rule {name}: {what}; keys are {', '.join(sorted(_KEYS))}", path=path)
    if row["severity"] not in SEVERITIES:
        raise ProfileError(f"rule {name}: severity is one of {', '.join(SEVERITIES)}", path=path)
    technique = row.get("technique", ["", ""])
    condition = {} if row.get("deviation") else _condition(name, row, path)
    texts = {key: row[key] for key in _TEXTS}
    return Rule(technique=(technique[0], technique[1]), condition=condition, **texts)


def _condition(name: str, row: Mapping[str, Any], path: str) -> dict[str, Any]:
    """The condition in the words of the core, its filter compiled."""
    table = row.get("table", "transactions")
    if table not in TABLES or "where" not in row:
        raise ProfileError(f"rule {name}: it needs where, a filter of one of the tables", path=path)
    try:
        tree = filters.parse(row["where"], table).tree
        pdu = list(bytes.fromhex(row.get("pdu", "")))
    except (FilterError, ValueError) as error:
        raise ProfileError(f"rule {name}: {error}", path=path) from error
    rest = {
        key: row[key] for key in ("per", "count", "within_s", "distinct", "only_once") if key in row
    }
    return {"code": row["code"], "table": table, "tree": tree, "pdu": pdu, **rest}


class Watch:
    """What the rules, and a baseline, find in batches of rows.

    With `usual`, a result of `usage`, `news` also has the deviations from it. `ValueError` names
    what is wrong in `usual`.
    """

    def __init__(self, table: Sequence[Rule], usual: Mapping[str, Any] | None = None) -> None:
        self._rules = {rule.code: rule for rule in table}
        conditions = [rule.condition for rule in table if rule.condition]
        known = None if usual is None else json.dumps(usual, default=str)
        self._core = _modlens.Watch(json.dumps(conditions), known)

    def add(self, batch: _modlens.Batch) -> None:
        """Look at the transactions, frames and connections of a batch."""
        self._core.add(batch)

    def finish(self) -> None:
        """Decide what waits for more rows: the recordings have ended."""
        self._core.finish()

    def alerts(self) -> list[Finding]:
        """What the rules have found, the most severe first."""
        return self._findings(json.loads(self._core.alerts())["alerts"])

    def news(self) -> list[Finding]:
        """What has begun since the last call, the most severe first."""
        return self._findings(json.loads(self._core.news()))

    def not_judged(self) -> list[str]:
        """The codes of rules that need times, where the recordings have none."""
        found: list[str] = json.loads(self._core.alerts())["not_judged"]
        return found

    def usage(self) -> dict[str, Any]:
        """Who asked for what, as a baseline keeps it."""
        found: dict[str, Any] = json.loads(self._core.usage())
        return found

    def deviations(self, usual: Mapping[str, Any], *, values: bool = False) -> list[Finding]:
        """What differs from `usual`, a result of `usage`; with `values`, also in what was read.

        `ValueError` names what is wrong in `usual`.
        """
        return self._findings(json.loads(self._core.compare(json.dumps(usual), values=values)))

    def _findings(self, found: Iterable[Mapping[str, Any]]) -> list[Finding]:
        made = [_finding(self._rules[facts["code"]], facts) for facts in found]
        return sorted(made, key=lambda one: SEVERITIES.index(one.rule.severity))


def _finding(rule: Rule, facts: Mapping[str, Any]) -> Finding:
    client, bus = facts.get("client"), facts.get("bus")
    server = f" of {bus}" if client else ""
    device = f"unit {facts.get('unit')}{server}"
    places = {
        **dict.fromkeys(("function", "address", "items", "now", "usual"), "-"),
        **{key: value for key, value in facts.items() if value is not None},
        "client": client or "The master",
        "device": device,
        "Device": device[0].upper() + device[1:],
        "server": server,
        "count": _times(facts.get("count") or 0),
        "range": _range(facts),
        "span": _span(facts),
    }
    return Finding(rule, rule.evidence.format_map(places), facts)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _range(facts: Mapping[str, Any]) -> str:
    address, quantity, function = (facts.get(key) for key in ("address", "quantity", "function"))
    if address is None:
        different = facts.get("keys") or 0
        return f"{different} ranges" if different > 1 else f"function {function}"
    if quantity in (None, 1):
        return f"function {function}, address {address}"
    return f"function {function}, addresses {address} to {address + quantity - 1}"


def _span(facts: Mapping[str, Any]) -> str:
    """For how long it went on, from half a second on."""
    since, until = facts.get("since_ns"), facts.get("until_ns")
    if since is None or until is None or until - since < _NS // 2:
        return ""
    return f" within {_duration((until - since) / _NS)}"


def _duration(seconds: float) -> str:
    for size, name in ((86400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {name}"
    return f"{seconds:.1f} s"
