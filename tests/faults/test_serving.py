"""A tap passes its line on: another tap, dumpcap and curl see what the first recording holds.

Real processes and a pseudo terminal that is saturated at 115200 baud, with one client that reads
nothing and one that vanishes.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from tests.conftest import ROOT, command, environment, need_program
from tests.support.raw_recording import bytes_of, packets
from tests.support.tapped_line import PAIR, TappedLine

SETTLE_S = 20.0
TOKEN = "a-token-of-sixteen-or-more"

# 115200 baud, ten bits a character: 15 bytes in 1.302 ms.
PAIRS_IN_A_BURST, BURST_S = 10, 0.01302


@contextlib.contextmanager
def running(*words: str | Path, token: str | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """A program that is ended afterwards, as by Ctrl-C."""
    env = environment() | ({} if token is None else {"MODLENS_SERVE_TOKEN": token})
    silent = subprocess.DEVNULL
    one = subprocess.Popen(
        list(map(str, words)), stdout=silent, stderr=subprocess.PIPE, env=env, cwd=ROOT
    )
    try:
        yield one
    finally:
        if one.poll() is None:
            one.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            one.wait(SETTLE_S)
        one.kill()
        one.communicate()


def address_of(line: TappedLine) -> str:
    """Where the tap serves."""
    line.wait_for("serving the line at ")
    found = re.search(r"serving the line at (127\.0\.0\.1:\d+)", line.saying())
    assert found is not None
    return found[1]


def wait_until(what: str, is_there: Any) -> None:
    """Wait for something that comes soon."""
    end = time.monotonic() + SETTLE_S
    while not is_there():
        assert time.monotonic() < end, what
        time.sleep(0.05)


def count_of(path: Path) -> int:
    """How many lines a file has that may not be there yet."""
    return path.read_text().count("\n") if path.exists() else 0


def test_all_streams_hold_the_bytes_of_the_first_recording(tmp_path: Path) -> None:
    """On a saturated line; what the others do costs the first recording nothing."""
    dumpcap = need_program("dumpcap")
    first, second, third = (tmp_path / f"{name}.pcapng" for name in ("first", "second", "third"))
    rows = tmp_path / "second.jsonl"
    with TappedLine("--serve", "0", "--record", first, "-o", tmp_path / "first.jsonl") as line:
        line.start()
        address = address_of(line)
        host, port = address.split(":")
        stalled = socket.create_connection((host, int(port)))
        vanishing = socket.create_connection((host, int(port)))
        tap = command("tap", f"modlens://{address}", "--record", second, "-o", rows)
        with running(*tap) as other, running(dumpcap, "-q", "-i", f"TCP@{address}", "-w", third):
            for client in range(4):
                line.wait_for("serving 127.0.0.1:", SETTLE_S)
                wait_until(
                    f"client {client}",
                    lambda n=client: line.saying().count("serving 127.0.0.1:") > n,
                )
            line.send(1.0, PAIRS_IN_A_BURST, BURST_S)
            vanishing.close()
            line.send(4.0, PAIRS_IN_A_BURST, BURST_S)
            for path in (first, second, third):
                wait_until(
                    f"{path.name} is complete",
                    lambda path=path: path.exists() and bytes_of(path.read_bytes()) == line.sent,
                )
            other.send_signal(signal.SIGTERM)
            assert other.wait(SETTLE_S) == 0
        line.end()
        stalled.close()
    assert len(line.sent) > 30_000
    one, two = (
        (tmp_path / f"{name}.jsonl").read_text().splitlines() for name in ("first", "second")
    )
    keys = ("unit", "function", "address", "data", "status", "response_time_us", "time")
    picked = [
        [[row.get(key) for key in keys] for row in map(json.loads, rows)] for rows in (one, two)
    ]
    assert picked[0] == picked[1]
    assert len(picked[0]) == len(line.sent) // len(PAIR)
    # Dumpcap's file has the blocks of the recording, but for the one that says that the tap ended.
    *blocks, _ = (found[1:3] for found in packets(first.read_bytes()))
    assert [found[1:3] for found in packets(third.read_bytes())] == blocks


def test_a_bus_on_two_lines_has_the_rows_of_the_first_tap(tmp_path: Path) -> None:
    """Requests on A, responses on B; the second recording names both lines, too."""
    first, second = tmp_path / "first.jsonl", tmp_path / "second.jsonl"
    raw = tmp_path / "second.pcapng"
    with TappedLine("--serve", "0", "-o", first, two_lines=True) as line:
        line.start()
        tap = command("tap", f"modlens://{address_of(line)}", "--record", raw, "-o", second)
        with running(*tap) as other:
            line.wait_for("serving 127.0.0.1:")
            line.send(2.0, pairs=1, pause_s=0.01)
            line.end()
            wait_until("the rows", lambda: count_of(second) == count_of(first))
            other.send_signal(signal.SIGTERM)
            assert other.wait(SETTLE_S) == 0
    rows, others = (
        [json.loads(row) for row in path.read_text().splitlines()] for path in (first, second)
    )
    assert [row | {"bus": "", "source": ""} for row in rows] == [
        row | {"bus": "", "source": ""} for row in others
    ]
    assert len(rows) == len(line.sent) // len(PAIR) > 50
    assert {(row["unit"], row["status"], tuple(row["data"])) for row in rows} == {(1, "ok", (7,))}
    text = raw.read_bytes()
    assert b"line=A" in text
    assert b"line=B" in text


def test_other_computers_need_the_token(tmp_path: Path) -> None:
    """A wrong one is refused, and the right one is taken from the environment."""
    token = tmp_path / "token"
    token.write_text(f"{TOKEN}\n")
    second = tmp_path / "second.pcapng"
    with TappedLine("--serve", "127.0.0.1:0", "--serve-token-file", token) as line:
        line.start()
        address = address_of(line)
        tap = command("tap", f"modlens://{address}", "--record", second)
        with running(*tap) as stranger:
            assert stranger.wait(SETTLE_S) == 4
        with running(*tap, token=TOKEN):
            line.wait_for("serving 127.0.0.1:")
            line.send(0.2)
            wait_until("all is there", lambda: bytes_of(second.read_bytes()) == line.sent)
        curl = f"GET / HTTP/1.1\r\nAuthorization: Bearer {TOKEN}x\r\n\r\n"
        host, port = address.split(":")
        with socket.create_connection((host, int(port))) as asking:
            asking.sendall(curl.encode())
            assert asking.recv(100).startswith(b"HTTP/1.1 401 ")
        line.end()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--serve", "0.0.0.0:0"], "set a token"),
        (["--serve", "gateway:4010"], "write a port as 4010"),
        (["--serve-token-file", "x"], "needs --serve"),
    ],
)
def test_wrong_use_is_explained(words: list[str], said: str) -> None:
    """With the exit status of wrong use, before anything listens."""
    with TappedLine(*words) as line:
        process = line.start()
        assert process.wait(SETTLE_S) == 2
        line.end()
        assert said in line.said


def test_the_second_tap_waits_for_the_first_to_return(tmp_path: Path) -> None:
    """The first tap ends and comes back at its port; the gap is a hole, and the rest is there."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    rows = tmp_path / "rows.jsonl"
    with contextlib.ExitStack() as opened:
        line = opened.enter_context(TappedLine("--serve", str(port)))
        line.start()
        address = address_of(line)
        second = opened.enter_context(running(*command("tap", f"modlens://{address}", "-o", rows)))
        line.wait_for("serving 127.0.0.1:")
        line.send(0.2)
        wait_until("rows", lambda: rows.exists() and rows.read_text().count("\n") >= 10)
        line.end()
        before = rows.read_text().count("\n")
        line.start()
        wait_until("it is back", lambda: line.saying().count("serving 127.0.0.1:") >= 2)
        line.send(0.2)
        wait_until("more rows", lambda: rows.read_text().count("\n") >= before + 10)
        line.end()
        os.kill(second.pid, signal.SIGTERM)
        assert second.wait(SETTLE_S) == 0
