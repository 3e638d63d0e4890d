"""The recorder waits for nobody: stalled readers, frozen terminals, full disks, folders, others.

Real processes, pseudo terminals and pipes. A disk is made full by a limit of the file size, which
needs no mount.
"""

from __future__ import annotations

import itertools
import json
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from analyzer.exports.recorder import RecordedPort, Recorder, Retention, Rotation
from tests.conftest import ROOT, command, environment
from tests.support.raw_recording import bytes_of, packets
from tests.support.tapped_line import TappedLine

PORT = RecordedPort("bus", None, "/dev/ttyUSB0", None)
SETTLE_S = 10.0
PROMPT_S = 5.0


@dataclass(frozen=True)
class Read:
    """What a port gave."""

    data: bytes
    time_ns: int


def wait_for_bytes(path: Path, wanted: bytes | bytearray) -> bytes:
    """The bytes of the line in a recording that is growing, once all are there."""
    until = time.monotonic() + SETTLE_S
    while len(found := bytes_of(path.read_bytes())) < len(wanted) and time.monotonic() < until:
        time.sleep(0.05)
    return found


def recorded(folder: Path) -> bytes:
    """The bytes of the line in all segments, one after the other."""
    return b"".join(bytes_of(one.read_bytes()) for one in sorted(folder.glob("*.pcapng")))


def test_a_pipe_that_nobody_reads(tmp_path: Path) -> None:
    """Every byte is on the disk meanwhile, and one SIGTERM ends the tap."""
    reader, writer = os.pipe()
    with TappedLine("--record", tmp_path / "f.pcapng") as line:
        process = line.start(writer)
        line.wait_for("recording to")
        line.send(6.0)
        assert wait_for_bytes(tmp_path / "f.pcapng", line.sent) == line.sent
        assert len(line.sent) > 30_000
        assert line.end() < PROMPT_S
        assert process.returncode == 0
    os.close(reader)
    os.close(writer)
    assert bytes_of((tmp_path / "f.pcapng").read_bytes()) == line.sent


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_fifo_without_a_reader_obeys_the_first_signal(
    number: signal.Signals, tmp_path: Path
) -> None:
    """The tap listens and records meanwhile, and says how much nobody has read."""
    os.mkfifo(tmp_path / "rows.csv")
    with TappedLine("--record", tmp_path / "f.pcapng", "-o", tmp_path / "rows.csv") as line:
        process = line.start()
        line.wait_for("recording to")
        line.send(1.0)
        assert wait_for_bytes(tmp_path / "f.pcapng", line.sent) == line.sent
        assert line.end(number) < PROMPT_S
        assert process.returncode == 0
    assert "dropped: nobody read them" in line.said


def test_a_fifo_gets_every_row_once_it_has_a_reader(tmp_path: Path) -> None:
    """It may come late."""
    os.mkfifo(tmp_path / "rows.csv")
    rows: list[bytes] = []
    with TappedLine(
        "-o", tmp_path / "rows.csv", "--columns", "status", "--record", tmp_path / "f.pcapng"
    ) as line:
        line.start()
        line.wait_for("recording to")
        line.send(1.0)
        with subprocess.Popen(["cat", tmp_path / "rows.csv"], stdout=subprocess.PIPE) as reader:
            reading = threading.Thread(target=lambda: rows.extend(reader.communicate()[0].split()))
            reading.start()
            line.end()
            reading.join()
    assert "dropped" not in line.said
    assert len(rows) > 10
    assert f"{len(rows) - 1} transactions written" in line.said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_export_to_a_fifo_without_a_reader_obeys_the_first_signal(
    number: signal.Signals, tmp_path: Path
) -> None:
    """It waits for its reader, and other outputs of it leave nothing."""
    os.mkfifo(tmp_path / "rows.csv")
    recording = ROOT / "captures" / "pymodbus_two_units" / "recording.jsonl"
    outputs = ("-o", tmp_path / "other.csv", "-o", tmp_path / "rows.csv")
    words = command("export", recording, *outputs)
    running = subprocess.Popen(words, cwd=tmp_path, env=environment())
    until = time.monotonic() + SETTLE_S
    while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(0.2)
    running.send_signal(number)
    assert running.wait(PROMPT_S) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["rows.csv"]


