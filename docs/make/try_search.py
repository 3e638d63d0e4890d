"""The search of the built site, tried in a browser from the disk, without a server.

    python -m docs.make.try_search

`make docs` runs it. Without Chromium it says so; where MODLENS_CI is 1, that is a failure.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

__all__ = ["main"]

SITE = Path(__file__).parents[2] / "site"
SEARCHES = (
    ("index.html", "termination", ""),
    ("reference/columns.html", "response time", ""),
    ("index.html", "timeout", "symptoms.html"),
    ("index.html", "excel", "cookbook/tables.html"),
)
"""A page, in the root and in a folder, what is searched there, what has to be found first."""

FIRST = 3
"""So many results are seen without scrolling."""

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--virtual-time-budget=30000",
)  # fmt: skip
TIMEOUT_S = 300
_RESULT = re.compile(r'<a href="([^"]+)" class="md-search-result__link"')


def main() -> int:
    """Try each search; gives the exit status."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        sys.stderr.write("the search is not tried: no chromium\n")
        return int(os.environ.get("MODLENS_CI") == "1")
    wrong = [why for search in SEARCHES if (why := _trouble(browser, *search))]
    sys.stderr.writelines(f"{why}\n" for why in wrong)
    return int(bool(wrong))


def _trouble(browser: str, page: str, words: str, wanted: str) -> str | None:
    """What is wrong with a search; None where it finds pages, which are there."""
    links = _RESULT.findall(_shown(browser, f"{(SITE / page).as_uri()}?q={quote(words)}"))
    if not links:
        return f"{page}: a search for {words!r} finds nothing"
    if not any(wanted in link for link in links[:FIRST]):
        return f"{page}: a search for {words!r} finds {', '.join(links[:FIRST])}, not {wanted}"
    gone = [link for link in links if not Path(unquote(urlsplit(link).path)).is_file()]
    return f"{page}: found pages that are not there: {', '.join(gone)}" if gone else None


def _shown(browser: str, address: str) -> str:
    """The page as it is once its scripts have run."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [browser, *FLAGS, f"--user-data-dir={folder}", "--dump-dom", address],
            capture_output=True,
            text=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
