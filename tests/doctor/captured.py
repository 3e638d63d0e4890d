"""The recordings of `captures/`, and which of them are healthy by their own description."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator

from tests.conftest import CAPTURES

__all__ = ["healthy_captures"]


def healthy_captures() -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Name, file below `captures/`, and the words behind the command, of each healthy one."""
    for folder in sorted(path for path in CAPTURES.iterdir() if path.is_dir()):
        about = tomllib.loads((folder / "about.toml").read_text(encoding="utf-8"))
        if about["healthy"]:
            words = about["command"].split()[3:]
            yield folder.name, f"{folder.name}/{about['file']}", tuple(words)
