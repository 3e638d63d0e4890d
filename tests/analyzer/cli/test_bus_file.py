"""`--bus plant.toml` says ports, line settings and profiles once; profiles tell of functions."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import _modlens
from analyzer import ProfileError, decode
from tests.conftest import ROOT, Modlens, command, environment

METER = """\
profile = 1
[device]
id = "meter"
functions = [3]
[[registers]]
at = "hr:0"
name = "flow"
scale = 0.1
unit = "l/s"
"""

SERVO = """\
profile = 1
[device]
id = "servo"
vendor_functions = ["sungrow"]
[[registers]]
at = "hr:0"
name = "position"
"""


def rtu(text: str) -> bytes:
    """An RTU frame of hex digits without its checksum."""
    data = bytes.fromhex(text)
    return data + _modlens.crc16(data).to_bytes(2, "little")


def profiles(folder: Path) -> None:
    """Two device profiles."""
    (folder / "meter.toml").write_text(METER)
    (folder / "servo.toml").write_text(SERVO)


@pytest.mark.skipif(sys.platform != "linux", reason="ptys of Linux")
def test_a_tap_takes_ports_settings_and_profiles_from_the_file(tmp_path: Path) -> None:
    """No port on the command line; each bus has its own settings, and unit 1 its own profile."""
    profiles(tmp_path)
    pairs = [os.openpty() for _ in range(2)]
    names = [os.ttyname(near) for _, near in pairs]
    plant = tmp_path / "plant.toml"
    plant.write_text(
        f'plant = 1\n[[bus]]\nname = "water"\nport = "{names[0]}"\nline = "9600-8N1"\n'
        f'[bus.units]\n1 = "meter.toml"\n[[bus]]\nname = "drives"\nport = "{names[1]}"\n'
        'line = "115200-8E1"\n[bus.units]\n1 = "servo.toml"\n'
    )
    rows = tmp_path / "rows.jsonl"
    running = subprocess.Popen(
        command(
            "tap", "--bus", plant, "-o", f"readings:{rows}", "--record", tmp_path / "raw.pcapng"
        ),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env=environment(), cwd=ROOT,
    )  # fmt: skip
    assert running.stderr is not None
    said = running.stderr.readline().decode()
    while b"recording to" not in running.stderr.readline():
        pass
    for far, _ in pairs:
        for part in (rtu("01 03 0000 0001"), rtu("01 03 02 0019")):
            os.write(far, part)
            time.sleep(0.03)
    time.sleep(0.3)
    running.send_signal(signal.SIGINT)
    running.communicate(timeout=60)
    assert running.returncode == 0
    assert f"water={names[0]}@9600-8N1, drives={names[1]}@115200-8E1" in said
    found = [json.loads(line) for line in rows.read_text().splitlines()]
    assert [(row["bus"], row["name"], row["value_text"]) for row in found] == [
        ("water", "flow", "2.5"),
        ("drives", "position", "25"),
    ]
    raw = (tmp_path / "raw.pcapng").read_bytes()
    assert b"settings=9600-8N1 name=water" in raw
    assert b"settings=115200-8E1 name=drives" in raw
    for far, near in pairs:
        os.close(far)
        os.close(near)


def test_a_tap_needs_a_port(tmp_path: Path, modlens: Modlens) -> None:
    """The port is given on the command line or in the bus file."""
    done = modlens("tap")
    assert done.status == 2
    assert "no port given" in done.err
    plant = tmp_path / "plant.toml"
    plant.write_text('plant = 1\n[[bus]]\nname = "water"\n')
    done = modlens("tap", "--bus", str(plant))
    assert done.status == 2
    assert "bus water of the bus file has no port" in done.err


def recording(folder: Path, *frames: str) -> str:
    """Raw bytes."""
    path = folder / "bus.hex"
    path.write_text("".join(f"{rtu(frame).hex(' ')}\n" for frame in frames))
    return str(path)


def test_show_lists_the_readings_of_a_transaction(tmp_path: Path, modlens: Modlens) -> None:
    """By name, with unit; without a profile there is nothing to list."""
    profiles(tmp_path)
    path = recording(tmp_path, "01 03 0000 0002", "01 03 04 0019 0007")
    done = modlens("show", path, "--txn", "1", "--profile", f"1={tmp_path}/meter.toml")
    assert "readings\n  flow  2.5 l/s\n" in done.out
    assert "readings" not in modlens("show", path, "--txn", "1").out


def test_a_function_that_the_device_does_not_have(tmp_path: Path) -> None:
    """`device.functions` of a profile: asking for another one is a finding, on that unit only."""
    profiles(tmp_path)
    path = recording(
        tmp_path, "01 03 0000 0001", "01 03 02 0019", "01 04 0000 0001", "01 84 01",
        "02 04 0000 0001", "02 04 02 0001",
    )  # fmt: skip
    found = decode(path, profiles=[f"1={tmp_path}/meter.toml"])
    rows = list(found.findings.where("code == 'unsupported_function'"))
    assert [(row.txn, row.unit, row.detail) for row in rows] == [
        (2, 1, "function 4; the profile lists 3")
    ]
    assert [row.findings for row in found.transactions] == [
        [], ["exception", "unsupported_function"], [],
    ]  # fmt: skip


def test_a_profile_brings_its_vendors_functions(tmp_path: Path) -> None:
    """`vendor_functions` loads rows as `--functions` does.

    An unknown one is reported by its key.
    """
    profiles(tmp_path)
    path = recording(tmp_path, "01 65 01 10 02 0007")
    bare = next(iter(decode(path).frames))
    named = next(iter(decode(path, profiles=[f"1={tmp_path}/servo.toml"]).frames))
    assert (bare.function_name, named.function_name) == (None, "Sungrow 32-bit Access")
    (tmp_path / "servo.toml").write_text(SERVO.replace("sungrow", "sungrew"))
    with pytest.raises(ProfileError, match="vendor_functions"):
        decode(path, profiles=[f"1={tmp_path}/servo.toml"])
