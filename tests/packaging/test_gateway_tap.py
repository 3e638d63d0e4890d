"""The tap without Python: the rows of `modlens tap`, a recording that decodes to them, MQTT."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import signal
import subprocess
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from analyzer.bus_days import COLUMNS
from tests.conftest import ROOT, TIMEOUT_S, Modlens, environment, need_program, without

LINE = "19200-8E1"
EXCHANGES = [
    "010300000001840a",
    "0103020007f986",
    "110300 6b00037687",
    "110306ae4156524340 49ad",
    "01020063000149d4",
    "018202c161",
]
"""Reads of two units, and an exception (Application Protocol V1.1b3, 6.3 and 7)."""
SAME = ("unit", "function", "address", "quantity", "data", "status", "exception", "request_hex")


@pytest.fixture(scope="module")
def program() -> Path:
    """The binary, as `cargo test` and `make test` leave it."""
    words = ["cargo", "build", "--release", "--locked", "--workspace", "--bin", "modlens-tap"]
    subprocess.run(words, cwd=ROOT, check=True, timeout=900, capture_output=True)
    return ROOT / "target" / "release" / "modlens-tap"


@pytest.fixture
def port() -> Iterator[tuple[int, str]]:
    """A pseudo terminal: where to write, and the port's name."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    yield ours, os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def has_open(pid: int, path: str) -> bool:
    """Whether a process has opened this file."""
    folder = Path(f"/proc/{pid}/fd")
    with contextlib.suppress(OSError):
        return any(os.readlink(entry) == path for entry in folder.iterdir())
    return False


