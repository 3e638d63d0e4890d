"""Which labelled attacks are separated from polling: precision and recall, by transaction.

    python -m tests.corpus.score_attacks FOLDER

FOLDER has captures and their labels as in github.com/antoine-lemay/Modbus_dataset: NAME.pcap, and
NAME_labeled.csv with a row `number;label` for each packet, 1 for the attack. A transaction belongs
to the attack if its request does. The baseline of each capture is learned from the other ones,
runs of the same plant, without the clients that did nothing but attack. A transaction is reported
if a finding of severity high or medium is about it.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analyzer.api import decode
from analyzer.security import Watch, rules
from analyzer.session import FileRun
from analyzer.settings import Settings

__all__ = ["Result", "score"]

TABLES = ("transactions", "frames", "connections")


@dataclass
class Result:
    """What was reported about one capture."""

    name: str
    transactions: int
    attack: int
    reported: int
    right: int
    codes: list[str]

    def __str__(self) -> str:
        """One line of the table."""
        precision = f"{100 * self.right / self.reported:.1f} %" if self.reported else "-"
        recall = f"{100 * self.right / self.attack:.1f} %" if self.attack else "-"
        counts = f"{self.transactions:6} {self.attack:6} {self.reported:8} {self.right:6}"
        return f"{self.name:50} {counts} {precision:>9} {recall:>9}  {' '.join(self.codes)}"


def labels(path: Path) -> set[int]:
    """The packets that belong to the attack."""
    rows = (line.split(";") for line in path.read_text().split())
    return {int(number) for number, label in rows if label == "1"}


def attacks(capture: Path, bad: set[int]) -> tuple[dict[int, bool], set[str]]:
    """Of each transaction, whether its request is a packet of the attack; and the attackers."""
    found, clients = {}, defaultdict(set)
    for row in decode(str(capture)).transactions:
        packet = str(row.source).rpartition("#")[2].split()[0]
        found[row.txn] = int(packet) in bad
        clients[str(row.client)].add(found[row.txn])
    return found, {client for client, is_bad in clients.items() if is_bad == {True}}


def learned(captures: Iterable[Path], attackers: set[str]) -> dict[str, Any]:
    """What is usual in captures, without what these clients did."""
    usage = watch(captures).usage()
    for bus in usage["bus"]:
        bus["request"] = [row for row in bus["request"] if row.get("client") not in attackers]
    return usage


def watch(captures: Iterable[Path]) -> Watch:
    """What was seen in captures."""
    found = Watch(rules())
    for batch in FileRun([str(path) for path in captures], Settings(tables=TABLES)).batches():
        found.add(batch)
    found.finish()
    return found


def reported(capture: Path, findings: Iterable[Mapping[str, Any]]) -> set[int]:
    """The transactions that findings are about."""
    facts = list(findings)
    requests = {tuple(key) for one in facts for key in one.get("requests", ())}
    alerts = [one for one in facts if "requests" not in one]
    found = set()
    for row in decode(str(capture)).transactions:
        if requests & set(keys(row)) or any(is_about(one, row) for one in alerts):
            found.add(row.txn)
    return found


def keys(row: Any) -> list[tuple[object, ...]]:
    """The request as a baseline names it: once for what it reads, once for what it writes."""
    found: list[tuple[object, ...]] = []
    if row.write_address is not None:
        ends = (row.write_address, row.write_quantity)
        found.append((row.client, row.unit, row.function, True, *ends))
    if row.address is not None or not found:
        found.append((row.client, row.unit, row.function, None, row.address, row.quantity))
    return found


def is_about(alert: Mapping[str, Any], row: Any) -> bool:
    """Whether a transaction is one of those that an alert counts."""
    same = all(
        alert.get(key) is None or alert[key] == getattr(row, key)
        for key in ("client", "unit", "function")
    )
    since, until = alert.get("since_ns"), alert.get("until_ns")
    if not same or since is None or row.time is None:
        return False
    # The time of a row has microseconds.
    time = round(row.time.timestamp() * 1e6)
    return bool(since // 1000 - 1 <= time <= (until or since) // 1000 + 1)


def score(folder: Path) -> list[Result]:
    """Score every labelled capture of a folder."""
    names = sorted(path.name.removesuffix("_labeled.csv") for path in folder.glob("*_labeled.csv"))
    captures = {name: folder / f"{name}.pcap" for name in names}
    captures = {name: path for name, path in captures.items() if path.exists()}
    truth = {
        name: attacks(path, labels(folder / f"{name}_labeled.csv"))
        for name, path in captures.items()
    }
    attackers = {client for _, clients in truth.values() for client in clients}
    results = []
    for name, path in captures.items():
        usual = learned((captures[other] for other in captures if other != name), attackers)
        seen = watch([path])
        found = [*seen.alerts(), *seen.deviations(usual)]
        serious = [one for one in found if one.rule.severity in ("high", "medium")]
        told = reported(path, (one.facts for one in serious))
        bad = {number for number, is_bad in truth[name][0].items() if is_bad}
        codes = sorted({one.rule.code for one in serious})
        results.append(
            Result(name, len(truth[name][0]), len(bad), len(told), len(told & bad), codes)
        )
    return results


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("folder", type=Path)
    results = score(parser.parse_args().folder)
    head = f"{'txns':>12} attack reported  right precision    recall"
    print(f"{'capture':44} {head}")  # noqa: T201
    print(*results, sep="\n")  # noqa: T201


if __name__ == "__main__":
    main()
