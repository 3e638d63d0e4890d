"""Kinds of Modbus/TCP: connections refused, closed, opened for each request; framing; lockstep."""

from __future__ import annotations

from random import Random

from tests.doctor.case import Case, counter_case, kind
from tests.doctor.frames import mbap, rtu
from tests.doctor.kinds.gateways import lockstep_on_a_line
from tests.doctor.plant import Poll
from tests.doctor.tcp_model import CLIENTS, SERVER, Client, Reply, Request, Server, Site, together
from tests.doctor.values import smooth

SLOW_S = 0.4


class OneBehind(Server):
    """From one moment on each answer is that of the request before, with its id or the new one."""

    def __init__(self, site: Site, first: int, own_id: bool) -> None:
        super().__init__(site.plant, site.rng)
        self.first, self.own_id = first, own_id
        self.kept: tuple[int, bytes] | None = None

    def replies(self, request: Request) -> list[Reply]:
        """Nothing once, then what was due."""
        due = (request.transaction, self.answer(request))
        if request.number < self.first:
            return super().replies(request)
        kept, self.kept = self.kept, due
        if kept is None:
            return []
        transaction = kept[0] if self.own_id else request.transaction
        return [Reply(mbap(transaction, request.poll.unit, kept[1]), 0.004)]


@kind("lockstep")
def lockstep(rng: Random, seed: int) -> Case:
    """TCP: answer n-1 follows request n; every third seed RTU, where only the values tell."""
    if seed % 3 == 0:
        return lockstep_on_a_line(rng)
    site = Site(rng, units=1)
    total = rng.randint(80, 500)
    client = site.client(0, OneBehind(site, rng.randint(10, total // 3), own_id=seed % 2 == 0))
    unit = site.plant.units[0].address
    quantity = rng.randint(1, 4)
    site.plant.units[0].tables.setdefault(3, {})
    table = site.plant.units[0].tables[3]
    table.update({40 * turn + place: smooth(rng) for turn in range(5) for place in range(quantity)})
    # Blocks of one size: with others the client would notice at once.
    client.polls = [Poll(unit, 3, 40 * turn, quantity) for turn in range(5)]
    client.run(total)
    forbidden = frozenset({"slow_answers", "gateway_mixup", "connection_churn"})
    return site.case("lockstep", forbidden=forbidden)


@kind("connection_limit")
def connection_limit(rng: Random, seed: int) -> Case:
    """A server that has one place: others are refused, or dropped right after they were let in."""
    site = Site(rng)
    owner = site.client(0)
    owner.period_s = 1.0
    stays_s = rng.uniform(20, 60)
    again_s, now_s = rng.uniform(1, 4), 3.0
    refuse = seed % 2 == 0
    owner.run_until(stays_s)
    owner.disconnect()
    while now_s < owner.now_s:
        _turned_away(site, now_s, refuse, rng)
        now_s += again_s * rng.uniform(0.95, 1.05)
    guest = site.client(1)
    guest.now_s = owner.now_s + again_s
    guest.run(rng.randint(20, 80))
    late_s = owner.now_s + 2 * again_s
    while late_s < guest.now_s:  # now the first one is the one who waits outside
        _turned_away(site, late_s, refuse, rng, place=0)
        late_s += again_s
    forbidden = frozenset({"connection_churn", "lockstep", "slow_answers"})
    return site.case("connection_limit", forbidden=forbidden)


def _turned_away(site: Site, at_s: float, refuse: bool, rng: Random, place: int = 1) -> None:
    flow = site.network.flow(CLIENTS[place], SERVER)
    if refuse:
        flow.refused(at_s)
        return
    open_s = flow.open(at_s)
    if rng.random() < 0.5:
        flow.reset(open_s + 0.0005, by_client=False)
    else:
        flow.close(open_s + 0.0005, by_client=False)


class FirstIsLost(Server):
    """Needs a second after a connection was opened: what comes sooner gets no answer."""

    def replies(self, request: Request) -> list[Reply]:
        """Nothing to the first one."""
        return super().replies(request) if request.place else []


@kind("connection_churn")
def connection_churn(rng: Random, seed: int) -> Case:
    """Closed when idle; a connection for each request; or the first request of each is lost."""
    site = Site(rng)
    style = ("per_request", "idle", "first")[seed % 3]
    if style == "idle":
        _idle_closes(site, rng)
    elif style == "per_request":
        client = site.client(0)
        client.per_request = True
        client.run(rng.randint(60, 300))
    else:
        client = site.client(0, FirstIsLost(site.plant, rng))
        total, stretch = rng.randint(100, 300), rng.randint(4, 9)
        for _ in range(total // stretch):
            together([client], len(client.sent) + stretch)
            client.disconnect()
    forbidden = frozenset({"connection_limit", "lockstep", "slow_answers"})
    return site.case("connection_churn", forbidden=forbidden)


def _idle_closes(site: Site, rng: Random) -> None:
    client = site.client(0)
    idle_s = rng.choice([10.0, 30.0, 60.0])
    client.polls = client.polls[:3]
    for _ in range(rng.randint(15, 40)):
        for poll in client.polls:
            client.ask(poll)
        flow = client.connect()
        flow.half_close(client.now_s + idle_s, by_client=False)
        client.now_s += idle_s * rng.uniform(1.05, 1.6)
        request = mbap(client.transaction + 1, client.polls[0].unit, client.polls[0].pdu(0))
        flow.send(client.now_s, True, request, acked=False)
        flow.reset(client.now_s + 0.0004, by_client=False)
        client.flow = None
        client.now_s += 0.01


class SpeaksRtu(Server):
    """Answers MBAP requests with RTU frames."""

    def replies(self, request: Request) -> list[Reply]:
        """A bare RTU frame."""
        return [Reply(rtu(request.poll.unit, self.answer(request)), self.delay(request))]


class Silent(Server):
    """Does not know what to make of it."""

    def replies(self, request: Request) -> list[Reply]:
        """Nothing."""
        return []


class RtuClient(Client):
    """Sends RTU frames to a port of Modbus/TCP."""

    def framed(self, request: Request) -> bytes:
        """With checksum, without header."""
        return rtu(request.poll.unit, request.pdu)


@kind("framing_mismatch")
def framing_mismatch(rng: Random, seed: int) -> Case:
    """MBAP is answered in RTU; or RTU is sent to a port that others use with MBAP."""
    site = Site(rng)
    if seed % 2:
        client = site.client(0, SpeaksRtu(site.plant, rng))
        client.run(rng.randint(60, 300))
        return site.case("framing_mismatch", forbidden=frozenset({"lockstep", "slow_answers"}))
    good = site.client(0)
    wrong = RtuClient(site, CLIENTS[1], Silent(site.plant, rng), list(site.plant.polls))
    together([good, wrong], rng.randint(80, 300))
    forbidden = frozenset({"lockstep", "slow_answers", "dead_unit_cost"})
    return site.case("framing_mismatch", client=CLIENTS[1], forbidden=forbidden)


@counter_case("a slow server whose client keeps two requests in flight")
def pipelining(rng: Random, _seed: int) -> Case:
    """Answer n-1 follows request n because the client wants it so."""
    site = Site(rng)
    flow = site.network.flow(CLIENTS[0], SERVER)
    now_s = flow.open(0.0) + 0.001
    server = Server(site.plant, rng)
    due: list[bytes] = []
    for number in range(300):
        poll = site.plant.polls[number % len(site.plant.polls)]
        request = Request(number, poll, poll.pdu(now_s), number + 1, now_s, flow, number)
        flow.send(now_s, True, mbap(number + 1, poll.unit, request.pdu))
        due.append(server.replies(request)[0].data)
        if len(due) == 2:
            now_s += 0.06
            flow.send(now_s, False, due.pop(0))
        now_s += 0.005
    flow.send(now_s + 0.05, False, due.pop(0))
    return site.case(None, forbidden=frozenset({"lockstep", "gateway_mixup", "slow_answers"}))
