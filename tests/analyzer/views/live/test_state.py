"""What the live screens show of the state of a line: history, ages, load, lost ports."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer.filters import parse
from analyzer.live_run import BusStatus
from analyzer.profiles import parse_binding
from analyzer.session import FileRun
from analyzer.settings import Settings
from analyzer.views.live import history as history_module
from analyzer.views.live.activity import Activity
from analyzer.views.live.health import lines as health
from analyzer.views.live.history import History, Mark
from analyzer.views.live.map import lines as map_lines
from analyzer.views.live.state import LiveState
from analyzer.views.live.status import status_line
from analyzer.views.live.table import lines as table_lines
from analyzer.views.row_lines import TableOptions
from analyzer.views.screen import Part

MS = 1_000_000


def framed(body: str) -> bytes:
    """With its checksum."""
    data = bytes.fromhex(body)
    return data + _modlens.crc16(data).to_bytes(2, "little")


class Line:
    """A bus with a clock of its own; requests every 100 ms, 300 ms after one without answer."""

    def __init__(self) -> None:
        self.core = _modlens.Session(_modlens.Functions(), live=True)
        self.bus = self.core.add_bus(
            "bus", source="bus", mode="rtu", clock="utc", line=(19200, 8, "E", 1.0)
        )
        self.now_ms = 0

    @property
    def seconds(self) -> float:
        """The time since the beginning."""
        return self.now_ms / 1000

    def stats(self) -> dict[str, Any]:
        """The statistics so far."""
        import json  # noqa: PLC0415

        found: dict[str, Any] = json.loads(self.core.stats())
        return found

    def ask(self, unit: int, address: int, value: int | None) -> _modlens.Batch:
        """One register is asked for; None is no answer."""
        self._send(framed(f"{unit:02x}03{address:04x}0001"), 20)
        if value is not None:
            self._send(framed(f"{unit:02x}0302{value:04x}"), 0)
        self.now_ms += 80 if value is not None else 280
        self.core.poll(self.now_ms * MS)
        return self.core.take()

    def _send(self, data: bytes, after_ms: int) -> None:
        self.core.feed(self.bus, data, self.now_ms * MS)
        self.now_ms += after_ms
        self.core.poll(self.now_ms * MS)


def batches(line: Line, count: int) -> Iterator[_modlens.Batch]:
    """So many transactions: even ones ask unit 1, odd ones unit 2."""
    for number in range(count):
        yield line.ask(1 + number % 2, number, number)


def text(parts: list[Part]) -> str:
    """A line without its styles."""
    return "".join(part for part, _ in parts)


def numbers(history: History, room: int) -> list[int | str]:
    """The addresses of the transactions on a page, and the texts of marks."""
    return [
        one.text if isinstance(one, Mark) else one.address or 0 for one in history.page(room)[0]
    ]


@pytest.fixture
def history(monkeypatch: pytest.MonkeyPatch) -> History:
    """A history of twenty rows, of which eight at least are kept."""
    monkeypatch.setattr(history_module, "MAX_ROWS", 20)
    made = History()
    for batch in batches(Line(), 20):
        if len(batch.transactions):
            made.add(batch.transactions)
    return made


def test_the_newest_rows_are_at_the_end(history: History) -> None:
    """A page is the last rows; pages back and forth stay within what is there."""
    newest = numbers(history, 5)
    assert newest == sorted(newest, key=int)
    history.turn(-5, 5)
    before = numbers(history, 5)
    assert int(before[-1]) + 1 == int(newest[0])
    for _ in range(9):
        history.turn(-5, 5)
    assert numbers(history, 5)[0] == 0
    history.turn(5, 5)
    assert numbers(history, 5) == [5, 6, 7, 8, 9]
    for _ in range(9):
        history.turn(5, 5)
    assert history.is_at_end
    assert numbers(history, 5) == newest


def test_a_page_that_is_looked_at_does_not_move(history: History) -> None:
    """Rows that come meanwhile follow it."""
    history.turn(-5, 5)
    before = numbers(history, 5)
    line = Line()
    line.now_ms = 10_000
    for batch in batches(line, 6):
        if len(batch.transactions):
            history.add(batch.transactions)
    assert set(numbers(history, 5)) & set(before)


def test_a_filter_looks_at_what_was_seen_before(history: History) -> None:
    """Rows from before the filter was set are shown, and all are back without it."""
    every = numbers(history, 99)
    history.set_filter(parse("unit == 2"))
    assert numbers(history, 99) == [number for number in every if int(number) % 2]
    history.set_filter(None)
    assert numbers(history, 99) == every


def test_what_is_no_longer_kept_is_said(history: History) -> None:
    """A line in front of the oldest row shows how many are missing."""
    line = Line()
    line.now_ms = 10_000
    for batch in batches(line, 30):
        if len(batch.transactions):
            history.add(batch.transactions)
    kept = numbers(history, 99)
    missing = int(str(kept[0]).split()[0])
    assert kept[0] == f"{missing} older transactions are no longer kept"
    assert missing + len(kept) - 1 >= 48


def state_of(line: Line, *statuses: BusStatus) -> LiveState:
    """The state of the screens for a line."""
    names = tuple(status.bus for status in statuses) or ("bus",)
    return LiveState(
        TableOptions(buses=names), line.stats, lambda: statuses, clock=lambda: line.seconds
    )


def test_rows_that_come_during_a_pause_are_in_the_log_afterwards() -> None:
    """Nothing is skipped by looking closely."""
    line = Line()
    state = state_of(line)
    for batch in batches(line, 5):
        state.put(batch)
    state.pause(paused=True)
    before = numbers(state.history, 99)
    for batch in batches(line, 5):
        state.put(batch)
    assert numbers(state.history, 99)[: len(before)] == before
    state.pause(paused=False)
    assert len(numbers(state.history, 99)) >= 9


def test_a_unit_that_no_longer_answers_is_shown_as_dead() -> None:
    """Its age grows in the table, and the map says for how long it has been silent."""
    line = Line()
    state = state_of(line)
    for turn in range(40):
        for unit, dead in ((1, False), (2, turn >= 10)):
            state.put(line.ask(unit, 7, None if dead else turn))
    state.refresh()
    assert state.age("bus", 2).is_dead
    assert not state.age("bus", 1).is_dead
    shown = [text(line) for line in map_lines(state, 80, 20)]
    (head,) = [line for line in shown if "unit 2" in line]
    assert "no response for" in head
    rows = {line.split()[0]: line for line in map(text, table_lines(state, 80, 20)[1:])}
    assert " 0 s " in rows["1"]
    assert " 0 s " not in rows["2"]


def test_the_state_of_the_line_is_said() -> None:
    """Settings and how they were found, the last frame, silence, and a port that is away."""
    line = Line()
    given = BusStatus("bus", "19200-8E1", "given", None)
    state = state_of(line, given)
    line.now_ms = 3000
    state.refresh()
    assert text(status_line(state, 80)).strip() == "19200-8E1 nothing received for 3 s"
    for batch in batches(line, 5):
        state.put(batch)
    state.refresh()
    assert text(status_line(state, 80)).strip() == "19200-8E1 last frame 0 s ago"
    line.now_ms += 7000
    state.refresh()
    assert text(status_line(state, 80)).strip() == "19200-8E1 last frame 7 s ago"
    lost = state_of(line, BusStatus("bus", "9600-8N1", "found", 12.3))
    lost.refresh()
    assert text(status_line(lost, 80)).strip() == "port lost 12 s ago, waiting for it"


def test_bytes_without_a_valid_frame_are_told_from_silence() -> None:
    """Traffic at other settings is not "nothing received"."""
    line = Line()
    state = state_of(line, BusStatus("bus", "19200-8E1", "given", None))
    for _ in range(30):
        line._send(b"\x55\x13\xfe", 50)
    line.core.poll(line.now_ms * MS + 10_000 * MS)
    state.refresh()
    shown = text(status_line(state, 80)).strip()
    assert shown == "19200-8E1 90 bytes, no valid frame: wrong line settings?"


@pytest.mark.parametrize("width", [40, 80, 120])
def test_several_buses_share_the_line(width: int) -> None:
    """Each has its part, and the line is as wide as the screen."""
    line = Line()
    states = [BusStatus(f"{name}{'x' * 30}", "9600-8N1", "found", None) for name in "ab"]
    state = state_of(line, *states)
    state.refresh()
    shown = text(status_line(state, width))
    assert len(shown) == width
    assert " | " in shown


@pytest.mark.parametrize("width", [40, 80, 120])
def test_trouble_of_the_recording_is_shown_while_it_lasts(width: int) -> None:
    """In front of the state of the buses, in the line that all views have."""
    line = Line()
    state = state_of(line, BusStatus("bus", "9600-8N1", "found", None))
    state.refresh()
    assert "RECORDING" not in text(status_line(state, width))
    state.trouble = lambda: "/var/lib/bus.pcapng: no space left"
    shown = status_line(state, width)
    assert text(shown).startswith("NOT RECORDING: ")
    assert shown[0][1] == "bad"
    assert len(text(shown)) == width


def test_the_utilization_falls_when_the_line_is_silent() -> None:
    """It is that of the last ten seconds; the statistics' own never fall without bytes."""
    activity = Activity()
    found = []
    for second in itertools.chain(range(30), range(30, 60)):
        busy = min(second, 30) * 500_000.0
        counts = {"bus": "bus", "bytes": {"ok": 1}, "frames": {"ok": second}, "busy_us": busy}
        activity.update({"buses": [counts]}, float(second))
        found.append(activity.of("bus").utilization)
    assert found[25] == pytest.approx(0.5)
    assert found[35] == pytest.approx(0.25, abs=0.06)
    assert found[50] == 0.0


