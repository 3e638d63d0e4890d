"""Kinds in which somebody or something else is on the line, or nothing can be read at all."""

from __future__ import annotations

from dataclasses import replace
from random import Random

from analyzer.line import Line
from tests.doctor.case import Case, Expected, counter_case, kind, scale
from tests.doctor.frames import exception, rtu
from tests.doctor.kinds.silences import share_of
from tests.doctor.line_model import Answer, Exchange, Trouble
from tests.doctor.plant import Poll, random_plant
from tests.doctor.recorded import chunk_log, client_log
from tests.doctor.scene import CLIENT_DIALECTS, Scene
from tests.doctor.wire import Heard, Transmission


class Deaf(Trouble):
    """Nobody understands the master."""

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """None."""
        exchange.struck = True
        return []


@kind("swapped_wires")
def swapped_wires(rng: Random, seed: int) -> Case:
    """The tap's A and B are swapped; every second seed is the log of a master whose are."""
    scene = Scene(rng, inverted=seed % 2 == 0)
    forbidden = frozenset({"line_noise", "no_bias", "wrong_line_settings", "dead_unit_cost"})
    if seed % 2 == 0:
        scene.run(rng.randint(60, 400))
        made = scene.case("swapped_wires", forbidden=forbidden)
        return replace(made, words=("--line", str(scene.line)))
    exchanges = scene.run(rng.randint(60, 200), Deaf())
    heard: Heard = []
    for exchange in exchanges:
        for place in range(rng.randint(1, 5)):
            byte = rng.choice([0x00, 0x00, 0xFF, 0xFE, 0xF8, 0xFC])
            after_s = len(exchange.request) * scene.character_s + 0.02
            heard.append((exchange.start_s + after_s + place * scene.character_s, byte))
    log = client_log(exchanges, heard, rng.choice(CLIENT_DIALECTS))
    return Case({"client.log": log}, "client.log", (), Expected("swapped_wires"), forbidden)


class OtherRate(Trouble):
    """One unit is set to another rate: it reads the master all the same, and answers in its own."""

    def __init__(self, unit: int, line: Line) -> None:
        self.unit, self.line = unit, line

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """Sent at the other rate."""
        if exchange.unit != self.unit:
            return answers
        exchange.struck = True
        return [replace(one, line=self.line, right=False) for one in answers]


@kind("wrong_line_settings")
def wrong_line_settings(rng: Random, seed: int) -> Case:
    """All of a recording at another rate than that of the line, or one unit's answers."""
    if seed % 2:
        return _whole_line_at_another_rate(rng)
    scene = Scene(rng, random_plant(rng, units=rng.randint(2, 4)))
    unit = rng.choice(scene.plant.units).address
    factor = rng.choice([0.5, 2])
    scene.run(
        rng.randint(150, 600),
        OtherRate(unit, replace(scene.line, baud=int(scene.line.baud * factor))),
    )
    forbidden = frozenset({"duplicate_address", "line_noise", "driver_enable", "no_bias"})
    return scene.case("wrong_line_settings", unit=unit, forbidden=forbidden)


def _whole_line_at_another_rate(rng: Random) -> Case:
    scene = Scene(rng)
    scene.run(rng.randint(60, 400))
    real = scene.line
    baud = rng.choice([rate for rate in (9600, 19_200, 38_400, 57_600) if rate != real.baud])
    scene.pair.line = replace(real, baud=baud)
    heard = scene.pair.heard()
    scene.pair.sent = []
    made = scene.case("wrong_line_settings")
    log = chunk_log(heard, "byte", 0.0)
    forbidden = frozenset({"line_noise", "swapped_wires", "foreign_protocol"})
    words = ("--line", f"{baud}-8{real.parity}1")
    return replace(made, files={"tap.jsonl": log}, words=words, forbidden=forbidden)


class Bystander(Trouble):
    """A unit takes others' frames for its own and refuses them."""

    def __init__(self, rng: Random, unit: int, victim: int, rate: float, instead: bool) -> None:
        self.rng, self.unit, self.victim = rng, unit, victim
        self.rate, self.instead = rate, instead

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """With an exception under the bystander's own address before or after the right one."""
        if exchange.unit != self.victim or self.rng.random() >= self.rate:
            return answers
        exchange.struck = True
        function = exchange.request[1]
        stranger = rtu(self.unit, exception(function, 1))
        if self.instead or not answers:
            return [Answer(stranger, self.rng.uniform(0.003, 0.006), right=False)]
        behind_s = answers[0].delay_s + len(answers[0].data) * 0.0012 + 0.006
        return [*answers, Answer(stranger, behind_s, right=False)]


class DeafAfterOthers(Trouble):
    """A unit loses step over another's answer: it is silent after that one's traffic."""

    def __init__(self, rng: Random, unit: int, other: int, rate: float) -> None:
        self.rng, self.unit, self.other, self.rate = rng, unit, other, rate

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """None right after the other's exchange."""
        before = exchange.before
        after = before is not None and before.unit == self.other and before.outcome == "ok"
        if exchange.unit != self.unit or not after or self.rng.random() >= self.rate:
            return answers
        exchange.struck = True
        return []


