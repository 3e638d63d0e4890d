"""Baselines and differences: planted changes are found, and days that are alike differ in nothing.

A day is made as a capture of a small plant: an HMI that polls two units with jitter, an operator
who writes a setpoint, registers that move. What is planted is the expected result.
"""

from __future__ import annotations

import itertools
import json
import random
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from analyzer.baseline_file import dumps, loads
from analyzer.cli import main
from tests.support.packets import Packet, write_capture

HMI, STRANGER, SERVER = "10.0.0.10", "10.0.0.66", "10.0.0.3"
SECONDS = 1800


@dataclass(frozen=True)
class Plant:
    """What happens on a day; the values are those of an ordinary one."""

    seconds: int = SECONDS
    period: float = 2.0
    response_s: float = 0.02
    refused: float = 0.0
    """Share of the reads of unit 2 that are refused."""
    setpoints: tuple[int, ...] = (200, 210, 220)
    frozen: bool = False
    stranger_reads: bool = False
    hmi_writes_unit_2: bool = False
    extra: tuple[int, int, int] | None = None
    """Unit, function and address that are also polled."""
    second_poll: bool = True
    constant_moves: bool = False


def exchanges(
    plant: Plant, chance: random.Random
) -> Iterator[tuple[float, str, bytes, bytes | None, float]]:
    """Time, client, request, response and response time."""
    polls: list[tuple[int, int, int, int]] = [(1, 3, 100, 4)]
    if plant.second_poll:
        polls.append((2, 4, 0, 2))
    if plant.extra is not None:
        polls.append((*plant.extra, 1))
    level = 500
    for number in range(int(plant.seconds / plant.period)):
        level = min(max(level + chance.randint(-5, 5), 100), 900)
        for place, (unit, function, address, quantity) in enumerate(polls):
            time = number * plant.period + place * 0.2 + chance.uniform(0, 0.05)
            values = [
                500 if plant.frozen else level,
                7 + (number // 9 % 2 if plant.constant_moves else 0),
                3,
                4,
            ]
            request = struct.pack(">BBHH", unit, function, address, quantity)
            data = struct.pack(f">{quantity}H", *values[:quantity])
            response = struct.pack(">BBB", unit, function, 2 * quantity) + data
            if unit == 2 and chance.random() < plant.refused:
                response = struct.pack(">BBB", unit, function | 0x80, 4)
            yield time, HMI, request, response, plant.response_s * chance.uniform(0.8, 1.25)
        if number % 60 == 30:
            write = struct.pack(">BBHH", 1, 6, 200, chance.choice(plant.setpoints))
            yield number * plant.period + 1.2, HMI, write, write, 0.02
    if plant.stranger_reads:
        yield 900.5, STRANGER, bytes.fromhex("010300640004"), None, 0
    if plant.hmi_writes_unit_2:
        write = struct.pack(">BBHH", 2, 6, 5, 1)
        yield 901.5, HMI, write, write, 0.02


def day(path: Path, plant: Plant, seed: int, *later: Plant) -> str:
    """Write the capture of a day, on which other things may happen later; gives its path."""
    packets: list[Packet] = []
    plants = (plant, *later)
    begins = itertools.accumulate((one.seconds for one in plants), initial=0)
    events = (
        (begin, *event)
        for place, (begin, one) in enumerate(zip(begins, plants, strict=False))
        for event in sorted(exchanges(one, random.Random(seed + 1000 * place)))
    )
    for number, (begin, at_s, client, request, response, delay) in enumerate(events):
        time = begin + at_s
        head = struct.pack(">HH", number & 0xFFFF, 0)
        for sender, pdu, at in ((client, request, time), (SERVER, response, time + delay)):
            if pdu is not None:
                ends = (client, SERVER) if sender == client else (SERVER, client)
                packets.append(
                    Packet(at, *ends, head + struct.pack(">H", len(pdu)) + pdu, sender == client)
                )
    write_capture(path, packets, start=1_700_000_000 + 86_400 * seed)
    return str(path)


ORDINARY = Plant()
CHANGES: dict[str, Plant] = {
    "new_client": replace(ORDINARY, stranger_reads=True),
    "new_writer": replace(ORDINARY, hmi_writes_unit_2=True),
    "new_unit": replace(ORDINARY, extra=(3, 3, 0)),
    "new_function": replace(ORDINARY, extra=(1, 4, 100)),
    "new_request": replace(ORDINARY, extra=(1, 3, 300)),
    "missing_request": replace(ORDINARY, second_poll=False),
    "period_moved": replace(ORDINARY, period=3.0),
    "value_never_written": replace(ORDINARY, setpoints=(200, 210, 990)),
    "response_time_shifted": replace(ORDINARY, response_s=0.045),
    "outcome_changed": replace(ORDINARY, refused=0.1),
    "register_stopped": replace(ORDINARY, frozen=True),
    "register_moves": replace(ORDINARY, constant_moves=True),
}

Diff = Callable[..., list[dict[str, object]]]


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Diff:
    """Runs a command with `--to jsonl`; gives its rows."""

    def rows(*arguments: str) -> list[dict[str, object]]:
        assert main([*arguments, "--to", "jsonl"]) == 0
        return [json.loads(line) for line in capsys.readouterr().out.splitlines()]

    return rows


def codes(rows: Sequence[dict[str, object]]) -> set[object]:
    return {row["code"] for row in rows}


@pytest.mark.parametrize("code", sorted(CHANGES))
def test_a_planted_change_is_found_and_nothing_else(
    code: str, tmp_path: Path, command: Diff
) -> None:
    before = day(tmp_path / "before.pcap", ORDINARY, 1)
    after = day(tmp_path / "after.pcap", CHANGES[code], 2)
    assert codes(command("diff", before, after)) == {code}


@pytest.mark.parametrize("seed", range(3))
def test_days_that_are_alike_do_not_differ(seed: int, tmp_path: Path, command: Diff) -> None:
    before = day(tmp_path / "before.pcap", ORDINARY, 10 + seed)
    after = day(tmp_path / "after.pcap", ORDINARY, 20 + seed)
    assert command("diff", before, after) == []


def test_a_baseline_knows_two_phases_and_what_was_accepted(tmp_path: Path, command: Diff) -> None:
    # By night the plant is polled every ten seconds.
    quick = day(tmp_path / "day.pcap", ORDINARY, 1)
    slow = day(tmp_path / "night.pcap", replace(ORDINARY, period=10.0), 2)
    usual = tmp_path / "usual.toml"
    assert main(["baseline", quick, slow, "-o", str(usual)]) == 0
    night = day(tmp_path / "next.pcap", replace(ORDINARY, period=10.0), 3)
    assert command("security", night, "--baseline", str(usual)) == []
    visited = day(tmp_path / "visited.pcap", replace(ORDINARY, stranger_reads=True), 4)
    [row] = command("security", visited, "--baseline", str(usual))
    assert (row["code"], row["client"], row["severity"]) == ("new_client", STRANGER, "high")
    lines = usual.read_text().splitlines()
    assert command("security", visited, "--baseline", str(usual), "--accept", "new_client") == []
    added = [line for line in usual.read_text().splitlines() if line not in lines]
    assert len(added) == 1
    assert STRANGER in added[0]
    assert command("security", visited, "--baseline", str(usual)) == []


def test_a_baseline_reads_back_what_it_wrote(tmp_path: Path) -> None:
    usual = tmp_path / "usual.toml"
    assert main(["baseline", day(tmp_path / "day.pcap", ORDINARY, 1), "-o", str(usual)]) == 0
    text = usual.read_text()
    assert dumps(loads(text, "usual.toml")) == text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x", "usual.toml"),
        ("format = 2", "not a baseline"),
        ("format = 1\n[[bus]]\nname = 'a'\nrequest = [{ unit = 300 }]", "request 1: unit"),
    ],
)
def test_a_wrong_baseline_is_refused(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    usual = tmp_path / "usual.toml"
    usual.write_text(text)
    assert (
        main(["security", day(tmp_path / "day.pcap", ORDINARY, 1), "--baseline", str(usual)]) == 2
    )
    assert message in capsys.readouterr().err
