"""Several ports at once, in order of arrival, whatever happens to them."""

from __future__ import annotations

import os
import sys
import threading
import time
from contextlib import closing
from pathlib import Path

import pytest

from analyzer import PortError
from analyzer.line import Line
from analyzer.sources import port_listener as live_module
from analyzer.sources.port_listener import PortListener, TappedPort
from analyzer.sources.serial import Chunk, Port

if sys.platform == "win32":
    pytest.skip("pseudo terminals", allow_module_level=True)

import pty
import tty

LINE = Line(19200)
S = 10**9


class FarEnd:
    """The far end of a line whose near end can go away and come back under one name."""

    def __init__(self, link: Path) -> None:
        """Plug it in."""
        self.link = link
        self.plug()

    def plug(self) -> None:
        """A new pty after the name."""
        self.far, near = pty.openpty()
        tty.setraw(near)
        os.symlink(os.ttyname(near), self.link)
        self._near = near

    def pull(self) -> None:
        """The name goes, then what followed it."""
        self.link.unlink()
        os.close(self._near)
        os.close(self.far)


def gather(listening: PortListener, count: int, patience: float = 5.0) -> list[tuple[int, Chunk]]:
    """So many bytes, or what came in time."""
    until = time.monotonic() + patience
    found: list[tuple[int, Chunk]] = []
    while sum(len(chunk.data) for _, chunk in found) < count and time.monotonic() < until:
        found += listening.take(0.02)
    return found


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_comes_in_has_its_port_and_its_time(count: int, tmp_path: Path) -> None:
    """The bytes of each port come in order of arrival with the silences; no thread stays."""
    before = threading.active_count()
    ends = [FarEnd(tmp_path / f"tty{number}") for number in range(count)]
    tapped = [TappedPort(str(end.link), LINE) for end in ends]
    received: list[tuple[int, Chunk]] = []
    with closing(PortListener(tapped, pytest.fail)) as listening:
        for number, end in enumerate(ends):
            os.write(end.far, bytes([number]))
            received += gather(listening, 1)
            assert listening.take(0.02) == []
    assert [(number, chunk.data) for number, chunk in received] == [
        (number, bytes([number])) for number in range(count)
    ]
    times = [chunk.time_ns for _, chunk in received]
    assert times == sorted(times)
    assert abs(times[-1] - time.time_ns()) < 10**9
    assert threading.active_count() == before
    for end in ends:
        end.pull()


