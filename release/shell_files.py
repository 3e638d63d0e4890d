"""Writes completion scripts and manual pages from the parsers, for the wheel: `make shell-files`.

They are kept in the tree, because a wheel is built from it without running anything; a test
compares them with the parsers.
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

from release.completion import bash, fish, zsh
from release.man_pages import overview, page
from release.options import commands

__all__ = ["FOLDER", "files"]

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "release" / "modlens.data" / "data" / "share"


def files() -> dict[str, str]:
    """The text of every file, by its path below `share/`."""
    version = tomllib.loads((ROOT / "Cargo.toml").read_text("utf-8"))["workspace"]["package"][
        "version"
    ]
    found = commands()
    return {
        "bash-completion/completions/modlens": bash(found),
        "zsh/site-functions/_modlens": zsh(found),
        "fish/vendor_completions.d/modlens.fish": fish(found),
        "man/man1/modlens.1": overview(found, version),
        **{f"man/man1/modlens-{one.name}.1": page(one, version) for one in found},
    }


def main() -> int:
    """Write the files; gives the exit status."""
    texts = files()
    for path in FOLDER.rglob("*"):
        if path.is_file() and path.relative_to(FOLDER).as_posix() not in texts:
            path.unlink()
    for name, text in texts.items():
        path = FOLDER / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
