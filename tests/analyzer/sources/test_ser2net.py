"""A real ser2net between a line and modlens: rows are those of a tap on the line, row by row."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from analyzer import decode
from tests.conftest import ROOT, need_program
from tests.support.gateway_programs import free_port
from tests.support.ptybus import PtyBus
from tests.support.side_by_side import (
    MASTER,
    UNIT,
    WHOLE,
    Differences,
    Heard,
    differences,
    poll,
    row_of,
)

WRITE_ONE = 6
"""The function whose response repeats the request."""
MODEM_LINES = ROOT / "tests" / "support" / "modem_lines.c"


@contextlib.contextmanager
def gateway(
    folder: Path, accepter: str, line: str, *options: str, preload: str = ""
) -> Iterator[int]:
    """Ser2net on a free port of loopback; gives the port. `options` are those of the connection."""
    port = free_port()
    config = [
        "%YAML 1.1",
        "---",
        "connection: &one",
        f"  accepter: {accepter},127.0.0.1,{port}",
        f"  connector: serialdev,{line},19200n81,local",
        *(["  options:", *(f"    {one}" for one in options)] if options else []),
    ]
    path = folder / f"{port}.yaml"
    path.write_text("\n".join([*config, ""]))
    silent = subprocess.DEVNULL
    running = subprocess.Popen(
        [need_program("ser2net"), "-n", "-d", "-c", str(path)],
        env=os.environ | {"LD_PRELOAD": preload},
        stdout=silent,
        stderr=silent,
    )
    try:
        end = time.monotonic() + 10
        while True:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            assert time.monotonic() < end
            time.sleep(0.05)
        time.sleep(0.3)  # the probe's connection has to end first: ser2net allows one
        yield port
    finally:
        running.kill()
        running.wait()


@pytest.fixture
def modem_lines(tmp_path: Path) -> str:
    """A library that gives pseudo terminals modem lines: ser2net's RFC 2217 asks for them."""
    library = str(tmp_path / "modem_lines.so")
    words = [need_program("cc"), "-shared", "-fPIC", str(MODEM_LINES), "-o", library, "-ldl"]
    subprocess.run(words, check=True)
    return library


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial calls them
def test_all_ways_have_the_rows_of_the_line(tmp_path: Path, modem_lines: str) -> None:
    """Raw TCP, RFC 2217 and ser2net's trace, at once; ser2net writes nothing to the line."""
    trace = tmp_path / "trace.txt"
    options = [
        f"trace-both: {trace}", "trace-both-hexdump: true", "trace-both-timestamp: true",
    ]  # fmt: skip
    with (
        PtyBus([MASTER, UNIT, "tap", "raw", "2217"], 19200, 10, trigger=WHOLE) as bus,
        gateway(tmp_path, "tcp", bus.path("raw"), *options) as raw,
        gateway(tmp_path, "telnet(rfc2217),tcp", bus.path("2217"), preload=modem_lines) as telnet,
        Heard(f"{bus.path('tap')}@19200-8N1") as direct,
        Heard(f"socket://127.0.0.1:{raw}") as over_tcp,
        Heard(f"rfc2217://127.0.0.1:{telnet}@19200-8N1") as over_2217,
    ):
        count = poll(bus, seconds=4.0)
        for one in (direct, over_tcp, over_2217):
            one.wait_for(count - 1)
        time.sleep(0.5)
        senders = {sent.sender for sent in bus.truth}
    assert len(direct.rows) == count > 40
    assert differences(direct.rows, over_tcp.rows) == Differences()
    assert differences(direct.rows, over_2217.rows) == Differences()
    # Whole seconds do not show that a request of the last second was given up.
    given_up = {"not_observed": "no_response"}
    traced = [row_of(row) for row in decode(trace).transactions]
    traced = [(*row, given_up.get(status, status)) for *row, status in traced]
    found = differences(direct.rows, traced)
    # Where the second changes between two equal frames, a repetition is as likely as a response.
    # It makes two rows of one at most.
    assert len(found.missing) <= 1
    assert len(found.extra) <= 2 * len(found.missing)
    assert found.is_in_order
    assert {function for _, function, *_ in (*found.missing, *found.extra)} <= {WRITE_ONE}
    assert senders == {MASTER, UNIT}
