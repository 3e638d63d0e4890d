"""Kinds of gateways: unit numbers, answers given to the wrong client, a line in lockstep."""

from __future__ import annotations

from random import Random

from tests.doctor.case import Case, kind
from tests.doctor.frames import exception, mbap
from tests.doctor.line_model import Answer, Exchange, Trouble
from tests.doctor.plant import Plant, Poll, Unit
from tests.doctor.scene import Scene
from tests.doctor.tcp_model import Reply, Request, Server, Site, together
from tests.doctor.values import smooth


class OneUnitOnly(Server):
    """Answers its own unit; the other number gets nothing, or a gateway's exception."""

    def __init__(self, site: Site, wrong: int, code: int | None) -> None:
        super().__init__(site.plant, site.rng)
        self.wrong, self.code = wrong, code

    def replies(self, request: Request) -> list[Reply]:
        """As the unit number says."""
        if request.poll.unit != self.wrong:
            return super().replies(request)
        if self.code is None:
            return []
        pdu = exception(request.pdu[0], self.code)
        return [Reply(mbap(request.transaction, self.wrong, pdu), 0.003)]


def gateway_on_tcp(rng: Random, seed: int) -> Case:
    """Unit 0 or 255 is asked where 1 answers, or the other way round."""
    site = Site(rng, units=1)
    wrong = rng.choice([0, 255])
    unit = site.plant.units[0].address
    code = None if seed % 2 else rng.choice([10, 11])
    client = site.client(0, OneUnitOnly(site, wrong, code))
    reads = [poll for poll in site.plant.polls if poll.values is None]
    asked = [Poll(wrong, poll.function, poll.address, poll.quantity) for poll in reads]
    client.polls = [*asked, *(poll for poll in reads if poll.unit == unit)]
    client.run(rng.randint(60, 400))
    forbidden = frozenset({"dead_unit_cost", "device_busy", "slow_answers", "lockstep"})
    return site.case("gateway_unit_id", unit=wrong, forbidden=forbidden)


class MixesUp(Server):
    """Gives a client, now and then, the answer that belongs to another one."""

    def __init__(self, site: Site, rate: float) -> None:
        super().__init__(site.plant, site.rng)
        self.rate = rate
        self.last: dict[str, tuple[int, bytes]] = {}

    def replies(self, request: Request) -> list[Reply]:
        """Its own or the other client's."""
        own = (request.poll.unit, self.answer(request))
        client = request.flow.client
        others = [last for who, last in self.last.items() if who != client]
        self.last[client] = own
        mixed = bool(others) and self.rng.random() < self.rate
        unit, pdu = others[0] if mixed else own
        return [Reply(mbap(request.transaction, unit, pdu), self.delay(request))]


class Counts(Server):
    """Invents transaction ids: always the client's plus something."""

    def __init__(self, site: Site, offset: int) -> None:
        super().__init__(site.plant, site.rng)
        self.offset = offset

    def replies(self, request: Request) -> list[Reply]:
        """With the wrong id."""
        data = mbap(request.transaction + self.offset, request.poll.unit, self.answer(request))
        return [Reply(data, self.delay(request))]


@kind("gateway_mixup")
def gateway_mixup(rng: Random, seed: int) -> Case:
    """Two clients get each other's answers; every third seed, ids with a constant offset."""
    forbidden = frozenset(
        {"lockstep", "bystander", "slow_answers", "connection_churn", "value_spike"}
    )
    if seed % 3 == 0:
        site = Site(rng)
        client = site.client(0, Counts(site, 1))
        client.run(rng.randint(60, 300))
        return site.case("gateway_mixup", forbidden=forbidden)
    site = Site(rng, units=2)
    server = MixesUp(site, rng.uniform(0.08, 0.5))
    clients = []
    for place, unit in enumerate(site.plant.units):
        client = site.client(place, server)
        client.polls = [poll for poll in site.plant.polls if poll.unit == unit.address]
        client.period_s = rng.uniform(0.2, 0.8)
        clients.append(client)
    together(clients, rng.randint(250, 800))
    return site.case("gateway_mixup", forbidden=forbidden)


class StaleAnswers(Trouble):
    """A radio modem keeps the answer that came too late and hands it out after the next request."""

    def __init__(self, first: int) -> None:
        self.first = first
        self.kept: bytes | None = None
        self.begun = False

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """Nothing once, then what was kept, implausibly soon."""
        if exchange.number < self.first or not answers:
            return answers
        exchange.struck = self.begun
        self.begun = True
        kept, self.kept = self.kept, answers[0].data
        return [] if kept is None else [Answer(kept, 0.0045)]


def lockstep_on_a_line(rng: Random) -> Case:
    """All blocks of one size, so that each wrong answer fits its request."""
    quantity = rng.randint(1, 4)
    table = {40 * turn + place: smooth(rng) for turn in range(5) for place in range(quantity)}
    unit = Unit(rng.randint(1, 30), {3: table}, delay_s=0.08, spread=0.1)
    polls = [Poll(unit.address, 3, 40 * turn, quantity) for turn in range(5)]
    scene = Scene(rng, Plant([unit], polls))
    scene.habits.retries = 0
    scene.habits.timeout_s = 0.5
    total = rng.randint(120, 600)
    scene.run(total, StaleAnswers(rng.randint(total // 3, total // 2)))
    return scene.case("lockstep", forbidden=frozenset({"slow_answers", "value_spike"}))
