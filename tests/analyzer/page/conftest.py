"""The page, and browsers that have it open."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from analyzer.page import CORE, page
from tests.conftest import without
from tests.support.browser import Browser, running


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page as a file."""
    if not CORE.exists():
        without("the compiled core of the page (make page)")
    path = tmp_path_factory.mktemp("page") / "modlens.html"
    path.write_bytes(page())
    return path


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser for all tests of the page."""
    with running(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture
def opened(browser: Browser, written: Path) -> Browser:
    """The page, opened from the disk."""
    browser.open(written, "ready")
    return browser