@pytest.mark.parametrize("view", [(), ("--view", "log"), ("--view", "table"), ("--to", "jsonl")])
def test_a_terminal_that_is_frozen(view: tuple[str, ...], tmp_path: Path) -> None:
    """Nobody reads its far end, as after Ctrl-S: standard output and standard error stand still."""
    far, near = pty.openpty()
    path = tmp_path / "f.pcapng"
    with TappedLine("--record", path, *view) as line:
        process = line.start(near, stdin=near, stderr=near)
        until = time.monotonic() + SETTLE_S
        while not path.exists() and time.monotonic() < until:
            time.sleep(0.05)
        line.send(4.0)
        assert wait_for_bytes(path, line.sent) == line.sent
        assert line.end() < PROMPT_S
        assert process.returncode == 0
    os.close(far)
    os.close(near)


def test_a_full_disk(tmp_path: Path) -> None:
    """It is said, what comes meanwhile waits in memory, and the exit status reports it."""
    path = tmp_path / "f.pcapng"
    with TappedLine("--record", path) as line:
        process = line.start()
        line.wait_for("recording to")
        line.send(1.0)
        wait_for_bytes(path, line.sent)
        _, hard = resource.prlimit(process.pid, resource.RLIMIT_FSIZE)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (50, hard))
        line.send(1.0)
        line.wait_for("waits in memory")
        line.send(2.0)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (hard, hard))
        line.wait_for("recording again")
        line.send(1.0)
        line.end()
    assert process.returncode == 3
    assert "nothing is missing" in line.said
    assert recorded(tmp_path) == line.sent


def test_a_folder_that_is_gone_and_a_hole(tmp_path: Path) -> None:
    """What does not fit into memory is counted, and the recording has a mark in its place."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    recorder = Recorder(str(folder / "bus.pcapng"), [PORT], memory=4096)
    blocks = [bytes([number]) * 100 for number in range(150)]
    for number, block in enumerate(blocks[:10]):
        recorder.write_read("bus", None, Read(block, number))
    assert recorder.flush()
    folder.rename(tmp_path / "away")
    time.sleep(1.5)
    for number, block in enumerate(blocks[10:140], start=10):
        recorder.write_read("bus", None, Read(block, number))
    trouble = recorder.status()
    assert trouble.trouble is not None
    assert "folder is gone" in trouble.trouble
    assert trouble.lost > 5000
    folder.mkdir()
    assert recorder.flush()
    for number, block in enumerate(blocks[140:], start=140):
        recorder.write_read("bus", None, Read(block, number))
    status = recorder.close()
    assert (status.trouble, status.had_trouble) == (None, True)
    first = bytes_of((tmp_path / "away" / "bus.pcapng").read_bytes())
    (later,) = folder.iterdir()
    found = packets(later.read_bytes())
    assert len(first) + sum(len(payload) - 12 for _, _, payload, _ in found) + status.lost == 15_000
    events = [payload[8] for _, _, payload, _ in found]
    # Received, then a hole (6) and bytes after it (5), then received again.
    assert re.fullmatch(r"2+652+", "".join(map(str, events))), events
    assert any("recording again" in text for text in recorder.take_messages())


def test_a_file_that_was_deleted_is_said(tmp_path: Path) -> None:
    """A further file begins, and it begins with a hole."""
    recorder = Recorder(str(tmp_path / "bus.pcapng"), [PORT])
    recorder.write_read("bus", None, Read(b"before", 1))
    assert recorder.flush()
    (tmp_path / "bus.pcapng").unlink()
    time.sleep(1.5)
    recorder.write_read("bus", None, Read(b"behind", 2))
    status = recorder.close()
    assert status.had_trouble
    assert any("was deleted" in text for text in recorder.take_messages())
    (path,) = tmp_path.iterdir()
    assert [payload[8] for _, _, payload, _ in packets(path.read_bytes())] == [6, 2]


def test_two_taps_with_one_name(tmp_path: Path) -> None:
    """Each keeps its own segments; those of a tap that has ended are old."""
    ended = Recorder(str(tmp_path / "bus"), [PORT], rotate=Rotation(bytes=500))
    for number in range(8):
        ended.write_read("bus", None, Read(b"e" * 100, number))
    ended.close()
    assert len(list(tmp_path.iterdir())) > 3
    both = [
        Recorder(
            str(tmp_path / "bus"), [PORT], rotate=Rotation(bytes=500), keep=Retention(segments=3)
        )
        for _ in range(2)
    ]
    for number in range(30):
        for recorder, letter in zip(both, b"ab", strict=True):
            recorder.write_read("bus", None, Read(bytes([letter]) * 100, number))
            assert recorder.flush()
    kept = recorded(tmp_path)
    for recorder in both:
        recorder.close()
    assert set(kept) == set(b"ab")
    for letter in b"ab":
        with_letter = [
            one for one in tmp_path.iterdir() if bytes([letter]) * 100 in one.read_bytes()
        ]
        assert len(with_letter) == 3, sorted(one.name for one in tmp_path.iterdir())


ROWS = """
import resource, sys
from analyzer.exports.output import GrowingFile
from dissectors.errors import SourceError
out = GrowingFile(sys.argv[1])
out.append(b"first,row\\n")
resource.setrlimit(resource.RLIMIT_FSIZE, (60, resource.RLIM_INFINITY))
try:
    for number in range(9):
        out.append(b"%d,0123456789\\n" % number + b"x,y\\n")
