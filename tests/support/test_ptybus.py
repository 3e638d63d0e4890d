"""The pty bus: pacing, no echo to the sender, and a correct recording.

Only lower bounds of times are asserted: a busy machine may be late, never early.
"""

from __future__ import annotations

import json
import os
import select
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.ptybus import BusError, ChunkLogRecorder, PtyBus, chunk_line, flip_bit

REQUEST = bytes.fromhex("110100130025 0e84")
RESPONSE = bytes.fromhex("110105cd6bb20e1b45e6")
CHAR_19200_8E1_NS = 11 * 1_000_000_000 // 19200


@contextmanager
def opened(path: str) -> Iterator[int]:
    """Open a pty for reading and writing, as a serial port would be."""
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        yield port
    finally:
        os.close(port)


def received(port: int, count: int) -> bytes:
    """Read exactly `count` bytes, each within ten seconds."""
    data = b""
    while len(data) < count:
        assert select.select([port], [], [], 10.0)[0], f"only {data.hex()} of {count} bytes came"
        data += os.read(port, count - len(data))
    return data


def waiting(port: int) -> bool:
    """Say whether there is something to read now."""
    return bool(select.select([port], [], [], 0)[0])


def test_everybody_else_hears_what_one_sends() -> None:
    """Bytes go to all others, unchanged (CR, LF, XON and control characters too)."""
    data = bytes(range(256))
    with PtyBus(["master", "unit1", "tap"], baud=115200) as bus:
        with opened(bus.path("master")) as master, opened(bus.path("unit1")) as unit:
            with opened(bus.path("tap")) as tap:
                os.write(master, data)
                assert received(unit, len(data)) == data
                assert received(tap, len(data)) == data


def test_nobody_hears_itself() -> None:
    """The sender's own port stays silent, and so it is for the one who answers."""
    with PtyBus(["master", "unit1"]) as bus:
        with opened(bus.path("master")) as master, opened(bus.path("unit1")) as unit:
            os.write(master, REQUEST)
            assert received(unit, len(REQUEST)) == REQUEST
            os.write(unit, RESPONSE)
            assert received(master, len(RESPONSE)) == RESPONSE
            bus.wait_idle(len(REQUEST + RESPONSE))
            assert not waiting(master)
            assert not waiting(unit)


@pytest.mark.parametrize(("baud", "char_bits"), [(19200, 11), (9600, 10), (1200, 10)])
def test_a_byte_arrives_after_its_stop_bit(baud: int, char_bits: int) -> None:
    """The n-th byte does not arrive before n character times have passed."""
    char_ns = char_bits * 1_000_000_000 // baud
    with PtyBus(["master", "unit1"], baud, char_bits) as bus:
        with opened(bus.path("master")) as master, opened(bus.path("unit1")) as unit:
            start_ns = time.monotonic_ns()
            os.write(master, REQUEST)
            for number in range(1, len(REQUEST) + 1):
                received(unit, 1)
                assert time.monotonic_ns() - start_ns >= number * char_ns


def test_a_chunk_never_comes_before_the_last_stop_bit_of_the_truth() -> None:
    """Bytes at 19200 8E1 take 0.57 ms each; the chunks' times fit the truth's."""
    with PtyBus(["master", "tap"]) as bus, ChunkLogRecorder(bus.path("tap")) as recorder:
        with opened(bus.path("master")) as master:
            os.write(master, REQUEST * 4)
            recorder.wait_for(len(REQUEST) * 4)
            bus.wait_idle(len(REQUEST) * 4)
        sent = bus.truth[0]
        assert b"".join(one.data for one in bus.truth) == REQUEST * 4
    count = 0
    for time_ns, data in recorder.chunks:
        count += len(data)
        assert time_ns >= sent.time_ns + count * CHAR_19200_8E1_NS
    assert sent.end_ns - sent.time_ns == len(sent.data) * CHAR_19200_8E1_NS


def test_the_chunk_log_equals_the_truth(tmp_path: Path) -> None:
    """Joined, the log's lines are the bytes that the line carried; its times never run back."""
    log = tmp_path / "bus.jsonl"
    with PtyBus(["master", "unit1", "tap"], trigger=8) as bus:
        with opened(bus.path("master")) as master, opened(bus.path("unit1")) as unit:
            with ChunkLogRecorder(bus.path("tap"), log) as recorder:
                for _ in range(3):
                    os.write(master, REQUEST)
                    received(unit, len(REQUEST))
                    os.write(unit, RESPONSE)
                    received(master, len(RESPONSE))
                recorder.wait_for(3 * len(REQUEST + RESPONSE))
        truth = bus.truth
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert bytes.fromhex("".join(line["hex"] for line in lines)) == recorder.data
    assert b"".join(sent.data for sent in truth) == recorder.data == (REQUEST + RESPONSE) * 3
    assert [sent.sender for sent in truth] == ["master", "unit1"] * 3
    times = [line["t"] for line in lines]
    assert times == sorted(times)
    assert all(sent.end_ns / 1e9 <= times[-1] for sent in truth)


def test_a_tap_that_writes_shows_in_the_truth() -> None:
    """The bus would tell on a tap that is not passive."""
    with PtyBus(["master", "tap"]) as bus, opened(bus.path("tap")) as tap:
        os.write(tap, b"\x00")
        bus.wait_idle(1)
        assert [sent.sender for sent in bus.truth] == ["tap"]


