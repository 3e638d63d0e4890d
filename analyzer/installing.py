"""How a package that modlens can use is installed beside it, wherever modlens came from.

A bare `pip install` often leads elsewhere: into another environment than that of `pipx` or `uv`, or
to a Python whose packages are the distribution's.
"""

from __future__ import annotations

import importlib.util
import shlex
import sys
import sysconfig
from pathlib import Path

__all__ = ["how_to_install"]

_DEBIAN = {
    "matplotlib": "python3-matplotlib",
    "paho-mqtt": "python3-paho-mqtt",
    "pandas": "python3-pandas",
    "prometheus-client": "python3-prometheus-client",
    "XlsxWriter": "python3-xlsxwriter",
    "zstandard": "python3-zstandard",
}
"""What Debian and its descendants call the packages that they have."""


def how_to_install(package: str) -> str:
    """The command that installs a package for this very modlens."""
    prefix = Path(sys.prefix)
    if (prefix / "pipx_metadata.json").exists():
        return f"pipx inject modlens {package}"
    if (prefix / "uv-receipt.toml").exists() or importlib.util.find_spec("pip") is None:
        return f"uv pip install --python {_quoted(sys.executable)} {package}"
    if _is_managed_by_distribution():
        if package in _DEBIAN and Path("/etc/debian_version").exists():
            return f"apt install {_DEBIAN[package]}"
        return f"install modlens into a virtual environment, and {package} with it"
    return f"{_quoted(sys.executable)} -m pip install {package}"


def _is_managed_by_distribution() -> bool:
    """Whether pip refuses to install here (PEP 668)."""
    marker = Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED")
    return sys.prefix == sys.base_prefix and marker.exists()


def _quoted(path: str) -> str:
    r"""A path as the shell takes it; cmd.exe knows double quotes only, and needs none for `\\`."""
    if sys.platform == "win32":
        return f'"{path}"' if " " in path else path
    return shlex.quote(path)
