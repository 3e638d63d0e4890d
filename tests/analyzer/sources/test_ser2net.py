"""A real ser2net between a line and modlens: the network and its trace have the same rows.

Not by RFC 2217: ser2net does not answer for RTS and DTR, which a pseudo terminal has not.
"""

from __future__ import annotations

import os
import pty
import socket
import subprocess
import time
import tty
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from analyzer import decode
from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from tests.conftest import need_program

REQUEST, RESPONSE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")
COUNT = 5


class Gateway:
    """Ser2net on a free port of loopback, with a pseudo terminal as its line."""

    def __init__(self, folder: Path) -> None:
        self.line, slave = pty.openpty()
        tty.setraw(slave)
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.port = probe.getsockname()[1]
        self.trace = folder / "trace.txt"
        config = folder / "ser2net.yaml"
        config.write_text(
            "%YAML 1.1\n---\nconnection: &one\n"
            f"  accepter: tcp,127.0.0.1,{self.port}\n"
            f"  connector: serialdev,{os.ttyname(slave)},9600n81,local\n"
            f"  options:\n    trace-both: {self.trace}\n"
            "    trace-both-hexdump: true\n    trace-both-timestamp: true\n"
        )
        program = need_program("ser2net")
        self._slave = slave
        self._running = subprocess.Popen(
            [program, "-n", "-d", "-c", str(config)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        end = time.monotonic() + 10
        while True:
            with socket.socket() as probe_socket:
                if probe_socket.connect_ex(("127.0.0.1", self.port)) == 0:
                    break
            assert time.monotonic() < end
            time.sleep(0.05)
        time.sleep(0.3)  # the probe's connection has to end first: ser2net allows one

    def send(self) -> None:
        """A request and its response on the line, as others on the bus send them."""
        for part in (REQUEST, RESPONSE):
            os.write(self.line, part)
            time.sleep(0.02)

    def close(self) -> None:
        """End the program."""
        self._running.kill()
        self._running.wait()
        os.close(self.line)
        os.close(self._slave)


@pytest.fixture
def gateway(tmp_path: Path) -> Iterator[Gateway]:
    one = Gateway(tmp_path)
    yield one
    one.close()


def test_live_and_trace_have_the_rows_of_the_line(gateway: Gateway) -> None:
    """What the tap hears over the network, and what ser2net wrote down of it."""
    found: list[Any] = []
    with closing(LiveRun([f"socket://127.0.0.1:{gateway.port}"], Settings())) as run:
        for turn, batch in enumerate(run.batches()):
            found += batch.transactions
            if len(found) == COUNT:
                break
            if turn % 4 == 3 and turn < COUNT * 4:
                gateway.send()
            assert turn < 400
    rows = [(row.unit, row.function, row.address, row.data, row.status) for row in found]
    assert rows == [(1, 3, 0, [7], "ok")] * COUNT
    traced = decode(gateway.trace).transactions
    assert [(r.unit, r.function, r.address, r.data, r.status) for r in traced] == rows
