"""A server that lets connections in and serves a few of them at a time.

The others wait: their requests get no answer, or all at once when another client has gone.
"""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import pytest

from analyzer import decode
from tests.doctor.frames import mbap
from tests.doctor.network import Flow
from tests.doctor.tcp_model import Client, Reply, Request, Server, Site

SEEDS = (41, 42, 43)
STOP_S = 90.0


class Places(Server):
    """Serves so many connections; of the others, requests wait until one of them has gone."""

    def __init__(self, site: Site, places: int) -> None:
        super().__init__(site.plant, site.rng)
        self.places = places
        self.served: list[Flow] = []
        self.waiting: list[Request] = []

    def replies(self, request: Request) -> list[Reply]:
        """Nothing to who waits."""
        if request.flow not in self.served and len(self.served) < self.places:
            self.served.append(request.flow)
        if request.flow in self.served:
            return super().replies(request)
        self.waiting.append(request)
        return []

    def leave(self, client: Client) -> None:
        """A client closes its connection; the next one gets what it has waited for."""
        flow = client.flow
        client.disconnect()
        self.waiting = [request for request in self.waiting if request.flow is not flow]
        if flow not in self.served:
            return
        self.served.remove(flow)
        if not self.waiting:
            return
        self.served.append(self.waiting[0].flow)
        at_s = client.now_s
        for request in [one for one in self.waiting if one.flow is self.served[-1]]:
            at_s += self.delay(request)
            data = mbap(request.transaction, request.poll.unit, self.answer(request))
            request.flow.send(at_s, False, data)


def waiting_client(site: Site, server: Places, begin_s: float) -> Client:
    """A client that gives up a request after a second or two, and asks on."""
    client = site.client(1, server)
    client.now_s, client.timeout_s = begin_s, site.rng.choice([1.0, 2.0])
    client.period_s, client.pause_s = 2.0, 0.02
    return client


def play(clients: dict[Client, float], server: Places, attempts: int | None) -> None:
    """Each until its time is over; who is not served so many times opens a new connection."""
    plans = {client: client.steps() for client in clients}
    due = {client: next(plan) for client, plan in plans.items()}
    lost = 0
    while due:
        client = min(due, key=due.__getitem__)
        if due[client] >= clients[client]:
            server.leave(client)
            del due[client]
            continue
        due[client] = next(plans[client])
        if attempts and client.flow not in server.served:
            lost += 1
            if lost % attempts == 0:
                server.leave(client)
                client.now_s += 1.5
                plans[client] = client.steps()
                due[client] = next(plans[client])


def judged(site: Site, folder: Path) -> list[dict[str, Any]]:
    path = folder / "net.pcap"
    path.write_bytes(site.network.pcap())
    rows: list[dict[str, Any]] = decode(path).doctor()["diagnoses"]
    return [row for row in rows if row["severity"] != "info"]


def seconds(text: str) -> float:
    return int(text[14:16]) * 60 + float(text[17:].rstrip("Z"))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("attempts", [None, 1, 4])
