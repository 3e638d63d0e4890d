"""`modlens tap` on a real bus: pymodbus' own client and server, a pty line with its pacing."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pymodbus")
if sys.platform != "linux":
    pytest.skip("the bus is made of Linux' ptys", allow_module_level=True)

from pymodbus import FramerType, ModbusException
from pymodbus.client import ModbusSerialClient

from analyzer import tap
from tests.conftest import ROOT, command, environment, need_program
from tests.support import master_scripts
from tests.support.devices import demo_device
from tests.support.ptybus import PtyBus, Sent
from tests.support.pymodbus_buses import BusScenario, Servers

UNIT = 17
LINE = "19200-8E1"


class Tap:
    """A running `modlens tap`; used by `with`. `out` and `err` are complete when it has ended."""

    def __init__(self, *words: str | Path) -> None:
        self._running = subprocess.Popen(
            command("tap", *words, "--line", LINE),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment(),
            cwd=ROOT,
        )
        assert self._running.stderr is not None
        self.said = self._running.stderr.readline().decode()
        self.out = self.err = ""

    def stop(self, number: int = signal.SIGINT) -> int:
        """Send a signal, wait, give the exit status."""
        self._running.send_signal(number)
        return self.wait()

    def wait(self) -> int:
        """Wait for the end, give the exit status."""
        out, err = self._running.communicate(timeout=60)
        self.out, self.err = out.decode(), self.said + err.decode()
        return self._running.returncode

    def kill(self) -> None:
        """End it as the system would, without a word."""
        self._running.kill()
        self._running.communicate(timeout=60)

    def __enter__(self) -> Tap:
        return self

    def __exit__(self, *error: object) -> None:
        if self._running.poll() is None:
            self.kill()


@contextlib.contextmanager
def polling(mode: str) -> Iterator[tuple[PtyBus, ModbusSerialClient]]:
    """A bus with a server at unit 17, a client, and a place for the tap."""
    framer = FramerType.RTU if mode == "rtu" else FramerType.ASCII
    scenario = BusScenario({"unit": demo_device(UNIT)}, master_scripts.plain_polls, framer=framer)
    with (
        PtyBus(["master", "unit", "tap"], turnaround_chars=3.5) as bus,
        Servers(scenario, bus, {"unit": []}),
    ):
        client = ModbusSerialClient(
            bus.path("master"), framer=framer, baudrate=19200, timeout=1, retries=0
        )
        with contextlib.closing(client):
            client.connect()
            yield bus, client


def follow(bus: PtyBus, client: ModbusSerialClient) -> list[tuple[Sent, Sent]]:
    """Poll, and give each request with its response as the line carried them."""
    steps = [*master_scripts.plain_polls(client, UNIT), *master_scripts.plain_polls(client, UNIT)]
    for step in steps:
        with contextlib.suppress(ModbusException):
            step()
        time.sleep(0.005)
    bus.wait_idle()
    time.sleep(0.2)  # for the tap to have it as well
    sent = _whole(bus.truth)
    return list(zip(sent[::2], sent[1::2], strict=True))


def _whole(truth: Sequence[Sent]) -> list[Sent]:
    """Writes that the system handed over in parts, joined again."""
    joined: list[Sent] = []
    for sent in truth:
        if joined and joined[-1].sender == sent.sender:
            last = joined.pop()
            data, written = last.data + sent.data, last.written + sent.written
            sent = Sent(last.time_ns, sent.end_ns, sent.sender, data, written)  # noqa: PLW2901
        joined.append(sent)
    return joined


def test_count_ends_the_tap_with_exactly_that_many(tmp_path: Path) -> None:
    """While the polling goes on: three rows, nothing damaged even for `--strict`."""
    rows = tmp_path / "txns.jsonl"
    with polling("rtu") as (bus, client):
        with Tap(bus.path("tap"), "--count", "3", "--strict", "-o", rows) as running:
            truth = follow(bus, client)
            assert running.wait() == 0
    assert len(truth) > 3
    found = [json.loads(line) for line in rows.read_text().splitlines()]
    assert [row["txn"] for row in found] == [1, 2, 3]
    assert [row["request_hex"] for row in found] == [one.data.hex() for one, _ in truth[:3]]
    assert f"{rows}: 3 transactions" in running.err


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_every_transaction_appears_once(mode: str, tmp_path: Path) -> None:
    """Paired, in order, with the response times of the line; the outputs are complete."""
    rows, frames = tmp_path / "txns.jsonl", tmp_path / "frames.csv"
    with polling(mode) as (bus, client):
        with Tap(bus.path("tap"), "-o", rows, "-o", f"frames:{frames}") as running:
            truth = follow(bus, client)
            assert running.stop() == 0
    found: list[dict[str, Any]] = [json.loads(line) for line in rows.read_text().splitlines()]
    assert [row["txn"] for row in found] == list(range(1, len(truth) + 1))
    told = []
    for row, (request, response) in zip(found, truth, strict=True):
        assert (row["status"], row["mode"], row["unit"]) == ("ok", mode, UNIT)
        assert row["request_hex"] == request.data.hex()
        assert row["response_hex"] == response.data.hex()
        # On a busy machine one read may hold the end of a request and the response's start.
        if "response_time_us" in row:
            real_us = (response.time_ns - request.end_ns) / 1e3
            told.append(row["response_time_us"] == pytest.approx(real_us, abs=15_000))
    assert len(told) > len(found) / 2
    # The system may stop a tap for longer, but not again and again.
    assert sum(told) >= 0.9 * len(told)
    with frames.open(newline="") as file:
        listed = list(csv.DictReader(file))
    assert [row["hex"] for row in listed] == [sent.data.hex() for pair in truth for sent in pair]
    assert running.said.startswith("listening to /dev/pts/")
    assert "nothing is sent" in running.said
    assert f"{len(truth)} transactions: ok {len(truth)}" in running.err
    assert "Traceback" not in running.err


def test_the_doctor_listens(tmp_path: Path) -> None:
    """A unit that is not there: the verdict at the end; with --doctor the cause and the cure.

    The report of the tap says the same.
    """
    said = []
    with polling("rtu") as (bus, client):
        client.comm_params.timeout_connect = 0.1
        page = tmp_path / "report.html"
        for words in ((), ("--doctor", "--report", page)):
            with Tap(bus.path("tap"), *words) as running:
                for number in range(24):
                    with contextlib.suppress(ModbusException):
                        client.read_holding_registers(0, count=2, device_id=UNIT + number % 2)
                bus.wait_idle()
                time.sleep(0.3)
                assert running.stop() == 0
                said.append(running)
    plain, doctor = said
    assert f"Unit {UNIT + 1} never answers" in " ".join(plain.err.split())
    assert "dead_unit_cost (" not in plain.out
    out = " ".join(doctor.out.split())
    assert out.startswith("This line")
    assert "1. dead_unit_cost (error)" in out
    assert "Check:" in out
    assert "margin per unit" in out
    told = page.read_text("utf-8")
    assert f"Unit {UNIT + 1} never answers" in told
    assert "dead_unit_cost" in told


def test_the_screen_shows_what_happens_as_it_happens(tmp_path: Path) -> None:
    """A line for each transaction, soon after it; then the summary."""
    with polling("rtu") as (bus, client), Tap(bus.path("tap"), "--times", "elapsed") as running:
        truth = follow(bus, client)
        assert running.stop(signal.SIGTERM) == 0
    head, *lines = running.out.splitlines()
    assert head.split()[:4] == ["no.", "elapsed", "s", "unit"]
    assert len(lines) == len(truth)
    assert all(len(line) <= 80 for line in [head, *lines])


def test_the_tap_never_sends() -> None:
    """The line knows who sent what: not the tap, whatever came in, nor when it came or went."""
    with polling("rtu") as (bus, client):
        with Tap(bus.path("tap")) as running:
            follow(bus, client)
            bus.inject(bytes(range(256)))
            bus.wait_idle()
            assert running.stop(signal.SIGHUP) == 0
        time.sleep(0.1)
        assert {sent.sender for sent in bus.truth} == {"master", "unit", "noise"}


def test_the_system_sees_no_write_to_the_port(tmp_path: Path) -> None:
    """Not in any thread: what the kernel was asked to do with the port, by strace."""
    strace, log = need_program("strace"), tmp_path / "calls"
    with polling("rtu") as (bus, client):
        name = bus.path("tap")
        calls = "trace=desc,network"
        traced = [strace, "-D", "-f", "-y", "-e", calls, "-o", str(log), *command("tap", name)]
        with subprocess.Popen(
            [*traced, "--line", LINE], stderr=subprocess.PIPE, env=environment(), cwd=ROOT
        ) as running:
            assert running.stderr is not None
            running.stderr.readline()
            follow(bus, client)
            running.send_signal(signal.SIGINT)
            running.stderr.read()
    asked = [line for line in log.read_text().splitlines() if f"<{name}>" in line]
    done = {match[1] for line in asked if (match := re.match(r"\d+ +(\w+)\(", line))}
    assert "read" in done
    assert not done & {"write", "writev", "pwrite64", "pwritev", "sendto", "sendmsg", "splice"}
    controls = {match[1] for line in asked if (match := re.search(r"\b(T[A-Z]+)\b", line))}
    assert not controls & {"TCSBRK", "TCSBRKP", "TIOCSBRK", "TIOCSTI", "TCXONC"}


def test_what_was_written_can_be_read_after_a_kill(tmp_path: Path) -> None:
    """After SIGKILL the file has complete rows only."""
    rows = tmp_path / "txns.csv"
    with polling("rtu") as (bus, client), Tap(bus.path("tap"), "-o", rows) as running:
        truth = follow(bus, client)
        running.kill()
    with rows.open(newline="") as file:
        found = list(csv.DictReader(file))
    assert len(found) == len(truth)
    assert all(row["status"] == "ok" for row in found)


def test_a_lost_port_is_reported_after_the_summary(tmp_path: Path) -> None:
    """A lost port gives exit status 4, and the outputs are complete."""
    rows = tmp_path / "txns.csv"
    with polling("rtu") as (bus, client):
        running = Tap(bus.path("tap"), "-o", rows, "--no-reconnect")
        truth = follow(bus, client)
    assert running.wait() == 4
    lines = running.err.splitlines()
    assert lines[-1].startswith("modlens: /dev/pts/")
    assert "the port was lost" in lines[-1]
    assert any(f"{len(truth)} transactions" in line for line in lines)
    assert rows.read_text().count("\n") == len(truth) + 1


def test_the_api_gives_transactions_live() -> None:
    """`with tap(port) as bus: for transaction in bus`."""
    with polling("rtu") as (bus, client), tap(bus.path("tap"), line=LINE) as listening:
        transactions = iter(listening)
        for step in master_scripts.plain_polls(client, UNIT):
            step()
            row = next(transactions)
            assert row.status == "ok"
            assert row.time is not None
        assert sum(listening.stats()["transactions"].values()) > 0


def test_two_ports_are_two_buses(tmp_path: Path) -> None:
    """Each with its name; a port with a plus is one bus of two lines."""
    rows = tmp_path / "txns.jsonl"
    pairs = [os.openpty() for _ in range(2)]
    names = [os.ttyname(near) for _, near in pairs]
    request, response = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
    with Tap(*names, "-o", rows) as running:
        for far, _ in pairs:
            os.write(far, request)
            time.sleep(0.02)
            os.write(far, response)
            time.sleep(0.02)
        time.sleep(0.3)
        assert running.stop() == 0
    found = [json.loads(line) for line in rows.read_text().splitlines()]
    assert [(row["bus"], row["status"]) for row in found] == [(name, "ok") for name in names]
    rows.unlink()
    with Tap("+".join(names), "-o", rows) as running:
        os.write(pairs[0][0], request)
        time.sleep(0.02)
        os.write(pairs[1][0], response)
        time.sleep(0.3)
        assert running.stop() == 0
    (row,) = [json.loads(line) for line in rows.read_text().splitlines()]
    assert (row["bus"], row["status"]) == ("+".join(names), "ok")
    for far, near in pairs:
        os.close(far)
        os.close(near)