def test_advice_is_in_full_where_there_is_room() -> None:
    """On a high screen nothing is cut, on a low one a finding is a line."""
    line = Line()
    state = state_of(line)
    for turn in range(20):
        state.put(line.ask(1, 7, None if turn % 4 == 3 else turn))
    state.refresh()
    tall = [text(one).rstrip() for one in health(state, 80, 60)]
    low = [text(one).rstrip() for one in health(state, 80, 8)]
    after = tall.index("findings, most urgent first (modlens explain NAME)")
    assert not any(one.endswith("…") for one in tall[after:])
    assert sum("…" in one for one in low)


def test_errors_of_the_last_minutes_stand_beside_those_since_the_start() -> None:
    """A unit that has worked for long and fails now shows 100 %."""
    line = Line()
    state = LiveState(TableOptions(buses=("bus",)), line.stats, clock=lambda: line.seconds)
    for value in [7] * 300 + [None] * 300:
        state.put(line.ask(1, 0, value))
        line.now_ms += 1000
        state.refresh()
    found = state.activity.errors("bus", 1, 3)
    assert 60 < found.transactions == found.failed < 180
    head, row = (text(one) for one in table_lines(state, 80, 20))
    since_start = row[: head.index("errors") + len("errors")].split()[-1]
    lately = row[: head.index("2 min") + len("2 min")].split()[-1]
    assert 45 < float(since_start.rstrip("%")) < 55
    assert lately == "100%"


