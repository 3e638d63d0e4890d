"""A serial line byte by byte: a master works off a poll list, units answer, and trouble strikes.

A `Trouble` decides for each exchange what the line carries of the request, and what answers, when.
What it does may depend on all that an `Exchange` knows: that is how conditional faults are made.
The master behaves like real ones: it takes the first whole and right answer, waits until its
timeout otherwise, and asks again if it is asked to.

    pair = Pair(Line(19200))
    master = Master(pair, random_plant(rng), Habits(rng), rng)
    master.run(200)
    chunk_log(pair.heard())
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from random import Random

from analyzer.line import Line
from tests.doctor.frames import rtu
from tests.doctor.plant import Plant, Poll
from tests.doctor.wire import Pair, Transmission

__all__ = ["Answer", "Exchange", "Habits", "Master", "Trouble", "random_line", "together"]

NEVER = -1e9
RECENT = 12
"""As many transmissions back is looked for one that still goes on."""


@dataclass(slots=True)
class Exchange:
    """A request and what is known when it is sent; `outcome` comes afterwards.

    `silence_s` is the pause before the request, `answered` what was sent for it with start and
    end. `outcome` is `ok`, `silent` or `damaged` as the master saw it; `struck` says that the
    trouble had its hand in it.
    """

    number: int
    poll: Poll
    request: bytes
    start_s: float
    silence_s: float
    before: Exchange | None
    attempt: int = 0
    write_s: float = NEVER
    outcome: str = "ok"
    struck: bool = False
    answered: list[tuple[float, float, bytes]] = field(default_factory=list)

    @property
    def unit(self) -> int:
        """The unit that is asked."""
        return self.poll.unit


@dataclass(slots=True)
class Answer:
    """What somebody sends after a request; `delay_s` counts from the request's last stop bit."""

    data: bytes
    delay_s: float
    pauses: Mapping[int, float] = field(default_factory=dict)
    line: Line | None = None
    right: bool = True


class Trouble:
    """What goes wrong; this one leaves everything as it is."""

    def request(self, exchange: Exchange) -> bytes:
        """What the line carries of the request; a unit answers the right one only."""
        return exchange.request

    def request_pauses(self, exchange: Exchange) -> Mapping[int, float]:
        """The pauses inside the request, by position."""
        return {}

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """What is sent after it."""
        return answers


@dataclass(slots=True)
class Habits:
    """How the master works: all in seconds but `retries`.

    `pauses_s` are the pauses after an answer, of which chance takes one; `period_s` is the least
    time of a cycle.
    """

    timeout_s: float = 0.5
    retries: int = 0
    pauses_s: tuple[float, ...] = (0.01,)
    period_s: float = 0.0

    @classmethod
    def by_chance(cls, rng: Random) -> Habits:
        """Those of some program."""
        pause = rng.choice([0.006, 0.01, 0.02, 0.05, 0.1])
        pauses = (pause,) if rng.random() < 0.6 else (pause, pause * 1.7, pause * 3)
        period = rng.choice([0.0, 0.0, 0.5, 1.0, 2.0])
        return cls(rng.choice([0.2, 0.3, 0.5, 1.0]), rng.choice([0, 0, 1, 2]), pauses, period)


