"""Raw recordings: every read with its time, segments, and what a kill at any moment leaves."""

from __future__ import annotations

import os
import pty
import random
import select
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from analyzer import UsageError
from analyzer.exports.recorder import (
    RecordedPort,
    Recorder,
    Retention,
    Rotation,
    parse_retention,
    parse_rotation,
)
from tests.conftest import command, environment, need_program
from tests.support.raw_recording import RTAC_HEAD, bytes_of, packets
from tests.support.tshark import fields

KILLS, AT_ONCE = 50, 10


@dataclass(frozen=True)
class Read:
    """What a port gave."""

    data: bytes
    time_ns: int
    errors: tuple[int, ...] = ()
    hole: bool = False


PORTS = (
    RecordedPort("bus one", None, "/dev/ttyUSB0", "19200-8E1"),
    RecordedPort("two", "A", "/dev/ttyUSB1", None),
    RecordedPort("two", "B", "/dev/ttyUSB2", None),
)


def test_every_read_is_a_block_with_its_time(tmp_path: Path) -> None:
    """Port, nanoseconds, bytes; holes and marked bytes."""
    path = tmp_path / "bus.pcapng"
    recorder = Recorder(str(path), PORTS)
    reads = [
        ("bus one", None, Read(b"\x01\x03", 1_700_000_000_123_456_789)),
        ("two", "B", Read(b"\x02", 1_700_000_000_123_456_790, (0,))),
        ("two", "A", Read(b"abc", 1_700_000_001_000_000_000, hole=True)),
    ]
    for bus, line, read in reads:
        recorder.write_read(bus, line, read)
        assert recorder.flush()
        # Nothing waits for the end.
        assert path.read_bytes().endswith(
            packets(path.read_bytes())[-1][3] + path.read_bytes()[-4:]
        )
    recorder.close()
    found = packets(path.read_bytes())
    assert [(port, moment) for port, moment, _, _ in found] == [
        (0, 1_700_000_000_123_456_789),
        (2, 1_700_000_000_123_456_790),
        (1, 1_700_000_001_000_000_000),
        (1, 1_700_000_001_000_000_000),
    ]  # fmt: skip
    payloads = [payload[RTAC_HEAD:] for _, _, payload, _ in found]
    # An empty read with the hole ends what came before it.
    assert payloads == [b"\x01\x03", b"\x02", b"", b"abc"]
    assert [payload[8] for _, _, payload, _ in found] == [2, 8, 6, 5]
    assert b"errors=0" in found[1][3]
    text = path.read_bytes()
    for words in (b"recording session=", b"recording bus=0 settings=19200-8E1 name=bus one",
                  b"recording bus=1 line=B name=two"):  # fmt: skip
        assert words in text


def test_wireshark_reads_it(tmp_path: Path) -> None:
    """A recording is read by tshark as RTAC serial with the names of the ports."""
    path = tmp_path / "bus.pcapng"
    recorder = Recorder(str(path), PORTS)
    recorder.write_read("two", "B", Read(b"\x01\x03\x00", 1_700_000_000_123_456_789))
    recorder.close()
    (packet,) = fields(
        path, ["frame.interface_name", "frame.time_epoch", "rtacser.eventtype", "data.data"]
    )
    assert packet["frame.interface_name"] == "/dev/ttyUSB2"
    assert packet["frame.time_epoch"] == "1700000000.123456789"
    assert packet["data.data"] == "010300"


def test_a_file_that_is_there_is_never_written_over(tmp_path: Path) -> None:
    """Where the file exists, each start writes a new segment."""
    path = tmp_path / "bus.pcapng"
    notify: list[str] = []
    for start in range(3):
        recorder = Recorder(str(path), PORTS)
        recorder.write_read("two", "A", Read(bytes([start]), 1))
        recorder.close()
        notify += recorder.take_messages()
    names = sorted(one.name for one in tmp_path.iterdir())
    assert names[0] == "bus.pcapng"
    assert [name[:10] for name in names[1:]] == ["bus_00001_", "bus_00002_"]
    first, *others = (bytes_of((tmp_path / name).read_bytes()) for name in names)
    assert [first, *others] == [b"\0", b"\1", b"\2"]
    assert notify[0] == f"recording to {path}"


def test_segments_by_size_and_how_many_are_kept(tmp_path: Path) -> None:
    """None is larger than said, the newest ones stay, nothing is lost between two."""
    path = tmp_path / "bus.pcapng"
    other = tmp_path / "bus_of_mine.pcapng"
    other.write_bytes(b"mine")
    recorder = Recorder(
        str(path), PORTS[:1], rotate=Rotation(bytes=2000), keep=Retention(segments=4)
    )
    sent = random.Random(1).randbytes(6000)
    for at in range(0, len(sent), 50):
        recorder.write_read("bus one", None, Read(sent[at : at + 50], at))
    recorder.close()
    segments = sorted(tmp_path.glob("bus_0*.pcapng"))
    assert len(segments) == 4
    assert all(one.stat().st_size <= 2000 for one in segments)
    kept = b"".join(bytes_of(one.read_bytes()) for one in segments)
    assert sent.endswith(kept)
    assert len(kept) > 3000
    assert other.read_bytes() == b"mine"


