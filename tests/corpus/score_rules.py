"""What the rules of other detectors find in their own captures, beside what modlens finds there.

    python -m tests.corpus.score_rules suricata modbus.pcap
    python -m tests.corpus.score_rules quickdraw FOLDER
    python -m tests.corpus.score_rules icsforge FOLDER

The captures are those of suricata-verify (`tests/modbus`), of digitalbond/Quickdraw-Snort on GitHub
and of ICSForge (a folder for each scenario). The first two print what is expected and what was
found, and end with status 1 where they differ. The expected counts are those of suricata-verify's
own test, and packets that meet the byte conditions of Quickdraw's rules, counted with tshark. The
last prints the findings of each scenario, alone and with a baseline of its scenario of polling.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from analyzer.api import decode
from analyzer.security import Watch
from tests.corpus.score_attacks import learned, watch

__all__ = ["SURICATA"]

_REQUEST = "status != 'unsolicited'"
"""Suricata's rules are about requests; the capture has responses without one as well."""

_ASSIGNED = "function in (1, 2, 3, 4, 5, 6, 7, 8, 11, 12, 15, 16, 17, 20, 21, 22, 23, 24, 43)"

SURICATA = tuple(
    (name, f"{_REQUEST} and {where}", count)
    for name, where, count in (
        ("1: function 1", "function == 1", 2),
        ("2: function assigned", _ASSIGNED, 18),
        ("3: access read", "read", 3),
        ("4: unit 10", "unit == 10", 18),
        ("4: unit 10, of function 43", "unit == 10 and function == 43", 2),
        # Between its addresses 0 and 2, which count from 1: address 0 on the wire.
        ("5: unit > 9, read coils, address 0<>2", "unit > 9 and function == 1 and address < 1", 1),
        ("6: access write", "write", 3),
        ("7: function 8", "function == 8", 8),
    )
)
"""Rules of suricata-verify's test: what they match, as a filter, and how often."""

STRANGER = "10.0.0.9"
"""The client that Quickdraw's rules 1111006 and 1111007 do not know."""

PART_1, PART_2, MODICON = (
    f"{name}.pcap" for name in ("modbus_test_data_part1", "modbus_test_data_part2", "modicon_test")
)

QUICKDRAW = (
    ("1111001 Force Listen Only Mode", PART_1, "listen_only", 3),
    ("1111002 Restart Communications Option", PART_1, "device_restart", 3),
    ("1111003 Clear Counters", PART_1, "counters_cleared", 2),
    ("1111004, 5 Read Device Identification, Report Server", PART_1, "identification_read", 4),
    ("1111006, 7 Unauthorized Read, Write: 3 and 3", PART_1, "new_client", 6),
    ("1111008, 9 Illegal Size 2, Non-Modbus 2: one connection", PART_1, "not_modbus", 1),
    ("1111010 Slave Device Busy", PART_1, "device_busy_burst", 5),
    ("1111011 Acknowledge", PART_1, "acknowledge_burst", 5),
    ("1111012 Incorrect Packet Length", PART_1, "excess_bytes", 2),
    ("1111013 Points List Scan", PART_2, "address_sweep", None),
    ("1111014 Function Code Scan", PART_2, "function_sweep", None),
    ("1111015 to 17 Download, Upload of Ladder Logic", MODICON, "programming_function", None),
)
"""Quickdraw's rules, the capture with their traffic, our finding, how often (None: some)."""


def suricata(capture: Path) -> Iterator[tuple[str, int | None, int]]:
    """The expected and the found count of each rule."""
    rows = decode(str(capture)).transactions
    for name, where, count in SURICATA:
        yield name, count, len(rows.where(where))


def quickdraw(folder: Path) -> Iterator[tuple[str, int | None, int]]:
    """The expected and the found count of each rule."""
    names = (PART_1, PART_2, MODICON)
    found = {name: codes(watch([folder / name])) for name in names}
    seen = watch([folder / PART_1])
    for one in seen.deviations(learned([folder / PART_1], {STRANGER})):
        if one.facts.get("client") == STRANGER:
            found[PART_1][one.rule.code] += one.facts["count"]
    for name, capture, code, count in QUICKDRAW:
        yield f"{name} ({code})", count, found[capture][code]


def codes(seen: Watch) -> Counter[str]:
    """How often each finding was seen, in all."""
    counts: Counter[str] = Counter()
    for one in seen.alerts():
        counts[one.rule.code] += one.facts["count"]
    return counts


def icsforge(folder: Path) -> Iterator[str]:
    """The findings of each scenario, alone and with a baseline of the one of polling."""
    captures = {path.name: sorted(path.rglob("*.pcap")) for path in sorted(folder.iterdir())}
    usual = learned(captures["T0801__monitor_process__modbus_poll"], set())
    for name, paths in captures.items():
        alone = watch(paths)
        known = " ".join(sorted(codes(alone)))
        more = " ".join(sorted({one.rule.code for one in alone.deviations(usual)}))
        yield f"{name:45} {known or '-':40} {more or '-'}"


def main() -> int:
    """Print the table; gives the exit status."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("what", choices=("suricata", "quickdraw", "icsforge"))
    parser.add_argument("path", type=Path)
    options = parser.parse_args()
    if options.what == "icsforge":
        sys.stdout.writelines(f"{line}\n" for line in icsforge(options.path))
        return 0
    status = 0
    for name, expected, found in {"suricata": suricata, "quickdraw": quickdraw}[options.what](
        options.path
    ):
        is_right = found == expected if expected is not None else found > 0
        status |= not is_right
        wanted = "some" if expected is None else expected
        said = "right" if is_right else "WRONG"
        sys.stdout.write(f"{name:75} expected {wanted:>4}  found {found:4}  {said}\n")
    return status


if __name__ == "__main__":
    sys.exit(main())
