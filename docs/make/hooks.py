"""What mkdocs calls while it builds the site: the reference and the notebook are made here.

Run from the root of the tree (`make docs`), because the pages are made by importing the program.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from docs.make.notebook import notebook_page  # noqa: E402 - the tree has to be on the path
from docs.make.reference import PAGES  # noqa: E402

_OUTSIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+([^)#\s]+)(?:#[^)]*)?\)")
_MOVED = {"analyzer/columns.toml": "reference/columns.md"}
"""A file outside of the site -> the page that shows it."""

_FROM_ELSEWHERE = re.compile(r'<script src="https://[^"]*"></script>')
_OFFLINE_SEARCH = '<script src="{base}pictures/search-from-disk.js"></script>'


def on_config(config: Any) -> Any:
    """The pages of folders are put into the menu where it names a folder."""
    config["nav"] = [_filled(entry, Path(config["docs_dir"])) for entry in config["nav"]]
    return config


def _filled(entry: Any, docs: Path) -> Any:
    if entry == {"Reference": "reference"}:
        return {
            "Reference": [{title: f"reference/{name}.md"} for name, (title, _) in PAGES.items()]
        }
    if entry == {"Causes": "doctor"}:
        pages = sorted(docs.glob("doctor/*.md"), key=lambda page: (page.stem != "index", page.stem))
        named = [f"doctor/{page.name}" for page in pages]
        return {"Causes": ["reference/diagnoses.md", *named] if not named else named}
    return entry


def on_files(files: Any, config: Any) -> Any:
    """Adds the pages that are made: the reference, and the notebook with its pictures."""
    from mkdocs.structure.files import File  # noqa: PLC0415 - only mkdocs calls this

    made: dict[str, str | bytes] = {
        f"reference/{name}.md": make() for name, (_, make) in PAGES.items()
    }
    for name, content in (made | notebook_page()).items():
        old = files.get_file_from_path(name)
        if old is not None:
            files.remove(old)
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A link to a file that is not part of the site becomes the file's name."""
    up = "../" * page.file.src_uri.count("/")

    def inside(match: re.Match[str]) -> str:
        words, target = match.groups()
        if target in _MOVED:
            return f"[{words}]({up}{_MOVED[target]})"
        return (
            match[0]
            if (ROOT / "docs" / target).exists() or "reference/" in target
            else f"`{target}`"
        )

    return _OUTSIDE.sub(inside, markdown)


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """No page loads anything from elsewhere; the search from a disk has a script of its own."""
    own = _OFFLINE_SEARCH.format(base="../" * page.url.count("/"))
    return _FROM_ELSEWHERE.sub(own, output)
