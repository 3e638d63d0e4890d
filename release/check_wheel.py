"""Checks a wheel before anybody installs it.

Its name says the right system and the stable ABI, and its extension uses nothing else of Python; it
is not too large; it holds the list of what was compiled in (SBOM), the licences of that, and
nothing under the GPL.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
import zipfile
from email import message_from_bytes
from pathlib import Path, PurePosixPath

from release.targets import Target

__all__ = ["WheelError", "check"]

ROOT = Path(__file__).parents[1]
LICENCES = ("LICENSE", "THIRD_PARTY.md", "THIRD_PARTY_LICENSES.txt")
PACKAGES = {"_modlens", "modlens", "analyzer", "dissectors"}


class WheelError(Exception):
    """What is wrong with a wheel."""


def check(wheel: Path, target: Target) -> None:
    """Raise `WheelError` where the wheel is not what the target's users need."""
    _check_tags(wheel, target)
    with zipfile.ZipFile(wheel) as archive:
        _check_contents(archive)
        _check_metadata(archive)
        _check_sbom(archive)
    limit = target.max_bytes
    if wheel.stat().st_size > limit:
        raise WheelError(f"{wheel.stat().st_size:,} bytes; it should have {limit:,} at most")
    _audit(wheel)


def _check_tags(wheel: Path, target: Target) -> None:
    *_, python, abi, platforms = wheel.stem.split("-")
    if (python, abi) != ("cp311", "abi3"):
        raise WheelError(f"{wheel.name}: for {python}-{abi}, not for cp311-abi3")
    if not set(platforms.split(".")) <= target.platforms:
        raise WheelError(f"{wheel.name}: not for {', '.join(sorted(target.platforms))}")


def _check_contents(archive: zipfile.ZipFile) -> None:
    names = archive.namelist()
    tops = {name.split("/")[0] for name in names}
    surplus = {top for top in tops if not top.endswith((".dist-info", ".data"))} - PACKAGES
    if surplus:
        raise WheelError(f"it holds {', '.join(sorted(surplus))}")
    extensions = [name for name in names if PurePosixPath(name).suffix in (".so", ".pyd", ".dylib")]
    if len(extensions) != 1:
        raise WheelError(f"extensions: {extensions}")
    for licence in LICENCES:
        found = [name for name in names if name.endswith(f".dist-info/licenses/{licence}")]
        if not found or archive.read(found[0]) != (ROOT / licence).read_bytes():
            raise WheelError(f"{licence} is not in it as it is in the tree")


def _check_metadata(archive: zipfile.ZipFile) -> None:
    (name,) = (one for one in archive.namelist() if one.endswith(".dist-info/METADATA"))
    said = message_from_bytes(archive.read(name))["Version"]
    cargo = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))
    if said != cargo["workspace"]["package"]["version"]:
        raise WheelError(f"version {said}, which is not that of Cargo.toml")


def _check_sbom(archive: zipfile.ZipFile) -> None:
    names = [one for one in archive.namelist() if one.endswith(".cyclonedx.json")]
    if len(names) != 1:
        raise WheelError(f"SBOMs: {names}")
    text = archive.read(names[0]).decode()
    if "file:" in text or str(ROOT) in text:
        raise WheelError("the SBOM names folders of this machine")
    components = {one["name"] for one in json.loads(text)["components"]}
    for crate in ("modlens-engine", "pyo3", "zstd-sys"):
        if crate not in components:
            raise WheelError(f"{crate} is not in its SBOM")


def _audit(wheel: Path) -> None:
    words = [sys.executable, "-m", "abi3audit", "--strict", str(wheel)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise WheelError(f"abi3audit: {done.stdout}{done.stderr}")
