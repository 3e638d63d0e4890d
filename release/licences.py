"""Writes THIRD_PARTY_LICENSES.txt: the texts of the licences of everything compiled in.

    python -m release.licences            # writes the file
    python -m release.licences --check    # exit status 1 where it is not what it would write

A crate that leaves the choice is taken under MIT. The text is the one that comes along with the
crate; a crate without one gets the standard text with the authors that it names.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
OUTPUT = ROOT / "THIRD_PARTY_LICENSES.txt"
PACKAGES = ("modlens-py", "modlens-tap")
SYSTEMS = (
    "x86_64-unknown-linux-gnu",
    "armv7-unknown-linux-gnueabihf",
    "x86_64-pc-windows-gnu",
    "aarch64-apple-darwin",
)
"""Targets that differ in the crates that they need."""

RULE = "=" * 80
HEAD = """\
Licences of what is compiled into modlens

modlens itself is under the MIT licence (LICENSE). Its binaries hold the Rust crates below and
Rust's standard library (MIT OR Apache-2.0, https://github.com/rust-lang/rust); binaries for musl
hold musl as well (MIT, https://musl.libc.org). This file is made by `make licences`.
"""
MIT = """\
MIT License

Copyright (c) {authors}

Permission is hereby granted, free of charge, to any person obtaining a copy of this software and
associated documentation files (the "Software"), to deal in the Software without restriction,
including without limitation the rights to use, copy, modify, merge, publish, distribute,
sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all copies or substantial
portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT
NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND
NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES
OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN
CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
"""


def cargo(*words: str) -> str:
    """What a command of Cargo prints."""
    return subprocess.run(
        ["cargo", *words], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout


def compiled_in() -> set[tuple[str, str]]:
    """Name and version of every crate that a binary for one of the systems holds."""
    found = set()
    for package in PACKAGES:
        for system in SYSTEMS:
            tree = cargo(
                "tree", "--locked", "--package", package, "--edges", "normal,no-proc-macro",
                "--target", system, "--prefix", "none", "--format", "{p}",
            )  # fmt: skip
            for line in tree.splitlines():
                name, version = line.split(" ")[:2]
                found.add((name, version.removeprefix("v")))
    return {(name, version) for name, version in found if not name.startswith("modlens")}


def texts_of(crate: dict[str, Any], apache: str) -> list[str]:
    """The texts that have to go along with a crate: its licence, and a notice if it has one."""
    folder = Path(crate["manifest_path"]).parent
    files = sorted(path for path in folder.iterdir() if path.is_file())
    notices = [path for path in files if path.name.upper().startswith("NOTICE")]
    licences = [path for path in files if path.name.upper().startswith(("LICENSE", "COPYING"))]
    mit = [path for path in licences if path.stem.upper().endswith("-MIT")]
    if "MIT" in crate["license"] and mit:
        licences = mit
    if not licences:
        mine = "MIT" in crate["license"]
        authors = ", ".join(crate["authors"]) or f"the authors of {crate['name']}"
        return [MIT.format(authors=authors) if mine else apache]
    return [path.read_text("utf-8", "replace").strip() + "\n" for path in (*licences, *notices)]


def document() -> str:
    """The whole file: each text once, under the crates that it is for."""
    metadata = json.loads(cargo("metadata", "--locked", "--format-version", "1"))
    wanted = compiled_in()
    crates = [one for one in metadata["packages"] if (one["name"], one["version"]) in wanted]
    apache = next(
        (Path(one["manifest_path"]).parent / "LICENSE.txt").read_text("utf-8")
        for one in crates
        if one["name"] == "parquet"
    )
    users: dict[str, list[str]] = {}
    for crate in sorted(crates, key=lambda one: (one["name"], one["version"])):
        for text in texts_of(crate, apache):
            users.setdefault(text, []).append(f"{crate['name']} {crate['version']}")
    parts = [f"{RULE}\n{', '.join(names)}\n{RULE}\n\n{text}" for text, names in users.items()]
    return "\n".join([HEAD, *parts])


def write_or_check(output: Path, document: Callable[[], str], description: str) -> int:
    """Write a generated file, or with `--check` compare it; gives the exit status."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    is_check = parser.parse_args().check
    text = document()
    if is_check:
        same = output.is_file() and output.read_text("utf-8") == text
        if not same:
            sys.stderr.write(f"{output.name} is not up to date: make licences\n")
        return int(not same)
    output.write_text(text, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(write_or_check(OUTPUT, document, __doc__))