@kind("bystander")
def bystander(rng: Random, seed: int) -> Case:
    """Unit x answers unit y's requests; every third seed, x is silent after y's traffic."""
    scene = Scene(rng, random_plant(rng, units=rng.randint(3, 4)))
    forbidden = frozenset({"duplicate_address", "dead_unit_cost", "line_noise", "two_masters"})
    if seed % 3 == 0:
        rng.shuffle(scene.plant.polls)
        unit, other = _neighbours(scene)
        count, rate = scale(rng, 0.15, least_rate=0.5)
        scene.run(count, DeafAfterOthers(rng, unit, other, rate))
        return scene.case("bystander", unit=unit, forbidden=forbidden)
    unit, victim = (one.address for one in rng.sample(scene.plant.units, 2))
    count, rate = scale(rng, share_of(scene.plant, victim), least_rate=0.2)
    scene.habits.pauses_s = (0.05,)
    scene.run(count, Bystander(rng, unit, victim, rate, instead=seed % 3 == 1))
    return scene.case("bystander", unit=unit, forbidden=forbidden)


def _neighbours(scene: Scene) -> tuple[int, int]:
    """A unit that is asked after another one somewhere in the cycle, and elsewhere not."""
    polls = scene.plant.polls
    other, unit = polls[0].unit, next(poll.unit for poll in polls if poll.unit != polls[0].unit)
    # What is asked in each cycle comes after the other unit, else there is hardly anything to see.
    own = sorted((poll for poll in polls if poll.unit == unit), key=lambda poll: poll.every)
    others = [poll for poll in polls if poll.unit not in (unit, other)]
    theirs = [poll for poll in polls if poll.unit == other]
    scene.plant.polls = [*theirs, own[0], *others, *own]
    scene.habits.pauses_s, scene.habits.retries = (0.03,), 0
    return unit, other


class Echo(Trouble):
    """The adapter hears itself: a tap after it sees each request twice."""

    def __init__(self, line: Line) -> None:
        self.line = line

    def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
        """The request again, then the answer."""
        exchange.struck = True
        again = Answer(exchange.request, 0.0001, right=False)
        length_s = Transmission(0.0, exchange.request, self.line, {}).end_s
        return [again, *(replace(one, delay_s=one.delay_s + length_s) for one in answers)]


@kind("own_echo")
def own_echo(rng: Random, seed: int) -> Case:
    """A tap sees each request twice; a client's log has the request in the response's place."""
    scene = Scene(rng)
    forbidden = frozenset({"two_masters", "bystander", "dead_unit_cost"})
    if seed % 2:
        scene.run(rng.randint(60, 500), Echo(scene.line))
        return scene.case("own_echo", forbidden=forbidden)
    scene.habits.retries = 0
    exchanges = scene.run(rng.randint(60, 300), Deaf())
    heard: Heard = []
    for exchange in exchanges:
        expected = min(len(exchange.request), _answer_length(exchange.poll))
        start_s = exchange.start_s + len(exchange.request) * scene.character_s
        heard += [
            (start_s + 1e-4 * place, byte) for place, byte in enumerate(exchange.request[:expected])
        ]
    log = client_log(exchanges, heard, rng.choice(CLIENT_DIALECTS))
    return Case({"client.log": log}, "client.log", (), Expected("own_echo"), forbidden)


def _answer_length(poll: Poll) -> int:
    bits = poll.function in (1, 2)
    return 5 + ((poll.quantity + 7) // 8 if bits else 2 * poll.quantity)


def _foreign_run(rng: Random, style: str, number: int) -> bytes:
    if style == "ascii":
        return f"~2001{number % 16:X}642E002{rng.randint(0, 9)}FD35\r".encode()
    if style == "head":
        body = bytes([0xAA, 0x55, 0x90, 0xEB, 0x02, number & 0xFF, *rng.randbytes(12)])
        return body + bytes([sum(body) & 0xFF])
    return bytes([0xFE, 0xFE, 0x68, number & 0xFF, 0x10, 0x68, 0x11, 0x04, *rng.randbytes(4), 0x16])


@kind("foreign_protocol")
def foreign_protocol(rng: Random, seed: int) -> Case:
    """Runs of another protocol with a period of their own, beside Modbus or alone."""
    scene = Scene(rng)
    style = ("ascii", "head", "meter")[seed % 3]
    until_s = 60.0
    if seed % 4:
        scene.habits.period_s = 1.0
        until_s = max(30.0, scene.run(rng.randint(100, 500))[-1].start_s)
    period, at, number = rng.uniform(0.5, 2.5), 0.3, 0
    until_s = max(until_s, 40 * period)
    while at < until_s:
        scene.pair.put(_free(scene, at), _foreign_run(rng, style, number))
        at, number = at + period, number + 1
    forbidden = frozenset({"line_noise", "two_masters", "wrong_line_settings", "no_bias"})
    return scene.case("foreign_protocol", forbidden=forbidden)


def _free(scene: Scene, at_s: float) -> float:
    """The first moment at which 50 ms are free; those who share a line politely wait for it."""
    for one in sorted(scene.pair.sent, key=lambda one: one.start_s):
        if one.end_s > at_s - 0.01 and one.start_s < at_s + 0.05:
            at_s = one.end_s + 0.01
    return at_s


@counter_case("a master that repeats at once")
def repeats_at_once(rng: Random, _seed: int) -> Case:
    """Two requests without an answer between them are no echo: a timeout lies between."""
    scene = Scene(rng)
    scene.habits.retries, scene.habits.timeout_s = 1, 0.1
    unit = scene.plant.units[0].address

    class Sometimes(Trouble):
        def answers(self, exchange: Exchange, answers: list[Answer]) -> list[Answer]:
            lost = exchange.unit == unit and exchange.attempt == 0 and rng.random() < 0.5
            return [] if lost else answers

    scene.run(500, Sometimes())
    return scene.case(None, forbidden=frozenset({"own_echo", "two_masters", "line_noise"}))
