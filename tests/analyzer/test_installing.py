"""What is said about a missing package leads where modlens is installed."""

from __future__ import annotations

import re
import sys
import sysconfig
from pathlib import Path

import pytest

from analyzer.installing import how_to_install
from tests.conftest import ROOT


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An environment whose files can be made up."""
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    return tmp_path


def test_in_a_virtual_environment_it_is_its_python(prefix: Path) -> None:
    """Also where the environment is not active, and `pip` is another one's."""
    assert how_to_install("paho-mqtt") == f"{sys.executable} -m pip install paho-mqtt"


@pytest.mark.parametrize(
    ("python", "shown"),
    [
        ("C:\\modlens\\python.exe", "C:\\modlens\\python.exe"),
        ("C:\\Program Files\\python.exe", '"C:\\Program Files\\python.exe"'),
    ],
)
def test_cmd_takes_the_path_of_windows(
    python: str, shown: str, prefix: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It knows double quotes only."""
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(sys, "executable", python)
    assert how_to_install("paho-mqtt") == f"{shown} -m pip install paho-mqtt"


def test_an_environment_of_pipx(prefix: Path) -> None:
    """Pipx marks its environments with a file, and has a word of its own."""
    (prefix / "pipx_metadata.json").touch()
    assert how_to_install("paho-mqtt") == "pipx inject modlens paho-mqtt"


def test_an_environment_of_uv(prefix: Path) -> None:
    """There is no pip in it."""
    (prefix / "uv-receipt.toml").touch()
    wanted = f"uv pip install --python {sys.executable} paho-mqtt"
    assert how_to_install("paho-mqtt") == wanted


def test_the_python_of_a_distribution(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pip refuses to install there (PEP 668); Debian's package is named if there is one."""
    (tmp_path / "EXTERNALLY-MANAGED").touch()
    monkeypatch.setattr(sys, "prefix", sys.base_prefix)
    monkeypatch.setattr(sysconfig, "get_path", lambda _: str(tmp_path))
    assert "pip install" not in how_to_install("polars")
    if Path("/etc/debian_version").exists():
        assert how_to_install("paho-mqtt") == "apt install python3-paho-mqtt"


def test_no_message_names_what_cannot_be_installed() -> None:
    """No extra of a package that no index has, and no bare `pip install` for others."""
    for folder in ("analyzer", "dissectors", "modlens"):
        for path in (ROOT / folder).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            assert "modlens[" not in text, path
            if path.name not in ("installing.py", "yaml.py"):
                assert not re.search(r"pip3? install", text), path
