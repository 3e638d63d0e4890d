"""The border's stub says what the built module has: names, signatures, defaults."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import _modlens

ROOT = Path(__file__).parents[2]
STUB = ROOT / "_modlens.pyi"

ALLOWED = """
# A row's attributes are the columns of its table; the stub has them as __getattr__.
_modlens.Row.__getattr__
# pyo3 makes these; nobody imports them.
_modlens.__all__
_modlens._modlens
"""


def test_the_stub_agrees_with_the_module(tmp_path: Path) -> None:
    """The stub is compared with the module by mypy's stubtest."""
    allowed = tmp_path / "allowed"
    allowed.write_text(ALLOWED)
    options = ["--allowlist", str(allowed), "--ignore-unused-allowlist", "--concise"]
    command = [sys.executable, "-m", "mypy.stubtest", "_modlens", *options]
    # In the root of the tree the stub is found before the copy that was installed with the module.
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def documented() -> list[tuple[str, bool]]:
    """Return every public name of the stub with whether it has a text."""
    found = []
    tree = ast.parse(STUB.read_text())
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            found.append((node.name, ast.get_docstring(node) is not None))
    return found


@pytest.mark.parametrize(("name", "has_text"), documented())
def test_every_name_is_documented_and_built(name: str, has_text: bool) -> None:
    """The border is private, but others have to work with it."""
    assert has_text
    assert hasattr(_modlens, name)


def test_nothing_is_built_that_the_stub_hides() -> None:
    """Every public name of the module is in the stub."""
    built = {name for name in dir(_modlens) if not name.startswith("_")}
    assert built <= {name for name, _ in documented()}