def test_segments_by_time_and_size_of_all(tmp_path: Path) -> None:
    """`--keep` is given as a size."""
    recorder = Recorder(
        str(tmp_path / "bus"), PORTS[:1], rotate=Rotation(seconds=1), keep=Retention(bytes=1500)
    )
    for second in range(6):
        recorder.write_read("bus one", None, Read(bytes([second]) * 200, second))
        assert recorder.flush()
        time.sleep(1.02)
    recorder.close()
    segments = sorted(tmp_path.glob("bus_0*.pcapng"))
    assert 1 < len(segments) < 5
    assert bytes_of(segments[-1].read_bytes()) == bytes([5]) * 200
    moment = time.strftime("%Y%m%d%H", time.gmtime())
    assert segments[-1].name.startswith(f"bus_00006_{moment}")


@pytest.mark.parametrize("text", ["", "x", "0", "10", "-5min", "5 parsecs"])
def test_words_that_mean_nothing(text: str) -> None:
    """Invalid values are reported with what the option takes."""
    with pytest.raises(UsageError, match="--rotate"):
        parse_rotation(text)
    if text != "10":
        with pytest.raises(UsageError, match="--keep"):
            parse_retention(text)


def test_keep_is_for_segments(tmp_path: Path) -> None:
    """`--keep` is refused without `--rotate`."""
    with pytest.raises(UsageError, match="add --rotate"):
        Recorder(str(tmp_path / "bus"), PORTS, keep=Retention(segments=1))


class Live:
    """`modlens tap --record` on a pseudo terminal with traffic."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._master, self._slave = pty.openpty()
        os.set_blocking(self._master, False)
        words = command("tap", os.ttyname(self._slave), "--line", "115200-8N1", "--record", path)
        self._tap = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment()
        )
        self.sent = b""

    def wait_until_it_records(self) -> None:
        """It says so, after saying that it listens."""
        assert self._tap.stderr is not None
        while b"recording to" not in (line := self._tap.stderr.readline()):
            assert line

    def send(self, data: bytes) -> None:
        """Put bytes on the line, as far as it takes them."""
        try:
            self.sent += data[: os.write(self._master, data)]
        except BlockingIOError:
            select.select([], [self._master], [], 0.01)

    def kill(self) -> bytes:
        """End it as the system would; gives the file."""
        self._tap.send_signal(signal.SIGKILL)
        self._tap.wait()
        assert self._tap.stderr is not None
        self._tap.stderr.close()
        os.close(self._master)
        os.close(self._slave)
        return self.path.read_bytes()


@pytest.mark.skipif(sys.platform != "linux", reason="ptys of Linux")
def test_a_recording_is_whole_after_a_kill_at_any_moment(tmp_path: Path) -> None:
    """Fifty taps, killed while bytes come in: each file opens and has all that was read before.

    What the tap had read is what the pseudo terminal had taken, less what still waited in it.
    """
    rng = random.Random(250)
    capinfos = need_program("capinfos")
    lengths = []
    for start in range(0, KILLS, AT_ONCE):
        taps = [Live(tmp_path / f"{number}.pcapng") for number in range(start, start + AT_ONCE)]
        for tap in taps:
            tap.wait_until_it_records()
        left = list(taps)
        while left:
            for tap in left:
                tap.send(rng.randbytes(rng.randrange(1, 300)))
            time.sleep(rng.random() * 0.004)
            if rng.random() < 0.3:
                tap = left.pop(rng.randrange(len(left)))
                data = tap.kill()
                found = bytes_of(data)
                assert tap.sent.startswith(found)
                # A pseudo terminal holds 4 KiB, a read takes as much.
                assert len(tap.sent) - len(found) <= 3 * 4096
                lengths.append(len(found))
    assert len(lengths) == KILLS
    assert sum(length > 0 for length in lengths) > KILLS * 3 // 4
    names = [str(one) for one in sorted(tmp_path.glob("*.pcapng"))]
    done = subprocess.run(
        [capinfos, "-c", *names], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.stdout.count("Number of packets") == KILLS, done.stderr


def test_a_recording_cut_anywhere_is_read_up_to_there(tmp_path: Path) -> None:
    """Every length of a file: whole blocks count, and tshark opens what is left."""
    path = tmp_path / "bus.pcapng"
    recorder = Recorder(str(path), PORTS[:1])
    for moment in range(4):
        recorder.write_read("bus one", None, Read(bytes([moment]) * 7, moment))
    recorder.close()
    data = path.read_bytes()
    whole = bytes_of(data)
    ends = [len(bytes_of(data[:length])) for length in range(len(data) + 1)]
    assert all(whole.startswith(bytes_of(data[:length])) for length in range(len(data) + 1))
    assert set(ends) == {0, 7, 14, 21, 28}
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes(data[: ends.index(21) + 5])
    done = subprocess.run(
        [need_program("tshark"), "-r", str(cut)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert len(done.stdout.splitlines()) == 3


def test_a_port_may_join_later(tmp_path: Path) -> None:
    """Its settings had to be found; Wireshark knows its name, and each segment has all ports."""
    path = tmp_path / "bus.pcapng"
    recorder = Recorder(str(path), [], rotate=Rotation(bytes=400))
    late = RecordedPort("late", None, "/dev/ttyUSB7", "9600-8N1")
    recorder.add_port(PORTS[0])
    recorder.write_read("bus one", None, Read(b"\x01", 1))
    recorder.add_port(late)
    for at in range(6):
        recorder.write_read("late", None, Read(b"\x02" * 40, 2 + at))
        recorder.write_read("bus one", None, Read(b"\x03", 2 + at))
    recorder.close()
    segments = sorted(tmp_path.glob("*.pcapng"))
    assert len(segments) > 1
    for segment in segments:
        for packet in fields(segment, ["frame.interface_name", "data.data"]):
            named = "/dev/ttyUSB7" if packet["data.data"].startswith("02") else "/dev/ttyUSB0"
            assert packet["frame.interface_name"] == named