def test_one_who_writes_while_another_sends_waits() -> None:
    """There are no collisions: transmissions follow each other, with the turnaround silence."""
    with PtyBus(["master", "unit1"], turnaround_chars=3.5) as bus:
        with opened(bus.path("master")) as master, opened(bus.path("unit1")) as unit:
            os.write(master, REQUEST)
            received(unit, 1)
            os.write(unit, RESPONSE)
            bus.wait_idle(len(REQUEST + RESPONSE))
        request, response = bus.truth
        assert (request.sender, response.sender) == ("master", "unit1")
        assert response.time_ns - request.end_ns >= 3.5 * bus.char_ns - 1


def test_units_of_a_four_wire_line_hear_the_master_only() -> None:
    """`hears` keeps units from receiving each other, but not the tap and the master."""
    names = ["master", "unit1", "unit2", "tap"]
    hears = {"unit1": ["master"], "unit2": ["master"]}
    with PtyBus(names, hears=hears) as bus, ChunkLogRecorder(bus.path("tap")) as recorder:
        with opened(bus.path("unit1")) as unit1, opened(bus.path("unit2")) as unit2:
            os.write(unit1, RESPONSE)
            recorder.wait_for(len(RESPONSE))
            bus.wait_idle(len(RESPONSE))
            assert recorder.data == RESPONSE
            assert not waiting(unit2)


def test_noise_flipped_bits_and_lost_answers() -> None:
    """What disturbs the line is in the truth beside what was written."""

    def disturb(sender: str, written: bytes) -> bytes:
        return flip_bit(written, 9) if sender == "master" else b""

    with PtyBus(["master", "unit1", "tap"], disturb=disturb) as bus:
        with ChunkLogRecorder(bus.path("tap")) as recorder, opened(bus.path("unit1")) as unit:
            bus.inject(b"\xff\x00")
            bus.wait_idle(2)
            with opened(bus.path("master")) as master:
                os.write(master, REQUEST)
                damaged = received(unit, 2 + len(REQUEST))
                os.write(unit, RESPONSE)
                os.write(master, REQUEST)
                received(unit, len(REQUEST))
            recorder.wait_for(2 + 2 * len(REQUEST))
        truth = bus.truth
    assert damaged == b"\xff\x00" + flip_bit(REQUEST, 9)
    assert REQUEST[1] ^ flip_bit(REQUEST, 9)[1] == 0x02
    assert truth[0].sender == "noise"
    lost = [sent for sent in truth if sent.sender == "unit1"]
    assert [(sent.data, sent.written) for sent in lost] == [(b"", RESPONSE)]
    assert recorder.data == b"".join(sent.data for sent in truth)


def test_a_full_pty_loses_bytes_and_counts_them() -> None:
    """A participant that never reads does not stop the line."""
    with PtyBus(["master", "unit1", "tap"], baud=10_000_000) as bus:
        total = 0
        while not bus.lost["tap"]:
            bus.inject(bytes(4096))
            total += 4096
            bus.wait_idle(total)
            assert total < 1 << 22, "nothing was lost"


def test_a_broken_disturbance_is_reported() -> None:
    """An error in the bus thread reaches those who wait, and whoever closes the bus."""

    def disturb(sender: str, written: bytes) -> bytes:
        raise RuntimeError(sender)

    bus = PtyBus(["master"], disturb=disturb).__enter__()
    with opened(bus.path("master")) as master:
        os.write(master, b"x")
        with pytest.raises(BusError, match="broke down") as caught:
            bus.wait_idle(1)
    assert isinstance(caught.value.__cause__, RuntimeError)
    with pytest.raises(BusError, match="broke down"):
        bus.__exit__(None, None, None)


def test_closing_leaves_neither_threads_nor_files() -> None:
    """A hundred buses later there are as many threads and open files as before."""
    threads, files = threading.active_count(), len(os.listdir("/proc/self/fd"))
    for _ in range(100):
        with PtyBus(["master", "tap"]) as bus, ChunkLogRecorder(bus.path("tap")):
            bus.inject(b"x")
    assert threading.active_count() == threads
    assert len(os.listdir("/proc/self/fd")) == files


def test_waiting_has_an_end() -> None:
    """Both waits time out, and report what is missing."""
    with PtyBus(["tap"]) as bus, ChunkLogRecorder(bus.path("tap")) as recorder:
        with pytest.raises(TimeoutError, match="5 bytes carried"):
            bus.wait_idle(5, timeout=0.01)
        with pytest.raises(TimeoutError, match="5 bytes did not come"):
            recorder.wait_for(5, timeout=0.01)


@pytest.mark.parametrize(
    ("names", "hears"), [(["a", "a"], {}), (["a"], {"b": ["a"]}), (["a"], {"a": ["b"]})]
)
def test_wrong_names_are_refused(names: list[str], hears: dict[str, list[str]]) -> None:
    """A participant that is named twice, or is unknown, is refused."""
    with pytest.raises(ValueError, match=r"twice|not on the bus"):
        PtyBus(names, hears=hears)


def test_a_chunk_line_is_never_early() -> None:
    """Microseconds are rounded up, and written in full."""
    assert chunk_line(1_697_041_234_000_000_001, b"\x01\xff") == (
        '{"t": 1697041234.000001, "hex": "01ff"}\n'
    )
    assert chunk_line(999_999_001, b"") == '{"t": 1.000000, "hex": ""}\n'
