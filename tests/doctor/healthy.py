"""Healthy lines: all kinds of traffic, accidents of a frame in a thousand at most, no trouble.

`healthy_line(7)` is a case that expects no diagnosis of severity error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from random import Random

from tests.doctor.case import Case
from tests.doctor.frames import mbap
from tests.doctor.kinds.damage import Noise
from tests.doctor.line_model import Habits, Trouble, random_line
from tests.doctor.network import Flow
from tests.doctor.plant import Plant, Poll, polls_for, random_plant
from tests.doctor.scene import Scene
from tests.doctor.tcp_model import CLIENTS, SERVER, Request, Server, Site, together

__all__ = ["LINES", "healthy_line"]

LINES = 50
WORST_ACCIDENT = 0.001


def healthy_line(seed: int) -> Case:
    """The healthy line of that number, 1 to `LINES`."""
    rng = Random(f"healthy:{seed}")
    return STYLES[seed % len(STYLES)](rng)


def _accidents(rng: Random) -> Trouble:
    """None on every third line."""
    return rng.choice([Trouble(), *2 * [Noise(rng, rng.uniform(0.0001, WORST_ACCIDENT))]])


def _count(rng: Random) -> int:
    share: float = rng.random()
    return round(math.exp(math.log(60) + share * math.log(33)))


def plain(rng: Random) -> Case:
    """Some plant, some habits."""
    scene = Scene(rng)
    scene.run(_count(rng), _accidents(rng))
    return scene.case(None)


def slow_and_fast(rng: Random) -> Case:
    """One unit takes a third of the timeout, another a millisecond; the master has time."""
    scene = Scene(rng, random_plant(rng, units=3))
    scene.habits.timeout_s = rng.choice([1.0, 2.0, 3.0])
    slow, fast, _ = scene.plant.units
    slow.delay_s, slow.spread = scene.habits.timeout_s / 4, 0.15
    fast.delay_s, fast.spread = 0.001, 0.05
    scene.run(_count(rng), _accidents(rng))
    return scene.case(None)


def bursts(rng: Random) -> Case:
    """A cycle as fast as it goes, then a long pause."""
    scene = Scene(rng)
    scene.habits.pauses_s = (0.006,)
    scene.habits.period_s = rng.choice([10.0, 60.0, 300.0])
    scene.run(_count(rng), _accidents(rng))
    return scene.case(None)


def rare_exceptions(rng: Random) -> Case:
    """A tool looks for an optional block every hundred cycles, but there is none."""
    plant = random_plant(rng, units=rng.randint(2, 4))
    unit = plant.units[0]
    function = next(iter(unit.tables))
    plant.polls.append(Poll(unit.address, function, 64_000, 2, every=100))
    scene = Scene(rng, plant)
    scene.run(max(800, _count(rng)), _accidents(rng))
    return scene.case(None)


def changing_tools(rng: Random) -> Case:
    """One program works, then another one with its own pauses, blocks and order."""
    scene = Scene(rng)
    scene.run(_count(rng), _accidents(rng))
    first = scene.masters[0]
    polls = [poll for unit in scene.plant.units for poll in polls_for(rng, unit)]
    rng.shuffle(polls)
    scene.habits = Habits.by_chance(rng)
    second = scene.master(_accidents(rng), Plant(scene.plant.units, polls))
    second.now_s = second.quiet_since_s = first.now_s + rng.uniform(1, 20)
    second.run(_count(rng))
    return scene.case(None)


def one_unit(rng: Random) -> Case:
    """One device, one block, once a second: the most common line of all."""
    scene = Scene(rng, random_plant(rng, units=1))
    scene.plant.polls = scene.plant.polls[:1]
    scene.habits.period_s = 1.0
    scene.run(_count(rng), _accidents(rng))
    return scene.case(None)


def fast_line(rng: Random) -> Case:
    """115200 baud, answers after 2 ms, a pause of 3 ms."""
    plant = random_plant(rng)
    for unit in plant.units:
        unit.delay_s, unit.spread = 0.002, 0.1
    scene = Scene(rng, plant, random_line(rng, slowest=115_200))
    scene.habits.pauses_s = (0.003,)
    scene.habits.period_s = 1.0
    scene.run(_count(rng), _accidents(rng))
    return scene.case(None)


def one_client(rng: Random) -> Case:
    """A client that stays connected."""
    site = Site(rng)
    site.client(0).run(_count(rng))
    return site.case(None)


def several_clients(rng: Random) -> Case:
    """Two to four clients of one server, each with an orderly end."""
    site = Site(rng)
    clients = [site.client(place) for place in range(rng.randint(2, 4))]
    together(clients, _count(rng) + 60)
    for client in clients:
        client.disconnect()
    return site.case(None)


def pipelined(rng: Random) -> Case:
    """A client that keeps two to four requests in flight, by wish."""
    site = Site(rng, units=1)
    flow = site.network.flow(CLIENTS[0], SERVER)
    now_s = flow.open(0.0) + 0.001
    depth = rng.randint(2, 4)
    due: list[bytes] = []
    server = Server(site.plant, rng)
    for number in range(_count(rng)):
        due.append(_pipelined_request(site, server, flow, number, now_s))
        if len(due) == depth:
            now_s += rng.uniform(0.005, 0.03)
            flow.send(now_s, False, due.pop(0))
        now_s += 0.002
    for data in due:
        now_s += 0.005
        flow.send(now_s, False, data)
    return site.case(None)


def two_at_once(rng: Random) -> Case:
    """A client that sends two requests together, now and then one, and waits for all answers."""
    site = Site(rng, units=1)
    flow = site.network.flow(CLIENTS[0], SERVER)
    now_s, number = flow.open(0.0) + 0.001, 0
    server = Server(site.plant, rng)
    requests = _count(rng)
    while number < requests:
        count = 1 if rng.random() < 0.2 else 2
        due = [_pipelined_request(site, server, flow, number + k, now_s) for k in range(count)]
        for data in due:
            now_s += rng.uniform(0.01, 0.05)
            flow.send(now_s, False, data)
        now_s += 0.1
        number += count
    return site.case(None)


def _pipelined_request(site: Site, server: Server, flow: Flow, number: int, now_s: float) -> bytes:
    """Send one; what will be the answer."""
    poll = site.plant.polls[number % len(site.plant.polls)]
    request = Request(number, poll, poll.pdu(now_s), number & 0xFFFF, now_s, flow, number)
    flow.send(now_s, True, mbap(request.transaction, poll.unit, request.pdu))
    return server.replies(request)[0].data


def without_settings(rng: Random) -> Case:
    """A plain line whose settings nobody told."""
    return replace(plain(rng), words=())


STYLES: tuple[Callable[[Random], Case], ...] = (
    plain,
    slow_and_fast,
    bursts,
    rare_exceptions,
    changing_tools,
    one_unit,
    fast_line,
    one_client,
    several_clients,
    pipelined,
    two_at_once,
    without_settings,
)
