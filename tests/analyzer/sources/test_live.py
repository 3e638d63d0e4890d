"""Several ports at once."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import ExitStack, closing

import pytest

from analyzer import PortError
from analyzer.line import Line
from analyzer.sources.live import arrivals
from analyzer.sources.serial import Port

if sys.platform == "win32":
    pytest.skip("pseudo terminals", allow_module_level=True)

import pty
import tty


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_comes_in_has_its_port_and_its_time(count: int) -> None:
    """Each port's bytes, in order of arrival; silence in between is told; no thread stays."""
    before = threading.active_count()
    with ExitStack() as opened:
        pairs = [pty.openpty() for _ in range(count)]
        for _, near in pairs:
            tty.setraw(near)
        names = [os.ttyname(near) for _, near in pairs]
        ports = [opened.enter_context(Port(name, Line(19200))) for name in names]
        received: list[tuple[int, bytes]] = []
        times = []
        with closing(arrivals(ports, 0.02)) as arriving:
            for number, (far, _) in enumerate(pairs):
                os.write(far, bytes([number]))
                for arrival in arriving:
                    if arrival is not None:
                        received.append((arrival[0], arrival[1].data))
                        times.append(arrival[1].time_ns)
                        break
            assert next(arriving) is None
        assert received == [(number, bytes([number])) for number in range(count)]
        assert times == sorted(times)
        for pair in pairs:
            os.close(pair[0])
            os.close(pair[1])
    assert threading.active_count() == before


def test_the_loss_of_one_port_is_told() -> None:
    """By its name, whichever it is."""
    lost, near = pty.openpty()
    other, other_near = pty.openpty()
    name = os.ttyname(near)
    ports = [Port(os.ttyname(other_near), Line(19200)), Port(name, Line(19200))]
    os.close(near)
    os.close(lost)
    with pytest.raises(PortError, match=name), closing(arrivals(ports, 0.02)) as arriving:
        for _ in arriving:
            pass
    for port in ports:
        port.close()
    os.close(other)
    os.close(other_near)
