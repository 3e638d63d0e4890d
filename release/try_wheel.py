"""Tries wheels where they are meant for: `make try-wheels`.

    python -m release.try_wheel manylinux-x86_64 manylinux-aarch64 manylinux-armv7l

A wheel for another processor runs under qemu-user, in the Python that Debian has for it; its files
are fetched by mmdebstrap into `target/roots`, outside of the system. The demo, exports of a
recording have to give what they give on this machine. A tap on a pseudo terminal is tried on this
machine's own kind only: qemu-user 7 does not know the calls that set a port's rate (TCSETS2).
"""

from __future__ import annotations

import argparse
import os
import platform
import pty
import shutil
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Sequence
from pathlib import Path

from release.rust import ROOT
from release.targets import MACHINES, TARGETS
from release.wheels import DIST, QUICK_DIST

ROOTS = ROOT / "target" / "roots"
RECORDING = ROOT / "captures" / "pymodbus_disturbed" / "recording.jsonl"
LINE = ("--line", "19200-8E1")
EXCHANGES = bytes.fromhex("010300000001840a0103020007f986")
"""A request for register 0 and its response, value 7 (Application Protocol V1.1b3, 6.3)."""

DEBIAN = "http://deb.debian.org/debian"
RELEASE = "bookworm"
PACKAGES = "python3-minimal,libpython3-stdlib,ca-certificates"
TIMEOUT_S = 300


class Trial:
    """A wheel that is installed for one machine, and can be run there."""

    def __init__(self, wheel: Path, machine: str, folder: Path) -> None:
        self._site = folder / "site"
        self._python = python_of(machine)
        self.is_emulated = len(self._python) > 1
        install(wheel, self._site)

    def command(self, *words: str | Path) -> list[str]:
        """The words that start `modlens` with these arguments."""
        return [*self._python, "-m", "analyzer", *map(str, words)]

    def environment(self) -> dict[str, str]:
        """Nothing but the wheel and what it depends on is found."""
        return {**common_environment(), "PYTHONPATH": str(self._site)}

    def run(self, *words: str | Path, cwd: Path) -> str:
        """What `modlens` prints."""
        return run(self.command(*words), self.environment(), cwd)


def common_environment() -> dict[str, str]:
    """The environment for the wheel and for this machine's modlens alike."""
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    return {**kept, "TZ": "UTC", "COLUMNS": "80", "PYTHONIOENCODING": "utf-8"}


def run(words: Sequence[str], env: dict[str, str], cwd: Path) -> str:
    """What a program prints; a failure shows what it said."""
    done = subprocess.run(
        words, env=env, cwd=cwd, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: exit status {done.returncode}\n{done.stderr}")
    return done.stdout


def python_of(machine: str) -> list[str]:
    """The words that start Debian's Python of this machine."""
    if machine == platform.machine():
        return [sys.executable]
    debian = MACHINES[machine].debian
    root = ROOTS / f"{RELEASE}-{debian}"
    python = root / "usr/bin/python3.11"
    if not python.exists():
        ROOTS.mkdir(parents=True, exist_ok=True)
        # What an interrupted try has left; mmdebstrap takes an empty folder only.
        shutil.rmtree(root, ignore_errors=True)
        subprocess.run(
            ["mmdebstrap", "--quiet", "--variant=extract", f"--architectures={debian}",
             '--aptopt=Acquire::Retries "5"', f"--include={PACKAGES}", RELEASE, str(root),
             f"deb {DEBIAN} {RELEASE} main"],
            check=True,
        )  # fmt: skip
    return [MACHINES[machine].emulator, "-L", str(root), str(python)]


def install(wheel: Path, folder: Path) -> None:
    """Install a wheel and what it depends on for the machine that it is for."""
    *_, platforms = wheel.stem.split("-")
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
         "--target", str(folder), "--only-binary=:all:", "--python-version", "3.11",
         "--implementation", "cp", "--abi", "abi3", "--abi", "none",
         *(word for one in platforms.split(".") for word in ("--platform", one)), str(wheel)],
        check=True,
    )  # fmt: skip


def try_recording(trial: Trial, folder: Path, *, quick: bool) -> None:
    """The demo, and exports: the same characters and bytes as on this machine.

    A quick trial has one command of each kind: most of the time is the start of an emulated Python.
    """
    here = [sys.executable, "-m", "analyzer"]
    plain = {**common_environment(), "PYTHONPATH": str(ROOT)}
    commands = (
        ["decode", str(RECORDING), *LINE],
        ["decode", str(RECORDING), *LINE, "--to", "csv"],
        ["stats", str(RECORDING), *LINE],
    )
    for words in commands[:1] if quick else commands:
        expected = run([*here, *words], plain, ROOT)
        if not expected or trial.run(*words, cwd=folder) != expected:
            raise SystemExit(f"modlens {' '.join(words)}: differs from this machine's")
    for ending in ("parquet",) if quick else ("parquet", "pcapng", "jsonl"):
        mine, theirs = folder / f"here.{ending}", folder / f"there.{ending}"
        run([*here, "export", str(RECORDING), *LINE, "-o", str(mine)], plain, ROOT)
        trial.run("export", RECORDING, *LINE, "-o", theirs, cwd=folder)
        if mine.read_bytes() != theirs.read_bytes():
            raise SystemExit(f"{ending}: differs from this machine's")


def listen(words: Sequence[str], env: dict[str, str], cwd: Path) -> str:
    """What a tap of a pseudo terminal prints until it ends; `PORT` in its words is the terminal."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    words = [os.ttyname(theirs) if word == "PORT" else word for word in words]
    with subprocess.Popen(
        words, env=env, cwd=cwd, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as tap:
        deadline = time.monotonic() + TIMEOUT_S
        while tap.poll() is None and time.monotonic() < deadline:
            os.write(ours, EXCHANGES)
            time.sleep(0.5)
        tap.kill()
        out, err = tap.communicate()
    os.close(ours)
    os.close(theirs)
    if tap.returncode:
        raise SystemExit(f"{' '.join(words)}: exit status {tap.returncode}\n{out}{err}")
    return out


def try_tap(trial: Trial, folder: Path) -> None:
    """A tap on a pseudo terminal decodes what comes there, and stops after two transactions."""
    words = trial.command("tap", "PORT", *LINE, "--count", "2", "--to", "jsonl")
    rows = listen(words, trial.environment(), folder).splitlines()
    if len(rows) != 2 or not all('"data":[7]' in row for row in rows):  # noqa: PLR2004
        raise SystemExit(f"tap: {rows}")


def main() -> int:
    """Try the wheels of the targets that are named; gives the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="+", choices=TARGETS, metavar="TARGET")
    parser.add_argument("--quick", action="store_true", help="those of `make quick-wheels`")
    options = parser.parse_args()
    for name in options.targets:
        tag = sorted(TARGETS[name].platforms)[0]
        (wheel,) = (QUICK_DIST if options.quick else DIST).glob(f"modlens-*-cp311-abi3-*{tag}*.whl")
        start = time.monotonic()
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            trial = Trial(wheel, name.rpartition("-")[2], folder)
            try_recording(trial, folder, quick=options.quick)
            if not trial.is_emulated:
                try_tap(trial, folder)
        seconds = time.monotonic() - start
        tap = "; no tap: qemu-user knows no TCSETS2" if trial.is_emulated else " and tap"
        sys.stdout.write(f"{name}: demo, exports{tap}, {seconds:.0f} s\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