class Master:
    """One master on a line; `run` adds its exchanges, and what answers them, to the wires."""

    def __init__(
        self,
        pair: Pair,
        plant: Plant,
        habits: Habits,
        rng: Random,
        trouble: Trouble | None = None,
    ) -> None:
        """Nothing has been asked yet."""
        self.pair, self.plant, self.habits, self.rng = pair, plant, habits, rng
        self.trouble = trouble or Trouble()
        self.exchanges: list[Exchange] = []
        self.now_s = 0.0
        self.quiet_since_s = 0.0
        self._write_s = NEVER
        self._pending: list[tuple[float, float]] = []

    def run(self, exchanges: int) -> list[Exchange]:
        """Cycles until that many requests have been sent."""
        for _ in self.steps():
            if len(self.exchanges) >= exchanges:
                break
        return self.exchanges

    def steps(self) -> Iterator[float]:
        """The times of the requests, for ever; each is sent when the next one is asked for."""
        for cycle in count():
            start_s = self.now_s
            for poll in self.plant.polls:
                if cycle % poll.every == 0:
                    yield from self._attempts(poll)
            self.now_s = max(self.now_s, start_s + self.habits.period_s)

    def _attempts(self, poll: Poll) -> Iterator[float]:
        """A request with its retries."""
        for attempt in range(self.habits.retries + 1):
            yield self.now_s
            if self._exchange(poll, attempt).outcome == "ok":
                return

    def _exchange(self, poll: Poll, attempt: int) -> Exchange:
        start_s = self.now_s
        before = self.exchanges[-1] if self.exchanges else None
        request = rtu(poll.unit, poll.pdu(start_s))
        silence_s = start_s - self.quiet_since_s
        exchange = Exchange(
            len(self.exchanges), poll, request, start_s, silence_s, before, attempt, self._write_s
        )
        self.exchanges.append(exchange)
        carried = self.trouble.request(exchange)
        pauses = self.trouble.request_pauses(exchange)
        end_s = self._end(start_s, carried) + sum(pauses.values())
        understood = carried == request and not self._crossed(start_s, end_s)
        self.pair.put(start_s, carried, pauses)
        self._answer(exchange, self._answers(exchange, end_s, understood), end_s)
        if poll.values is not None:
            self._write_s = end_s
        return exchange

    def _answers(self, exchange: Exchange, end_s: float, understood: bool) -> list[Answer]:
        unit = self.plant.by_address.get(exchange.unit)
        answers = []
        if unit is not None and understood:
            data = rtu(exchange.unit, unit.answer(exchange.request[1:-2], end_s))
            answers = [Answer(data, max(unit.delay(self.rng), self._silence_s()))]
        return self.trouble.answers(exchange, answers)

    def _answer(self, exchange: Exchange, answers: list[Answer], end_s: float) -> None:
        """Send the answers and let the master draw its conclusion."""
        latest_s = end_s + self.habits.timeout_s
        good_s, heard = None, False
        for answer in answers:
            start_s = end_s + answer.delay_s
            self.pair.put(start_s, answer.data, answer.pauses, answer.line)
            stop_s = self._end(start_s, answer.data) + sum(answer.pauses.values())
            self._pending.append((start_s, stop_s))
            exchange.answered.append((start_s, stop_s, answer.data))
            heard = heard or start_s < latest_s
            if answer.right and start_s <= latest_s and good_s is None:
                good_s = stop_s
        exchange.outcome = "ok" if good_s is not None else "damaged" if heard else "silent"
        stops = [stop for start, stop in self._pending if start < latest_s]
        done_s = good_s if good_s is not None else max([latest_s, *stops])
        self.quiet_since_s = max([end_s, *(stop for stop in stops if stop <= done_s)])
        self.now_s = done_s + max(self._silence_s(), self.rng.choice(self.habits.pauses_s))
        self._pending = [one for one in self._pending if one[1] > done_s]

    def _crossed(self, start_s: float, end_s: float) -> bool:
        """Whether somebody else is on the line while the request is sent."""
        recent = self.pair.sent[-RECENT:]
        return any(one.start_s < end_s and one.end_s > start_s for one in recent)

    def _end(self, start_s: float, data: bytes) -> float:
        return Transmission(start_s, data, self.pair.line, {}).end_s

    def _silence_s(self) -> float:
        """The specification's 3.5 characters, 1.75 ms above 19200 baud (section 2.5.1.1)."""
        character_s = Transmission(0, b"\0", self.pair.line, {}).end_s
        return max(3.6 * character_s, 0.0018) if self.pair.line.baud <= 19_200 else 0.0018


def together(masters: Sequence[Master], exchanges: int) -> None:
    """Several masters on one line, each by its own clock, until so many requests are sent."""
    plans = [master.steps() for master in masters]
    due = [next(plan) for plan in plans]
    while sum(len(master.exchanges) for master in masters) < exchanges:
        turn = min(range(len(masters)), key=due.__getitem__)
        due[turn] = next(plans[turn])


def random_line(rng: Random, slowest: int = 9600, fastest: int = 115_200) -> Line:
    """Settings that people use."""
    rates = [rate for rate in (9600, 19_200, 38_400, 57_600, 115_200) if slowest <= rate <= fastest]
    weights = [10 // (place + 1) for place in range(len(rates))]
    parity = rng.choice(["N", "N", "E"])
    return Line(rng.choices(rates, weights)[0], 8, parity, 1)
