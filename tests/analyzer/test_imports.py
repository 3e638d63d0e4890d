"""The package can be imported everywhere: what only POSIX has is guarded."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.conftest import ROOT, environment

POSIX_ONLY = ("termios", "fcntl", "pty", "tty", "pwd", "grp", "resource")

PLATFORM_CHOSEN = ("analyzer.sources.rfc2217",)
"""Modules that derive from a class of pyserial, which imports what the running system has."""

MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for path in (ROOT / "analyzer").rglob("*.py")
    if path.stem != "__main__"
)
MODULES = [module for module in MODULES if module not in PLATFORM_CHOSEN]


@pytest.mark.parametrize("module", MODULES)
def test_a_module_needs_nothing_of_posix(module: str) -> None:
    """As on Windows: the modules are missing, and `os.name` is another."""
    code = f"""
import os, sys
for name in {POSIX_ONLY!r}:
    sys.modules[name] = None
import {module}
"""
    subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT, env=environment(), check=True, timeout=60,
    )  # fmt: skip
