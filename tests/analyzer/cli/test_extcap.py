"""Wireshark finds our interfaces, asks for their settings, captures from them: by tshark."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import threading
from collections import Counter
from pathlib import Path

import pytest

import _modlens
from analyzer import decode
from tests.conftest import CAPTURES, TIMEOUT_S, Modlens, command, need_program
from tests.support.tshark import environment

if sys.platform != "linux":
    pytest.skip("ptys and Wireshark's folders of Linux", allow_module_level=True)

RECORDING = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
FRAMES = len((RECORDING.parent / "frames.jsonl").read_text().splitlines())


def installed(home: Path) -> dict[str, str]:
    """The environment of a home with our file in Wireshark's personal folders."""
    env = environment(home)
    done = subprocess.run(
        command("extcap", "install"),
        env=env,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stdout.count(": installed\n") == 2
    return env


def listed(env: dict[str, str]) -> str:
    """What `tshark -D` shows."""
    words = [need_program("tshark"), "-D"]
    return subprocess.run(
        words, env=env, capture_output=True, text=True, check=True, timeout=TIMEOUT_S
    ).stdout


def test_wireshark_lists_the_interfaces_until_they_are_taken_away(tmp_path: Path) -> None:
    """install, status, uninstall in a home of its own."""
    env = installed(tmp_path)
    shown = listed(env)
    assert "modlens-replay (Modbus from a recording)" in shown
    assert "modlens-port (Modbus on another port or URL)" in shown
    for action, said in (("status", ": installed\n"), ("uninstall", ": removed\n")):
        words = command("extcap", action)
        done = subprocess.run(
            words, env=env, capture_output=True, text=True, check=True, timeout=60
        )
        assert done.stdout.count(said) == 2
    assert "modlens" not in listed(env)
    done = subprocess.run(
        command("extcap", "status"), env=env, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.count(": not installed\n") == 2


def test_another_python_is_reported(tmp_path: Path) -> None:
    """A file of an installation that has moved away."""
    env = installed(tmp_path)
    path = tmp_path / ".config" / "wireshark" / "extcap" / "modlens"
    assert os.access(path, os.X_OK)
    path.write_text(path.read_text().replace(sys.executable, "/usr/bin/python2"))
    words = command("extcap", "status")
    done = subprocess.run(words, env=env, capture_output=True, text=True, check=True, timeout=60)
    assert "for another Python; install it again" in done.stdout


def test_a_recording_is_captured_like_a_line(tmp_path: Path) -> None:
    """`tshark -i modlens-replay`: all frames, decoded and paired."""
    env = installed(tmp_path)
    words = [
        need_program("tshark"),
        "-i",
        "modlens-replay",
        "-T",
        "fields",
        "-e",
        "modbus.func_code",
    ]
    words += ["-e", "modbus.request_frame", "-o", f"extcap.modlens_replay.file:{RECORDING}"]
    done = subprocess.run(
        [*words, "-c", str(FRAMES)],
        env=env,
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 0, done.stderr
    rows = [line.split("\t") for line in done.stdout.splitlines()]
    assert len(rows) == FRAMES
    assert sum(bool(row[1]) for row in rows) == FRAMES // 2


def test_standard_output_may_be_a_file(tmp_path: Path) -> None:
    """The capture flows into the pipe though standard output was a file, which can seek."""
    pipe, read = tmp_path / "pipe", tmp_path / "read"
    os.mkfifo(pipe)
    words = command(
        "extcap", "--capture", "--extcap-interface", "modlens-replay", "--file", str(RECORDING)
    )
    with (tmp_path / "log.txt").open("w") as log, read.open("wb") as target:
        reader = subprocess.Popen(["cat", str(pipe)], stdout=target)
        done = subprocess.run(
            [*words, "--fifo", str(pipe)], stdout=log, stderr=subprocess.PIPE, text=True,
            check=False, timeout=TIMEOUT_S,
        )  # fmt: skip
        reader.wait(TIMEOUT_S)
    assert (done.returncode, "Traceback" in done.stderr) == (0, False), done.stderr
    assert read.read_bytes()[:4] == b"\x0a\x0d\x0d\x0a"
    # A file in place of the pipe is written again, however long it was.
    file = tmp_path / "old.pcapng"
    file.write_bytes(bytes(1_000_000))
    subprocess.run([*words, "--fifo", str(file)], check=True, timeout=TIMEOUT_S)
    assert file.read_bytes() == read.read_bytes()


@pytest.mark.parametrize(("file", "said"), [("", "name a recording"), ("/no/such", "no such file")])
def test_a_replay_of_nothing_ends(file: str, said: str, tmp_path: Path) -> None:
    """What is wrong shows in Wireshark, which does not go on waiting."""
    words = [need_program("tshark"), "-i", "modlens-replay"]
    words += ["-o", f"extcap.modlens_replay.file:{file}"] if file else []
    done = subprocess.run(
        words, env=installed(tmp_path), capture_output=True, text=True, check=False,
        timeout=TIMEOUT_S,
    )  # fmt: skip
    assert done.returncode != 0
    assert f"modlens: {file}" in done.stderr
    assert said in done.stderr


def exchange(number: int) -> bytes:
    """A request and its response."""
    bodies = [bytes([1, 3, 0, number, 0, 1]), bytes([1, 3, 2, 0, number])]
    return b"".join(body + _modlens.crc16(body).to_bytes(2, "little") for body in bodies)


class Talk:
    """A pseudo terminal with traffic until the end of the `with` block."""

    def __enter__(self) -> str:
        self._master, slave = pty.openpty()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._talk)
        self._thread.start()
        self._slave = slave
        return os.ttyname(slave)

    def _talk(self) -> None:
        number = 0
        while not self._stop.wait(0.05):
            os.write(self._master, exchange(number % 200))
            number += 1

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)


def test_a_line_is_captured_live(tmp_path: Path) -> None:
    """`tshark -i modlens-port` on a pseudo terminal; it stops when tshark has enough."""
    env = installed(tmp_path)
    with Talk() as port:
        words = [need_program("tshark"), "-i", "modlens-port", "-c", "6", "-T", "fields"]
        words += ["-e", "mbtcp.unit_id", "-e", "modbus.func_code"]
        words += ["-o", f"extcap.modlens_port.port:{port}", "-o", "extcap.modlens_port.format:8N1"]
        done = subprocess.run(
            words, env=env, capture_output=True, text=True, check=False, timeout=TIMEOUT_S
        )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["1\t3"] * 6


def test_a_tap_flows_into_tshark(tmp_path: Path) -> None:
    """`modlens tap PORT --to pcapng | tshark -i -`: rows while it runs."""
    tshark = need_program("tshark")
    with Talk() as port:
        words = command("tap", port, "--line", "19200-8N1", "--to", "pcapng")
        tap = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        reader = [tshark, "-l", "-i", "-", "-c", "4", "-T", "fields", "-e", "modbus.func_code"]
        done = subprocess.run(
            reader, stdin=tap.stdout, capture_output=True, text=True, check=False,
            timeout=TIMEOUT_S, env=environment(tmp_path),
        )  # fmt: skip
        assert tap.stdout is not None
        tap.stdout.close()
        tap.send_signal(signal.SIGTERM)
        tap.wait(TIMEOUT_S)
    assert done.stdout.splitlines() == ["3"] * 4, done.stderr


def test_the_dialog_says_what_wireshark_understands(modlens: Modlens) -> None:
    """Every argument has a number, a call and a type that all versions know."""
    for interface in ("modlens-port", "modlens-replay", "modlens-ttyUSB0"):
        done = modlens("extcap", "--extcap-interface", interface, "--extcap-config")
        assert done.status == 0
        kinds = {"selector", "string", "fileselect"}
        arguments = [line for line in done.out.splitlines() if line.startswith("arg ")]
        for number, line in enumerate(arguments):
            assert line.startswith(f"arg {{number={number}}}{{call=--")
            assert line.partition("{type=")[2].partition("}")[0] in kinds
    done = modlens("extcap", "--extcap-interface", "modlens-port", "--extcap-dlts")
    assert done.out.startswith("dlt {number=252}")


def test_wrong_use_of_extcap(modlens: Modlens, tmp_path: Path) -> None:
    """Wrong use on the command line, and settings that were left empty in Wireshark's dialog."""
    assert "name an action" in modlens("extcap").err
    words = ["extcap", "--capture", "--extcap-interface"]
    assert "--capture needs --fifo" in modlens(*words, "modlens-port").err
    away = tmp_path / "no" / "f"
    assert "cannot be written" in modlens(*words, "modlens-port", "--fifo", away).err
    assert "name a port" in modlens(*words, "modlens-port", "--fifo", tmp_path / "f").err
    done = modlens(*words, "modlens-gone", "--fifo", tmp_path / "f")
    assert (done.status, "is it plugged in?" in done.err) == (3, True)


def test_the_profile_has_columns_and_colours(tmp_path: Path) -> None:
    """Tshark reads it: our columns, and colours for what is wrong."""
    env = environment(tmp_path)
    made = subprocess.run(
        command("wireshark-setup"), env=env, capture_output=True, text=True, check=True, timeout=60
    )
    assert "/wireshark/profiles/Modbus: written" in made.stdout
    capture = tmp_path / "bus.pcapng"
    recording = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
    subprocess.run(
        command("export", recording, "--line", "19200-8E1", "-o", capture), check=True, timeout=60
    )
    words = [need_program("tshark"), "-C", "Modbus", "-r", str(capture)]
    shown = subprocess.run(words, env=env, capture_output=True, text=True, check=True, timeout=60)
    assert "error bad_checksum: " in shown.stdout  # the column of findings
    words += ["--color", "-T", "fields", "-e", "frame.coloring_rule.name"]
    done = subprocess.run(words, env=env, capture_output=True, text=True, check=True, timeout=60)
    rules = Counter(done.stdout.splitlines())
    verdicts = Counter(row.verdict for row in decode(recording, line="19200-8E1").frames)
    assert rules["Modbus: checksum error"] == verdicts["bad_checksum"]
    assert rules["Modbus: noise"] == verdicts["noise"] + verdicts["incomplete"]
    assert rules["Modbus: no response"] > 3
    assert rules["Modbus: retry"] > 3
    folder = tmp_path / ".config" / "wireshark" / "profiles" / "Modbus"
    subprocess.run(command("wireshark-setup", "--remove"), env=env, check=True, timeout=60)
    assert not folder.exists()
    folder.mkdir(parents=True)
    (folder / "preferences").write_text("gui.font_name: mine\n")
    mine = subprocess.run(
        command("wireshark-setup"), env=env, capture_output=True, text=True, check=False, timeout=60
    )
    assert (mine.returncode, "a profile of yours" in mine.stderr) == (3, True)