except SourceError as error:
    print(error)
"""


def test_rows_are_whole_on_a_full_disk(tmp_path: Path) -> None:
    """What did not fit is taken back to the last whole rows."""
    path = tmp_path / "rows.csv"
    done = subprocess.run(
        [sys.executable, "-c", ROWS, path], capture_output=True, text=True, check=True, cwd=ROOT,
        env=environment(), timeout=60,
    )  # fmt: skip
    assert "cannot be written" in done.stdout
    assert path.read_text() == "first,row\n0,0123456789\nx,y\n1,0123456789\nx,y\n"


FAKETIME = next(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"), None)


@pytest.mark.skipif(
    FAKETIME is None and not os.environ.get("MODLENS_CI"), reason="needs libfaketime"
)
def test_a_clock_that_is_set_while_the_bus_is_busy(tmp_path: Path) -> None:
    """Polling never pauses; the clock of a small computer jumps by years after its start."""
    clock, path, rows = tmp_path / "clock", tmp_path / "f.pcapng", tmp_path / "rows.jsonl"
    clock.write_text("+0d")
    changes = {
        "LD_PRELOAD": str(FAKETIME),
        "FAKETIME_TIMESTAMP_FILE": str(clock),
        "FAKETIME_NO_CACHE": "1",
        "FAKETIME_DONT_FAKE_MONOTONIC": "1",
    }
    with TappedLine("--record", path, "-o", rows) as line:
        process = line.start(env=environment(**changes))
        line.wait_for("recording to")
        line.send(2.0, pairs=1, pause_s=0.02)
        clock.write_text("+1000d")
        line.send(15.0, pairs=1, pause_s=0.02)
        line.end()
    assert process.returncode == 0, line.said
    assert "in the middle of traffic" in line.said
    data = path.read_bytes()
    assert bytes_of(data) == line.sent
    times = [time_ns for _, time_ns, _, _ in packets(data)]
    assert times == sorted(times)
    steps = [b - a for a, b in itertools.pairwise(times) if b - a > 10**12]
    assert [round(step / 86_400e9) for step in steps] == [1000]
    assert b"clock_step=" in data
    found = [json.loads(row) for row in rows.read_text().splitlines()]
    assert all(row.get("response_time_us", 0) < 1e6 for row in found)
    assert len({row["time"][:4] for row in found}) == 2
