"""Clients of a network that do nothing wrong, and the notes that the doctor makes all the same."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import pytest

from analyzer import decode
from tests.doctor.frames import mbap
from tests.doctor.plant import Poll
from tests.doctor.tcp_model import CLIENTS, Client, Reply, Request, Server, Site, together

SEEDS = (11, 12, 13)
WRITES = 15


def judged(site: Site, folder: Path) -> tuple[str, list[dict[str, Any]]]:
    path = folder / "net.pcap"
    path.write_bytes(site.network.pcap())
    document = decode(path).doctor()
    return document["sentence"], document["diagnoses"]


def reader(site: Site) -> Client:
    client = site.client(0)
    client.polls = [
        poll for poll in client.polls if poll.values is None and poll.function in (3, 4)
    ]
    return client


def writer(site: Site, begin_s: float) -> Client:
    """A client that writes another value each time."""
    unit = site.plant.units[0]
    unit.tables.setdefault(3, {})[7000] = lambda _: 0
    client = site.client(1)
    client.polls = [Poll(unit.address, 6, 7000, 1, lambda time_s: [int(time_s * 7) & 0xFFFF])]
    client.now_s, client.period_s = begin_s, 2.0
    return client


@pytest.mark.parametrize("seed", SEEDS)
def test_a_client_that_comes_later_and_writes_is_named(seed: int, tmp_path: Path) -> None:
    site = Site(Random(seed), units=1)
    reader(site).run_until(100)
    writer(site, 60).run(WRITES)
    sentence, [row] = judged(site, tmp_path)
    assert (row["code"], row["severity"], row["client"]) == (
        "unexpected_writer",
        "info",
        CLIENTS[1],
    )
    assert f"has written {WRITES} times, where all others only read" in row["sentence"]
    assert "healthy" in sentence


@pytest.mark.parametrize("seed", SEEDS)
def test_a_client_that_has_always_written_is_not_named(seed: int, tmp_path: Path) -> None:
    site = Site(Random(seed), units=1)
    reader(site).run_until(100)
    writer(site, 1).run(40)
    _, rows = judged(site, tmp_path)
    assert rows == []


@pytest.mark.parametrize("seed", SEEDS)
def test_a_writer_on_the_computer_of_the_reader_is_named(seed: int, tmp_path: Path) -> None:
    """Its connection is open beside that of the reader: it is another program."""
    site = Site(Random(seed), units=1)
    reader(site).run_until(100)
    second = writer(site, 60)
    second.address = CLIENTS[0]
    second.run(WRITES)
    sentence, [row] = judged(site, tmp_path)
    assert (row["code"], row["severity"], row["client"]) == (
        "unexpected_writer",
        "info",
        CLIENTS[0],
    )
    assert f"has written {WRITES} times on a connection of its own" in row["sentence"]
    assert "healthy" in sentence


@pytest.mark.parametrize("seed", SEEDS)
def test_a_program_that_connects_anew_to_write_is_one_client(seed: int, tmp_path: Path) -> None:
    """It reads on a connection for each request, and from some time on it writes, too."""
    site = Site(Random(seed), units=1)
    client = reader(site)
    client.per_request = True
    client.run_until(60)
    write = writer(site, 0).polls[0]
    client.polls = [*client.polls, write]
    client.run_until(100)
    _, rows = judged(site, tmp_path)
    assert "unexpected_writer" not in [row["code"] for row in rows]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_connection_for_each_cycle_is_only_worth_knowing(seed: int, tmp_path: Path) -> None:
    site = Site(Random(seed), units=1)
    client = reader(site)
    client.polls, client.per_request = client.polls[:1], True
    client.run(60)
    sentence, rows = judged(site, tmp_path)
    assert [(row["code"], row["severity"]) for row in rows] == [("connection_churn", "info")]
    assert "healthy" in sentence


@pytest.mark.parametrize("seed", SEEDS)
def test_connections_that_end_unused_are_not_turned_away(seed: int, tmp_path: Path) -> None:
    """A server closes what is idle for 4 s, and a client connects long before it has a question."""
    site = Site(Random(seed), units=1)
    reader(site).run_until(100)
    idle = site.client(1)
    for _ in range(15):
        idle.connect().close(idle.now_s + 4.0, by_client=False)
        idle.flow, idle.now_s = None, idle.now_s + 5.5
    _, rows = judged(site, tmp_path)
    codes = [row["code"] for row in rows]
    assert "connection_limit" not in codes
    assert codes[:1] == ["connection_churn"]


class Slow(Server):
    """Answers each fourth request after the client has asked again, and then that one as well."""

    def replies(self, request: Request) -> list[Reply]:
        """The right answer, late."""
        [reply] = super().replies(request)
        delay_s = {3: 1.3, 0: 0.6}.get(request.number % 4, reply.delay_s)
        return [Reply(reply.data, delay_s)]


@pytest.mark.parametrize("seed", SEEDS)
def test_short_connections_do_not_explain_slow_answers(seed: int, tmp_path: Path) -> None:
    site = Site(Random(seed), units=1)
    client = site.client(0, Slow(site.plant, site.rng))
    [poll, *_] = reader(site).polls
    for number in range(120):
        client.ask(poll)
        if number % 4 != 3:
            client.disconnect()
    client.disconnect()
    _, rows = judged(site, tmp_path)
    assert [row["code"] for row in rows][:1] == ["slow_answers"]


class Fatal(Server):
    """Closes the connection at a write of registers, without an answer."""

    def replies(self, request: Request) -> list[Reply]:
        """Nothing to function 16."""
        return [] if request.poll.function == 16 else super().replies(request)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_function_that_ends_connections_is_named(seed: int, tmp_path: Path) -> None:
    site = Site(Random(seed), units=1)
    client = site.client(0, Fatal(site.plant, site.rng))
    [poll, *_] = reader(site).polls
    write = Poll(poll.unit, 16, 40, 2, lambda _: [1, 2])
    for _ in range(25):
        for _ in range(8):
            client.ask(poll)
        client.ask(write)
        client.connect().close(client.now_s, by_client=False)
        client.flow, client.now_s = None, client.now_s + 0.1
    _, [row, *_] = judged(site, tmp_path)
    assert (row["code"], row["function"]) == ("connection_churn", 16)
    assert "at a request with function 16" in row["sentence"]


class OneNumber(Server):
    """A gateway whose answers all bear the number of its first unit, whatever was asked."""

    def replies(self, request: Request) -> list[Reply]:
        """The right answer, with that number."""
        first = self.plant.units[0].address
        data = mbap(request.transaction, first, self.answer(request))
        return [Reply(data, self.delay(request))]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_gateway_that_answers_with_one_number_is_not_one_step_late(
    seed: int, tmp_path: Path
) -> None:
    site = Site(Random(seed), units=3)
    client = site.client(0, OneNumber(site.plant, site.rng))
    tables = [unit.tables.setdefault(3, {}) for unit in site.plant.units]
    for table in tables:
        table.update({address: lambda _: 7 for address in range(10)})
    client.polls = [Poll(unit.address, 3, 0, 10) for unit in site.plant.units]
    client.run(200)
    _, rows = judged(site, tmp_path)
    assert "lockstep" not in [row["code"] for row in rows]
    assert rows


class Shared(Server):
    """A gateway: the requests of all connections wait for its line, and some take long."""

    free_s = 0.0

    def delay(self, request: Request) -> float:
        """Until the line is free, and then that of the unit."""
        takes_s = self.rng.uniform(0.15, 0.3) if request.number % 7 == 0 else 0.05
        self.free_s = max(self.free_s, request.start_s) + takes_s
        return self.free_s - request.start_s


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("programs", [2, 3])
def test_programs_on_one_computer_do_not_overtake_each_other(
    seed: int, programs: int, tmp_path: Path
) -> None:
    """Each waits for its answer, on a connection of its own."""
    site = Site(Random(seed))
    gateway = Shared(site.plant, site.rng)
    clients = [site.client(0, gateway) for _ in range(programs)]
    for client in clients:
        client.period_s, client.timeout_s = 0.3, 2.5
        client.polls = [poll for poll in client.polls if poll.values is None]
    together(clients, 300)
    _, rows = judged(site, tmp_path)
    assert [row["code"] for row in rows if row["severity"] != "info"] == []