def test_a_server_that_serves_one_client_after_the_other(
    seed: int, attempts: int | None, tmp_path: Path
) -> None:
    site = Site(Random(seed))
    server = Places(site, 1)
    first, leaves_s = site.client(0, server), 40.0 + seed % 7
    first.period_s = 1.0
    other = waiting_client(site, server, 6.0)
    play({first: leaves_s, other: STOP_S}, server, attempts)
    [row] = judged(site, tmp_path)
    assert row["code"] == "connection_limit"
    assert abs(seconds(row["since"]) - 6) < 0.1
    assert abs(seconds(row["until"]) - leaves_s) < 5


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("attempts", [1, 2])
def test_each_spell_in_which_a_client_is_kept_out_is_an_episode(
    seed: int, attempts: int, tmp_path: Path
) -> None:
    """The first client goes, comes back, and waits for the second one."""
    site = Site(Random(seed))
    server = Places(site, 1)
    first, again = site.client(0, server), site.client(0, server)
    other = waiting_client(site, server, 6.0)
    first.period_s, again.now_s, again.timeout_s = 1.0, 50.0, 1.0
    play({first: 40.0, other: 75.0, again: STOP_S}, server, attempts)
    [row] = judged(site, tmp_path)
    assert row["code"] == "connection_limit"
    times = [seconds(one[end]) for one in row["episodes"] for end in ("since", "until")]
    expected = [6, 40, 50, 75]
    assert len(times) == len(expected)
    assert all(abs(time - when) < 5 for time, when in zip(times, expected, strict=True))
    assert "in 2 episodes" in row["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("attempts", [None, 4])
def test_a_full_server_that_lets_in_and_says_nothing(
    seed: int, attempts: int | None, tmp_path: Path
) -> None:
    site = Site(Random(seed))
    server = Places(site, 2)
    owners = [site.client(place, server) for place in (0, 2)]
    for owner in owners:
        owner.period_s = 1.0
    other = waiting_client(site, server, 6.0)
    play(dict.fromkeys(owners, STOP_S) | {other: STOP_S - 1}, server, attempts)
    [row] = judged(site, tmp_path)
    assert row["code"] == "connection_limit"
    assert "while it served others" in row["sentence"] or "while others were" in row["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_client_that_asks_for_a_part_of_what_others_get_is_kept_out(
    seed: int, tmp_path: Path
) -> None:
    """It has one request, and opens a connection for each try."""
    site = Site(Random(seed))
    server = Places(site, 1)
    owner, other = site.client(0, server), waiting_client(site, server, 6.0)
    poll = next(poll for poll in site.plant.polls if poll.values is None and poll.quantity > 1)
    owner.period_s, other.polls = 1.0, [type(poll)(poll.unit, poll.function, poll.address, 1)]
    play({owner: STOP_S, other: STOP_S - 1}, server, 1)
    assert [row["code"] for row in judged(site, tmp_path)] == ["connection_limit"]


class Deaf(Server):
    """Does not answer one address of a function that it knows."""

    def replies(self, request: Request) -> list[Reply]:
        """Nothing to that."""
        return [] if request.poll.address == 60_000 else super().replies(request)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_client_whose_only_request_is_not_known_is_not_kept_out(
    seed: int, tmp_path: Path
) -> None:
    site = Site(Random(seed))
    server = Deaf(site.plant, site.rng)
    first, other = site.client(0, server), site.client(1, server)
    poll = next(poll for poll in site.plant.polls if poll.values is None)
    other.polls = [type(poll)(poll.unit, poll.function, 60_000, 1)]
    plans = {client: client.steps() for client in (first, other)}
    due = {client: next(plan) for client, plan in plans.items()}
    while min(due.values()) < STOP_S:
        client = min(due, key=due.__getitem__)
        due[client] = next(plans[client])
    assert "connection_limit" not in [row["code"] for row in judged(site, tmp_path)]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_gateway_that_serves_the_newest_client_only(seed: int, tmp_path: Path) -> None:
    """Each connection ends the other client's, which comes back some seconds later."""
    site = Site(Random(seed))
    clients = [site.client(0), site.client(1)]
    poll = next(poll for poll in site.plant.polls if poll.values is None)
    at_s = 0.0
    for turn in range(40):
        client, other = clients[turn % 2], clients[1 - turn % 2]
        client.now_s = at_s
        client.connect()
        if other.flow is not None:
            other.flow.close(at_s + 0.002, by_client=False)
            other.flow = None
        for _ in range(site.rng.randint(2, 5)):
            client.ask(poll)
        at_s = client.now_s + site.rng.uniform(0.4, 3.0)
    [row] = judged(site, tmp_path)
    assert row["code"] == "connection_limit"
    assert "serves one client only, the newest" in row["sentence"]
