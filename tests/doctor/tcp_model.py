"""Modbus/TCP clients and servers over `network`: poll lists, keep-open or connect per request.

A kind makes a `Site`, gives its clients a `Server` with the trouble, lets them `run`, and returns
the site's `case`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from random import Random

from tests.doctor.case import Case, Expected
from tests.doctor.frames import mbap
from tests.doctor.network import Flow, Network
from tests.doctor.plant import Plant, Poll, random_plant

__all__ = ["Client", "Reply", "Request", "Site", "together"]

SERVER = "192.168.1.50"
CLIENTS = ("192.168.1.10", "192.168.1.11", "192.168.1.12", "192.168.1.13")


@dataclass(slots=True)
class Request:
    """What a client asks, on which connection, how manieth there."""

    number: int
    poll: Poll
    pdu: bytes
    transaction: int
    start_s: float
    flow: Flow
    place: int


@dataclass(slots=True)
class Reply:
    """Bytes of the server, and when, counted from the request."""

    data: bytes
    delay_s: float


class Server:
    """Answers each request with what its plant says; a trouble changes `replies`."""

    def __init__(self, plant: Plant, rng: Random) -> None:
        self.plant, self.rng = plant, rng

    def replies(self, request: Request) -> list[Reply]:
        """What is sent for a request."""
        answer = self.answer(request)
        return [Reply(mbap(request.transaction, request.poll.unit, answer), self.delay(request))]

    def answer(self, request: Request) -> bytes:
        """The right PDU."""
        return self.plant.by_address[request.poll.unit].answer(request.pdu, request.start_s)

    def delay(self, request: Request) -> float:
        """Of the unit."""
        return self.plant.by_address[request.poll.unit].delay(self.rng)

    def after(self, request: Request, done_s: float) -> None:
        """What happens on the connection after the answer."""


class Client:
    """One client with its poll list; `step` sends one request and waits for its answer."""

    def __init__(self, site: Site, address: str, server: Server, polls: list[Poll]) -> None:
        """Not connected yet."""
        self.site, self.address, self.server, self.polls = site, address, server, polls
        self.now_s, self.period_s, self.timeout_s, self.pause_s = 0.0, 1.0, 1.0, 0.005
        self.per_request = False
        self.flow: Flow | None = None
        self.place = 0
        self.sent: list[Request] = []
        self.transaction = site.rng.choice([0, site.rng.randint(0, 60_000)])

    def connect(self) -> Flow:
        """Open a connection if there is none."""
        if self.flow is None:
            self.flow = self.site.network.flow(self.address, SERVER)
            self.now_s = self.flow.open(self.now_s) + 0.001
            self.place = 0
        return self.flow

    def disconnect(self) -> None:
        """Close it from this side."""
        if self.flow is not None:
            self.now_s = self.flow.close(self.now_s, by_client=True) + 0.001
            self.flow = None

    def steps(self) -> Iterator[float]:
        """The times of the requests, for ever; each is sent when the next is asked for."""
        while True:
            start_s = self.now_s
            for poll in self.polls:
                yield self.now_s
                self.ask(poll)
            self.now_s = max(self.now_s, start_s + self.period_s)

    def run(self, requests: int) -> None:
        """By itself on the network."""
        together([self], requests)

    def run_until(self, stop_s: float) -> None:
        """Its cycle until the time is over."""
        for _ in self.steps():
            if self.now_s >= stop_s:
                return

    def ask(self, poll: Poll) -> None:
        """A request and what comes of it."""
        flow = self.connect()
        self.transaction = (self.transaction + 1) & 0xFFFF
        pdu = poll.pdu(self.now_s)
        request = Request(len(self.sent), poll, pdu, self.transaction, self.now_s, flow, self.place)
        self.sent.append(request)
        self.place += 1
        flow.send(self.now_s, True, self.framed(request))
        replies = self.server.replies(request)
        for reply in replies:
            flow.send(self.now_s + reply.delay_s, False, reply.data)
        waited_s = min((reply.delay_s for reply in replies), default=self.timeout_s)
        self.now_s += min(waited_s, self.timeout_s) + self.pause_s
        self.server.after(request, self.now_s - self.pause_s)
        if self.per_request:
            self.disconnect()

    def framed(self, request: Request) -> bytes:
        """The request as it is sent."""
        return mbap(request.transaction, request.poll.unit, request.pdu)


def together(clients: list[Client], requests: int) -> None:
    """Several clients, each by its own clock, until so many requests are sent."""
    plans = [client.steps() for client in clients]
    due = [next(plan) for plan in plans]
    while sum(len(client.sent) for client in clients) < requests:
        turn = min(range(len(clients)), key=due.__getitem__)
        due[turn] = next(plans[turn])


@dataclass(slots=True)
class Site:
    """A server with its plant, and the network that is recorded."""

    rng: Random
    plant: Plant = field(init=False)
    network: Network = field(default_factory=Network)
    units: int | None = None

    def __post_init__(self) -> None:
        """A plant behind the server."""
        self.plant = random_plant(self.rng, units=self.units or self.rng.randint(1, 3))

    def client(self, place: int, server: Server | None = None) -> Client:
        """The client of that number, with the site's polls and habits of its own."""
        server = server or Server(self.plant, self.rng)
        client = Client(self, CLIENTS[place], server, list(self.plant.polls))
        client.period_s = self.rng.choice([0.5, 1.0, 2.0, 5.0])
        client.now_s = self.rng.uniform(0, 0.5)
        return client

    def case(
        self,
        code: str | None,
        *,
        unit: int | None = None,
        client: str | None = None,
        forbidden: frozenset[str] = frozenset(),
    ) -> Case:
        """The capture."""
        expected = Expected(code, unit, client=client) if code else None
        return Case({"net.pcap": self.network.pcap()}, "net.pcap", (), expected, forbidden)