def test_the_map_has_a_ruler() -> None:
    """Offsets stand above the columns of registers."""
    line = Line()
    state = LiveState(TableOptions(buses=("bus",)), line.stats, clock=lambda: line.seconds)
    for address in range(96, 100):
        state.put(line.ask(1, address, address))
    state.refresh()
    title, ruler, values = (text(one) for one in map_lines(state, 80, 20)[-3:])
    assert title.strip() == "unit 1 holding registers"
    for offset, value in (("+0", "96"), ("+1", "97"), ("+2", "98")):
        assert values[: ruler.index(offset) + len(offset)].endswith(value)


def test_a_letter_says_what_a_register_is_for() -> None:
    """Registers that differ by how they moved; of several buses nothing is said."""
    line = Line()
    lines = {}
    for buses in (("bus",), ("bus", "other")):
        state = LiveState(TableOptions(buses=buses), line.stats, clock=lambda: line.seconds)
        for at in range(60):
            state.put(line.ask(1, 100, 5000 + at * 17 % 13 * 40 + at % 3))
            state.put(line.ask(1, 101, 4711))
            line.now_ms += 20_000
        state.refresh()
        lines[buses] = [text(one) for one in map_lines(state, 80, 20)]
    assert lines["bus",][0].strip() == "m measurement  k constant"
    assert "m  4711k" in lines["bus",][-1]
    assert "4711k" not in lines["bus", "other"][-1]


def test_named_values_are_scaled(tmp_path: Path) -> None:
    """With a profile the map and the table show names and values, also names with blanks."""
    profile = tmp_path / "meter.toml"
    profile.write_text(
        'profile = 1\n[[registers]]\nat = "hr:0"\nname = "Room temperature"\n'
        'scale = 0.1\nunit = "°C"\n'
    )
    recording = tmp_path / "bus.hex"
    frames = (framed("010300000001"), framed("01030200d7"))
    recording.write_text("".join(f"{data.hex()}\n" for data in frames))
    settings = Settings(profiles=(parse_binding(f"1={profile}"),))
    run = FileRun([str(recording)], settings)
    state = LiveState(TableOptions(buses=(str(recording),)), run.stats)
    for batch in run.batches():
        state.put(batch)
    state.refresh()
    assert "Room temperature 21.5 °C" in text(map_lines(state, 80, 20)[1])
    assert text(table_lines(state, 132, 20)[1]).rstrip().endswith("Room temperature 21.5")
    assert text(table_lines(state, 80, 20)[1]).rstrip().endswith("21.5")


def test_a_mark_tells_registers_apart_by_what_they_did() -> None:
    """One goes up and down, one up and stays: two questions leave the first."""
    line = Line()
    state = LiveState(TableOptions("wire", "utc", ("bus",)), line.stats, clock=lambda: line.seconds)

    def read(first: int, second: int) -> None:
        for address, value in ((10, first), (11, second)):
            state.put(line.ask(1, address, value))
        state.refresh()

    read(100, 65_530)
    state.marked.mark(state.raw())
    read(105, 3)
    state.marked.keep("u", state.raw())
    assert {place[3] for place in state.marked.values} == {10, 11}
    read(101, 3)
    state.marked.keep("j", state.raw())
    assert [place[3] for place in state.marked.values] == [10]
    shown = ["".join(text for text, _ in parts) for parts in map_lines(state, 60, 20)]
    assert shown[0].startswith("1 candidate: went up, then went down")
    assert "hr" in shown[1]
    assert "101" in shown[1]
    assert "same" in shown[1]
