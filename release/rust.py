"""What a build for another system needs: Rust's standard library, and zig for C and linking."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

__all__ = ["ROOT", "environment"]

ROOT = Path(__file__).parents[1]


def environment(triples: Sequence[str]) -> dict[str, str]:
    """The variables for a build for these systems, by maturin or by cargo-zigbuild.

    Rust's standard library is fetched where it is missing. Rust's servers do not have it for every
    system and version; then its source is compiled along, for a minute.
    """
    scripts = str(Path(sys.executable).parent)
    env = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
    if not all(_have_standard_library(triple) for triple in triples):
        subprocess.run(["rustup", "component", "add", "rust-src"], cwd=ROOT, check=True)
        env |= {"RUSTC_BOOTSTRAP": "1", "CARGO_UNSTABLE_BUILD_STD": "std,panic_unwind"}
        for triple in triples:
            if "-musl" in triple:
                # The start files of musl come with the standard library; zig has its own.
                name = f"CARGO_TARGET_{triple.upper().replace('-', '_')}_RUSTFLAGS"
                env[name] = "-C link-self-contained=no"
    return env


def _have_standard_library(triple: str) -> bool:
    """Make Rust's standard library for a system available; whether that could be done."""
    if shutil.which("rustup") is None:
        return True  # a distribution's Rust has what it has
    words = ["rustup", "target", "add", triple]
    return subprocess.run(words, cwd=ROOT, capture_output=True, check=False).returncode == 0
