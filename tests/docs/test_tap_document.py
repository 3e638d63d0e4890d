"""The unit for systemd in docs/tap.md: valid, and its command runs and ends as systemd would."""

from __future__ import annotations

import configparser
import os
import pty
import shlex
import shutil
import signal
import subprocess
import time
import tty
from pathlib import Path

from tests.conftest import TIMEOUT_S, environment
from tests.docs.documents import blocks, shell_environment

DOCUMENT = "docs/tap.md"
REQUEST, RESPONSE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020007f986")


def test_the_unit_is_valid(tmp_path: Path) -> None:
    """The unit file is accepted by systemd's own checker, where it is installed."""
    (block,) = blocks(DOCUMENT, "ini")
    unit = configparser.ConfigParser(strict=True)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(block.text.replace("%", "%%"))
    assert unit["Service"]["KillSignal"] == "SIGTERM"
    checker = shutil.which("systemd-analyze")
    if checker is not None:
        path = tmp_path / "modlens-tap.service"
        path.write_text(block.text.replace("/opt/modlens/bin/modlens", "/bin/true"))
        done = subprocess.run(
            [checker, "verify", "--man=no", str(path)],
            capture_output=True, text=True, timeout=TIMEOUT_S, check=False, env=environment(),
        )  # fmt: skip
        assert "modlens-tap" not in done.stderr, done.stderr


def test_the_unit_s_command_runs_and_ends(tmp_path: Path) -> None:
    """The tap writes what it receives, and SIGTERM leaves a complete file."""
    (block,) = blocks(DOCUMENT, "ini")
    unit = configparser.ConfigParser()
    unit.read_string(block.text)
    far, near = pty.openpty()
    tty.setraw(near)
    text = unit["Service"]["ExecStart"].replace("/dev/ttyUSB0", os.ttyname(near))
    text = text.replace("${STATE_DIRECTORY}", str(tmp_path)).replace("${INVOCATION_ID}", "1")
    words = shlex.split(text)
    words[0] = "modlens"
    running = subprocess.Popen(
        words, stderr=subprocess.PIPE, text=True, env=shell_environment(tmp_path)
    )
    assert running.stderr is not None
    assert "listening" in running.stderr.readline()
    for data in (REQUEST, RESPONSE):
        os.write(far, data)
        time.sleep(0.1)
    time.sleep(0.3)
    running.send_signal(signal.SIGTERM)
    running.communicate(timeout=TIMEOUT_S)
    assert running.returncode == 0
    lines = (tmp_path / "bus-1.jsonl").read_text().splitlines()
    assert len(lines) == 1
    assert '"bus":"bus"' in lines[0].replace(" ", "")
    os.close(far)
    os.close(near)
