"""Builds wheels for other systems on this one, and checks each: `make wheels`.

    python -m release.wheels                       # all of release/targets.py, into dist/
    python -m release.wheels manylinux-aarch64     # these only
    python -m release.wheels --quick manylinux-x86_64 manylinux-armv7l

Rust compiles for every system; zig, which is a package of Python, compiles the C code and links, so
that no other compiler, container or foreign machine is needed. Builds run one after the other.

`--quick` is for a first look in a minute instead of half an hour, into target/quick: the wheel for
this machine is linked of what `make wheel` has compiled, and others are not optimised.
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
import time
from pathlib import Path

from release.check_wheel import WheelError, check
from release.rust import ROOT, environment
from release.targets import TARGETS, Target

DIST = ROOT / "dist"
QUICK_DIST = ROOT / "target" / "quick-wheels"
STUBS = ROOT / "release" / "macos"
PYTHON = "python3.11"
OLD_GLIBC = "2.17"
"""That of manylinux2014."""


def is_native(target: Target) -> bool:
    """Whether this machine is what the wheel is for."""
    here = f"{platform.machine()}-unknown-linux-gnu"
    return target.compatibility == "manylinux2014" and target.triples == (here,)


def linker_for_old_glibc() -> Path:
    """A program that links for this machine and glibc 2.17, with the options of a C compiler."""
    program = ROOT / "target" / "cc-for-old-glibc"
    zig = Path(sys.executable).with_name("cargo-zigbuild")
    machine = f"{platform.machine()}-linux-gnu.{OLD_GLIBC}"
    program.write_text(f'#!/bin/sh\nexec "{zig}" zig cc -- -target {machine} "$@"\n', "utf-8")
    program.chmod(0o755)
    return program


def build_words(target: Target, *, quick: bool) -> list[str]:
    """Returns the options that say where the wheel goes."""
    if quick and is_native(target):
        # The same interpreter as for `make wheel`, so that nothing else is compiled again.
        linker = f"linker={linker_for_old_glibc()}"
        return ["--release", "--interpreter", sys.executable, "--", "-C", linker]
    profile = "quick" if quick else "release"
    cross = ["--zig", "--target", target.build_triple, "--interpreter", PYTHON]
    return ["--profile", profile, *cross]


def build(target: Target, folder: Path, *, quick: bool = False) -> Path:
    """Build the wheel of a target into a folder; gives its path."""
    before = {path: path.stat().st_mtime_ns for path in folder.glob("*.whl")}
    env = environment(target.triples)
    if target.build_triple.endswith("apple-darwin"):
        # Apple's frameworks are not part of zig; the stub says where they are on a Mac.
        env["SDKROOT"] = str(STUBS)
    words = [
        "maturin", "build", "--locked", "--quiet",
        "--compatibility", target.compatibility,
        "--out", str(folder),
        *build_words(target, quick=quick),
    ]  # fmt: skip
    subprocess.run(words, cwd=ROOT, env=env, check=True)
    found = {path: path.stat().st_mtime_ns for path in folder.glob("*.whl")}
    (wheel,) = (path for path, time_ns in found.items() if before.get(path) != time_ns)
    return wheel


def main() -> int:
    """Build and check what the command line names; gives the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--quick", action="store_true", help="for a trial, not for use")
    options = parser.parse_args()
    names = options.targets or list(TARGETS)
    unknown = sorted(set(names) - set(TARGETS))
    if unknown:
        parser.error(f"no such target: {', '.join(unknown)}; choose from {', '.join(TARGETS)}")
    folder = QUICK_DIST if options.quick else DIST
    folder.mkdir(parents=True, exist_ok=True)
    failed = []
    for name in names:
        start = time.monotonic()
        try:
            wheel = build(TARGETS[name], folder, quick=options.quick)
            check(wheel, TARGETS[name])
        except (subprocess.CalledProcessError, WheelError) as error:
            failed.append(name)
            sys.stdout.write(f"{name}: {error}\n")
            sys.stdout.flush()
            continue
        size = wheel.stat().st_size / 1e6
        seconds = time.monotonic() - start
        sys.stdout.write(f"{name}: {wheel.name}, {size:.1f} MB, {seconds:.0f} s, checked\n")
        sys.stdout.flush()
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
