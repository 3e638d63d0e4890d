"""Nothing that only POSIX has is imported where it is not: Windows takes the same modules."""

from __future__ import annotations

import subprocess
import sys

from tests.conftest import ROOT, environment

WITHOUT = ("termios", "fcntl", "tty", "pty", "grp", "pwd", "resource")

SCRIPT = """
import importlib, pkgutil, sys
for name in %r:
    sys.modules[name] = None
import analyzer
for module in pkgutil.walk_packages(analyzer.__path__, "analyzer."):
    # pyserial imports what the running system has, so its classes cannot be loaded as on another.
    if not module.name.endswith(("__main__", "sources.rfc2217")):
        importlib.import_module(module.name)
from analyzer.cli.keys import Keys
from analyzer.sources.serial import mark_errors
with Keys() as keys:
    assert keys.pressed() == []
assert mark_errors(0) is False
"""


def test_every_module_imports_without_what_only_posix_has() -> None:
    """Every module can be imported without the modules that only POSIX has."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT % (WITHOUT,)],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, check=False,
        env=environment(), cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