def tap(program: Path, port: tuple[int, str], *words: str, cwd: Path) -> tuple[int, str, str]:
    """Run the tap while exchanges come, until it has what `--count` says; status, output, notes."""
    running = subprocess.Popen(
        [str(program), port[1], *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(), cwd=cwd,
    )  # fmt: skip
    ended = threading.Event()

    def talk() -> None:
        until = time.monotonic() + TIMEOUT_S / 2
        # What arrives before the tap has set the port up is dropped: the line speaks afterwards.
        while running.poll() is None and not has_open(running.pid, port[1]):
            time.sleep(0.005)
        time.sleep(0.1)
        while not ended.is_set() and time.monotonic() < until:
            for text in EXCHANGES:
                os.write(port[0], bytes.fromhex(text))
                time.sleep(0.02)
        running.send_signal(signal.SIGTERM)

    talking = threading.Thread(target=talk)
    talking.start()
    try:
        while running.poll() is None:
            time.sleep(0.05)
    finally:
        ended.set()
        talking.join()
    out, err = running.communicate(timeout=TIMEOUT_S)
    return running.returncode, out, err


def rows_of(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def same(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The columns that do not depend on the file."""
    return [{name: row.get(name) for name in (*SAME, "time", "response_time_us")} for row in rows]


def test_its_recording_decodes_to_its_rows(
    program: Path, port: tuple[int, str], tmp_path: Path, modlens: Modlens
) -> None:
    """Values, statuses and times are those of `modlens decode` on what `--record` wrote."""
    words = ["--line", LINE, "--record", "bus.pcapng", "--count", "20"]
    status, out, err = tap(program, port, *words, cwd=tmp_path)
    assert status == 0, err
    rows = rows_of(out)
    assert len(rows) == 20
    assert {row["status"] for row in rows} == {"ok", "exception"}
    assert [row["data"] for row in rows[:2]] == [[7], [44609, 22098, 17216]]
    decoded = modlens("decode", tmp_path / "bus.pcapng", "--replay", "--to", "jsonl")
    assert decoded.status == 0
    assert same(rows_of(decoded.out))[:20] == same(rows)


def test_line_settings_are_found(
    program: Path, port: tuple[int, str], tmp_path: Path, modlens: Modlens
) -> None:
    """Without `--line` it searches as `modlens tap` does; what proved them is decoded, recorded."""
    words = ["--record", "bus.pcapng", "--count", "12"]
    status, out, err = tap(program, port, *words, cwd=tmp_path)
    assert status == 0
    assert "detecting the line settings" in err
    # A pseudo terminal gives its bytes at any settings: the first that are tried are right.
    assert "found 115200-8E1, rtu: " in err
    assert len(rows_of(out)) == 12
    decoded = modlens("decode", tmp_path / "bus.pcapng", "--replay", "--to", "jsonl")
    assert same(rows_of(decoded.out))[:12] == same(rows_of(out))


def test_a_search_without_result_keeps_what_it_heard(
    program: Path, port: tuple[int, str], tmp_path: Path
) -> None:
    """It says what may be wrong, and the recording has the bytes."""
    words = [str(program), port[1], "--record", "bus.pcapng"]
    running = subprocess.Popen(words, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    noise = b"no Modbus at all; " * 3
    time.sleep(0.5)
    os.write(port[0], noise)
    time.sleep(0.5)
    running.send_signal(signal.SIGTERM)
    _, err = running.communicate(timeout=TIMEOUT_S)
    assert running.returncode == 0
    assert f"no line settings fit the {len(noise)} bytes received" in err
    assert f"{len(noise)} bytes recorded, 0 lost" in err


def test_a_file_is_appended_to(program: Path, port: tuple[int, str], tmp_path: Path) -> None:
    """A restart of the service loses nothing."""
    words = ["--line", LINE, "-o", "rows.jsonl", "--count", "2"]
    for _ in range(2):
        assert tap(program, port, *words, cwd=tmp_path)[0] == 0
    assert len(rows_of((tmp_path / "rows.jsonl").read_text(encoding="utf-8"))) == 4


def test_recordings_rotate(program: Path, port: tuple[int, str], tmp_path: Path) -> None:
    """The oldest files go."""
    words = ["--line", LINE, "--record", "bus.pcapng", "--rotate", "2KB", "--keep", "2"]
    assert tap(program, port, *words, "--quiet", "--count", "60", cwd=tmp_path)[0] == 0
    files = sorted(tmp_path.glob("bus*.pcapng"))
    assert len(files) == 2
    assert all(path.stat().st_size <= 2000 for path in files)


@pytest.mark.parametrize(
    ("words", "status"),
    [((), 2), (("--what",), 2), (("/no/such/port", "--line", LINE), 4)],
)
def test_wrong_use_and_missing_ports(program: Path, words: tuple[str, ...], status: int) -> None:
    """The exit statuses of modlens."""
    done = subprocess.run(
        [str(program), *words], capture_output=True, text=True, check=False, timeout=TIMEOUT_S
    )
    assert done.returncode == status
    assert done.stderr.startswith("modlens-tap: ")


def certificate(folder: Path) -> None:
    """An authority, and the broker's certificate for localhost."""
    openssl = need_program("openssl")
    make = [openssl, "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1"]
    make += ["-nodes", "-days", "2"]
    for words in (
        [*make, "-subj", "/CN=authority", "-keyout", "ca.key", "-out", "ca.pem"],
        [*make, "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost",
         "-addext", "basicConstraints=critical,CA:FALSE",
         "-CA", "ca.pem", "-CAkey", "ca.key", "-keyout", "key.pem", "-out", "cert.pem"],
    ):  # fmt: skip
        subprocess.run(words, cwd=folder, check=True, capture_output=True, timeout=TIMEOUT_S)


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[tuple[int, Path]]:
    """A broker that speaks TLS; its port, and what was published."""
    program = need_program("mosquitto")
    paho = pytest.importorskip("paho.mqtt.client")
    certificate(tmp_path)
    number = 21883 + os.getpid() % 1000
    (tmp_path / "mosquitto.conf").write_text(
        f"listener {number} 127.0.0.1\nallow_anonymous true\ncertfile cert.pem\nkeyfile key.pem\n"
    )
    (tmp_path / "key.pem").chmod(0o644)
    tmp_path.chmod(0o755)
    running = subprocess.Popen([program, "-c", "mosquitto.conf"], cwd=tmp_path)
    del paho
    time.sleep(1)
    if running.poll() is not None:
        without("a broker")
    yield number, tmp_path / "ca.pem"
    running.terminate()
    running.wait(TIMEOUT_S)


def test_transactions_are_published_by_tls(
    program: Path, port: tuple[int, str], broker: tuple[int, Path], tmp_path: Path
) -> None:
    """A subscriber gets the JSON lines and the row of the day; the last state is retained."""
    from paho.mqtt import client as paho  # noqa: PLC0415
    from paho.mqtt.enums import CallbackAPIVersion  # noqa: PLC0415

    number, authority = broker
    got: list[tuple[str, bytes]] = []
    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.tls_set(str(authority))
    client.on_message = lambda _, __, message: got.append((message.topic, bytes(message.payload)))
    client.connect("localhost", number)
    client.subscribe("plant/#", 1)
    client.loop_start()
    words = ["--line", LINE, "--count", "6", "--mqtt", f"mqtts://localhost:{number}/plant"]
    status, out, err = tap(program, port, *words, "--mqtt-ca", str(authority), cwd=tmp_path)
    until = time.monotonic() + 10
    while len(got) < 9 and time.monotonic() < until:
        time.sleep(0.05)
    client.loop_stop()
    assert status == 0, err
    published = [payload.decode() for topic, payload in got if topic.endswith("/transaction")]
    assert published == out.splitlines()
    (day,) = [json.loads(payload) for topic, payload in got if topic.endswith("/day")]
    assert list(day) == list(COLUMNS)
    assert (day["bus"], day["failed_share"]) == (port[1], 0.0)
    assert day["requests"] > 0
    states = [payload for topic, payload in got if topic == "plant/status"]
    assert (states[0], states[-1]) == (b"online", b"offline")


def test_a_broker_that_nobody_trusts_is_refused(
    program: Path, port: tuple[int, str], broker: tuple[int, Path], tmp_path: Path
) -> None:
    """The system's authorities do not know it: nothing is delivered, and that is reported."""
    words = ["--line", LINE, "--count", "2", "--mqtt", f"mqtts://localhost:{broker[0]}/plant"]
    status, out, err = tap(program, port, *words, cwd=tmp_path)
    assert status == 3
    assert len(rows_of(out)) == 2
    assert "certificate" in err
    assert "3 messages were not delivered" in err, "two transactions, and the row of the day"
