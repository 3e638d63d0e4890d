"""Security findings while recordings are read and lines are tapped: `--security`, `--baseline`."""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from analyzer.cli import main
from tests.analyzer.test_baseline import CHANGES, ORDINARY, STRANGER, day
from tests.support.gateway_model import crc
from tests.support.ptybus import PtyBus
from tests.support.usual_days import alarms


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A baseline of an ordinary day, that day's like, and one with a stranger and a new writer."""
    made = tmp_path_factory.mktemp("days")
    usual = day(made / "usual.pcap", ORDINARY, 1)
    assert main(["baseline", usual, "-o", str(made / "usual.toml")]) == 0
    day(made / "like.pcap", ORDINARY, 2)
    day(made / "odd.pcap", replace(ORDINARY, stranger_reads=True, hmi_writes_unit_2=True), 3)
    return made


def test_deviations_are_reported_while_a_recording_is_decoded(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--baseline", str(folder / "usual.toml"), "-o", str(folder / "rows.csv")]
    assert main(["decode", str(folder / "odd.pcap"), *words]) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if " new_" in line]
    assert len(said) == 2
    assert f"high new_client: {STRANGER} is a new client" in said[0]
    assert "high new_writer: 10.0.0.10 writes to unit 2" in said[1]
    assert main(["decode", str(folder / "like.pcap"), *words]) == 0
    assert " high " not in capsys.readouterr().err


@pytest.mark.parametrize(
    "code",
    [
        "new_client", "new_writer", "new_function", "new_request", "missing_request",
        "period_moved", "value_never_written", "response_time_shifted",
    ],
)  # fmt: skip
def test_a_deviation_between_ordinary_traffic_is_reported(
    code: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By `decode` when it happens, and by the doctor; the other half hours are as usual."""
    odd = day(tmp_path / "odd.pcap", ORDINARY, 5, CHANGES[code], ORDINARY)
    baseline = ["--baseline", str(folder / "usual.toml")]
    assert main(["decode", odd, *baseline, "-o", str(tmp_path / "rows.csv")]) == 0
    said = re.findall(r" (?:high|medium|low) (\w+): ", capsys.readouterr().err)
    assert set(said) == {code}
    assert main(["doctor", odd, *baseline]) == 0
    assert set(re.findall(r"\d\. (?:high|medium|low) (\w+)", capsys.readouterr().out)) == {code}


def test_the_doctor_shows_them_after_its_verdict(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    baseline = ["--baseline", str(folder / "usual.toml")]
    assert main(["doctor", str(folder / "odd.pcap"), *baseline]) == 0
    shown = capsys.readouterr().out
    assert shown.index("new_client") > shown.index("healthy")
    assert main(["doctor", str(folder / "odd.pcap"), *baseline, "--to", "md"]) == 0
    assert "| high | `new_writer` |" in capsys.readouterr().out


def test_accepting_one_finding_accepts_no_other(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    usual = folder / "edited.toml"
    usual.write_text((folder / "usual.toml").read_text())
    before = usual.read_text().splitlines()
    words = ["--baseline", str(usual), "-o", str(folder / "rows.csv")]
    assert main(["decode", str(folder / "odd.pcap"), *words, "--accept", "new_client"]) == 0
    assert "new_client:" not in capsys.readouterr().err
    [added] = [line for line in usual.read_text().splitlines() if line not in before]
    assert STRANGER in added
    assert main(["decode", str(folder / "odd.pcap"), *words]) == 0
    said = capsys.readouterr().err
    assert "new_writer:" in said
    assert "new_client:" not in said


def tap(frames: Sequence[str], *words: str) -> None:
    """Tap a serial line on which a master sends these frames, one a second."""
    with PtyBus(["master", "tap"], 19200, 11) as bus:
        path = bus.path("master")

        def send() -> None:
            port = os.open(path, os.O_RDWR | os.O_NOCTTY)
            for frame in frames:
                time.sleep(1)
                data = bytes.fromhex(frame)
                os.write(port, data + crc(data))
            os.close(port)

        sender = threading.Thread(target=send)
        sender.start()
        more = ["--line", "19200-8E1", "--duration", f"{len(frames) + 2}s", "--to", "jsonl"]
        assert main(["tap", bus.path("tap"), *more, *words]) == 0
        sender.join()


READ = "010300000001"


def test_a_tap_reports_an_order_to_be_silent(capsys: pytest.CaptureFixture[str]) -> None:
    """On a serial line, without a baseline."""
    tap([READ, "010800040000", READ, READ], "--security")
    assert "high listen_only: The master ordered unit 1" in capsys.readouterr().err


def test_a_tap_reports_what_its_own_recording_never_had(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a serial line: the baseline is of another recording of that line."""
    recording, usual = str(tmp_path / "line.pcapng"), str(tmp_path / "usual.toml")
    tap([READ, READ, READ], "--record", recording)
    assert main(["baseline", recording, "--line", "19200-8E1", "-o", usual]) == 0
    capsys.readouterr()
    tap([READ, "010400000001", READ], "--baseline", usual)
    said = capsys.readouterr().err
    assert "medium new_function: The master uses function 4 on unit 1" in said
    assert said.count(" new_") == 1


def test_wrong_use_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = str(folder / "like.pcap")
    assert main(["decode", recording, "--accept", "new_client"]) == 2
    assert "--accept needs --baseline" in capsys.readouterr().err
    words = ["--baseline", str(folder / "usual.toml"), "--accept", "nothing"]
    assert main(["decode", recording, *words]) == 2
    assert "it is one of" in capsys.readouterr().err


def test_an_ordinary_morning_has_no_alert(tmp_path: Path) -> None:
    """From night to shift, with an operator, a historian and refused requests: usual_days."""
    assert alarms(tmp_path, 1, hours=1.5, begin_hour=5) == [[]]
