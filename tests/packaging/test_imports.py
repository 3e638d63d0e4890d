"""What importing and starting costs: nothing that is not used is loaded."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.conftest import CAPTURES, ROOT, command, environment

BUDGET_S = 0.080
RUNS = 11

SCREEN, PORT, CAPTURE = "rich", "serial", "scapy"
EXTRAS = (
    "duckdb",
    "pandas",
    "hypothesis",
    "importlinter",
    "mypy",
    "polars",
    "pyarrow",
    "pymodbus",
    "pytest",
)

LOADED = """
import json, sys
{code}
print(json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})), file=sys.stderr)
"""


def loaded(code: str) -> set[str]:
    """The top-level modules that are there after some code has run in a fresh interpreter."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED.format(code=code)],
        cwd=ROOT, env=environment(), capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stderr.splitlines()[-1]))


RECORDING = str(CAPTURES / "seed_rtu" / "recording.hex")

HARMLESS = {
    "import analyzer": "import analyzer",
    "from analyzer import decode, tap": "from analyzer import decode, tap",
    "decode": f"from analyzer import decode; assert len(list(decode({RECORDING!r}))) > 9",
    "dissectors": "import dissectors.table, dissectors.explain, dissectors.craft",
}


@pytest.mark.parametrize("name", HARMLESS)
def test_the_api_loads_no_screen_port_or_capture_library(name: str) -> None:
    """Who decodes a file from a program has no use for any of them."""
    assert loaded(HARMLESS[name]).isdisjoint({SCREEN, PORT, CAPTURE, *EXTRAS})


def test_a_table_on_the_screen_loads_the_screen_only() -> None:
    """Neither a port nor a capture library is loaded by `modlens decode`; in a pipe no screen."""
    decode = f"from analyzer.cli import main; main(['decode', {RECORDING!r}])"
    assert loaded(decode).isdisjoint({SCREEN, PORT, CAPTURE, *EXTRAS})
    found = loaded(f"import os; os.environ['FORCE_COLOR'] = '1'; {decode}")
    assert SCREEN in found
    assert found.isdisjoint({PORT, CAPTURE, *EXTRAS})


def test_the_api_works_without_any_dependency() -> None:
    """As if nothing but the package were installed: the imports would fail."""
    missing = {SCREEN, PORT, CAPTURE, *EXTRAS}
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({sorted(missing)!r})); {HARMLESS['decode']}"
    )
    assert "analyzer" in loaded(code)


def test_the_dependencies_are_those_that_were_agreed() -> None:
    """YAML's package is required because most register maps are YAML; all others are extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = {text.split(">")[0].strip() for text in project["dependencies"]}
    assert names == {"pyserial", "rich", "ruamel.yaml", "scapy"}


def cpu_seconds(words: Sequence[str]) -> float:
    """The median of what a program took; CPU time, because the machine has other work."""
    times = []
    for _ in range(RUNS):
        before = os.times()
        subprocess.run(words, cwd=ROOT, env=environment(), capture_output=True, check=True)
        after = os.times()
        times.append(after.children_user + after.children_system
                     - before.children_user - before.children_system)  # fmt: skip
    return statistics.median(times)


@pytest.mark.skipif(os.name != "posix", reason="the CPU time of children is known on POSIX only")
def test_help_starts_quickly() -> None:
    """`modlens --help` within 80 ms over a bare interpreter."""
    installed = Path(sys.executable).with_name("modlens")
    words = [str(installed)] if installed.exists() else command()
    bare = cpu_seconds([sys.executable, "-c", "pass"])
    assert cpu_seconds([*words, "--help"]) - bare < BUDGET_S