def test_the_far_end_closes_and_returns_twenty_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was received is there, the hole is marked each time, the other port goes on."""
    monkeypatch.setattr(live_module, "FIRST_RETRY_NS", 1_000_000)
    monkeypatch.setattr(live_module, "RETRY_INTERVAL_NS", 10_000_000)
    end, other = FarEnd(tmp_path / "ttyA"), FarEnd(tmp_path / "ttyB")
    said: list[str] = []
    received: list[tuple[int, Chunk]] = []
    tapped = [TappedPort(str(one.link), LINE) for one in (end, other)]
    with closing(PortListener(tapped, said.append)) as listening:
        for turn in range(20):
            os.write(end.far, bytes([turn, turn]))
            os.write(other.far, bytes([turn]))
            received += gather(listening, 3)
            end.pull()
            while listening.reconnects == turn:
                received += listening.take(0.01)
                if not end.link.is_symlink() and len(said) == 2 * turn + 1:
                    end.plug()
        os.write(end.far, b"end")
        received += gather(listening, 3)
    first = b"".join(chunk.data for number, chunk in received if number == 0)
    assert first == b"".join(bytes([turn, turn]) for turn in range(20)) + b"end"
    assert b"".join(chunk.data for number, chunk in received if number) == bytes(range(20))
    holes = [
        chunk.data[0] for number, chunk in received if number == 0 and chunk.hole and chunk.data
    ]
    assert holes == [*range(1, 20), ord("e")]
    assert sum("waiting for it to return" in line for line in said) == 20
    assert sum("back after" in line for line in said) == 20
    end.pull()
    other.pull()


def test_without_waiting_the_loss_of_one_port_is_reported(tmp_path: Path) -> None:
    """Without reconnecting, the loss of any port raises an error with its name."""
    end, other = FarEnd(tmp_path / "ttyA"), FarEnd(tmp_path / "ttyB")
    tapped = [TappedPort(str(other.link), LINE), TappedPort(str(end.link), LINE)]
    with closing(PortListener(tapped, pytest.fail, reconnect=False)) as listening:
        end.pull()
        with pytest.raises(PortError, match="ttyA"):
            gather(listening, 1)
    other.pull()


def test_a_port_that_cannot_be_opened_leaves_none_open(tmp_path: Path) -> None:
    """If one port cannot be opened, the others are closed again."""
    end = FarEnd(tmp_path / "ttyA")
    tapped = [TappedPort(str(end.link), LINE), TappedPort(str(tmp_path / "none"), LINE)]
    with pytest.raises(PortError, match="no such port"):
        PortListener(tapped, pytest.fail)
    PortListener(tapped[:1], pytest.fail).close()
    end.pull()


def test_overruns_are_reported_and_marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The driver's counter grows: bytes are missing. Counts from before the tap do not count."""
    monkeypatch.setattr(live_module, "CHECK_INTERVAL_NS", 0)
    counts = [{"overrun": 7, "parity": 2}, {"overrun": 7, "parity": 3}, {"overrun": 9, "parity": 3}]
    monkeypatch.setattr(Port, "counters", lambda _: counts.pop(0) if len(counts) > 1 else counts[0])
    end = FarEnd(tmp_path / "ttyA")
    said: list[str] = []
    with closing(PortListener([TappedPort(str(end.link), LINE)], said.append)) as listening:
        for _ in range(3):
            listening.take(0.0)
        os.write(end.far, b"x")
        ((_, chunk),) = gather(listening, 1)
        error_counts = listening.error_counts(0)
    assert chunk.hole
    assert error_counts == {"overrun": 2, "parity": 1}
    assert [line for line in said if "overrun" in line] == [
        f"{end.link}: the driver lost bytes 2 times (overrun)"
    ]
    end.pull()


def test_a_sleep_of_the_machine_is_a_hole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody knows what was on the line meanwhile; times are those of the wall at once."""
    monkeypatch.setattr(live_module, "CHECK_INTERVAL_NS", 0)
    end, said = FarEnd(tmp_path / "ttyA"), list[str]()
    tapped = [TappedPort(str(end.link), LINE)]
    with closing(PortListener(tapped, said.append)) as listening:
        listening._inbox.pretend(3600 * S, 3600 * S)
        listening.take(0.0)
        os.write(end.far, b"x")
        ((_, chunk),) = gather(listening, 1)
    assert chunk.hole
    assert abs(chunk.time_ns - time.time_ns() - 3600 * S) < S
    assert said == ["the machine slept for 3600.0 s; traffic in the meantime is lost"]
    end.pull()


def test_a_clock_that_is_set_forward_is_no_hole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line went on: times follow when nothing is under way on it, and not before."""
    monkeypatch.setattr(live_module, "CHECK_INTERVAL_NS", 0)
    end, said = FarEnd(tmp_path / "ttyA"), list[str]()
    tapped = [TappedPort(str(end.link), LINE)]
    times = []
    with closing(PortListener(tapped, said.append, idle_ns=S // 5)) as listening:
        os.write(end.far, b"a")
        gather(listening, 1)
        listening._inbox.pretend(3600 * S, 0)
        for pause in (0.0, 0.05, 0.4):
            time.sleep(pause)
            listening.take(0.0)
            os.write(end.far, b"x")
            ((_, chunk),) = gather(listening, 1)
            assert not chunk.hole
            times.append(round((chunk.time_ns - time.time_ns()) / S))
    assert times == [0, 0, 3600]
    assert said == [
        "the clock was set forward by 3600.0 s; timestamps follow at the next pause on the line"
    ]
    end.pull()
