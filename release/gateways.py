"""Builds the tap for gateways, a static binary without Python, and checks it: `make gateway`.

python -m release.gateways                  # all of release/targets.py, into dist/
python -m release.gateways --deb aarch64    # this one only, and its package for Debian
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path

from elftools.elf.elffile import ELFFile

from release.rust import ROOT, environment
from release.targets import GATEWAYS, MACHINES, Gateway
from release.wheels import DIST

MAX_BYTES = 8_000_000
BUILD_DEB = ROOT / "release" / "gateway" / "build_deb.sh"


class BinaryError(Exception):
    """What is wrong with a binary."""


def build(name: str) -> Path:
    """Build the binary for a machine; gives its path."""
    triple = GATEWAYS[name].triple
    words = ["cargo-zigbuild", "zigbuild", "--quiet", "--release", "--locked"]
    words += ["--package", "modlens-tap", "--target", triple]
    page = ROOT / "target" / "live.html"
    write_page = [sys.executable, "-m", "analyzer", "page", "--live", "-o", str(page)]
    subprocess.run(write_page, cwd=ROOT, check=True)
    env = environment([triple]) | {"MODLENS_PAGE": str(page)}
    subprocess.run(words, cwd=ROOT, env=env, check=True)
    DIST.mkdir(exist_ok=True)
    return Path(shutil.copy(ROOT / "target" / triple / "release" / "modlens-tap", binary(name)))


def binary(name: str) -> Path:
    """Where the binary for a machine is."""
    return DIST / f"modlens-tap-{name}"


def check(path: Path, gateway: Gateway) -> None:
    """Raise `BinaryError` where it is for another machine, needs a file beside it, or is large."""
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BinaryError(f"{size:,} bytes; it should have {MAX_BYTES:,} at most")
    with path.open("rb") as file:
        elf = ELFFile(file)
        if elf["e_machine"] != gateway.elf:
            raise BinaryError(f"for {elf['e_machine']}, not for {gateway.elf}")
        # Without an interpreter nobody would load the libraries that it needs.
        if any(one["p_type"] == "PT_INTERP" for one in elf.iter_segments()):
            raise BinaryError("it is not static")


def main() -> int:
    """Build and check what the command line names; gives the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", metavar="MACHINE", help=", ".join(GATEWAYS))
    parser.add_argument("--deb", action="store_true", help="and a package of Debian")
    options = parser.parse_args()
    names = options.machines or list(GATEWAYS)
    unknown = sorted(set(names) - set(GATEWAYS))
    if unknown:
        parser.error(f"no such machine: {', '.join(unknown)}; choose from {', '.join(GATEWAYS)}")
    for name in names:
        start = time.monotonic()
        path = build(name)
        check(path, GATEWAYS[name])
        seconds, size = time.monotonic() - start, path.stat().st_size / 1e6
        sys.stdout.write(f"{name}: {path.name}, {size:.1f} MB, {seconds:.0f} s, static\n")
        sys.stdout.flush()
        if options.deb:
            debian = MACHINES[GATEWAYS[name].machine].debian
            subprocess.run([BUILD_DEB, path, debian], check=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
