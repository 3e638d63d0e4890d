"""Documents of `modlens stats --to json` on the page: the report that the command makes of them."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from analyzer.cli import main
from analyzer.report.page import page
from tests.conftest import CAPTURES, Modlens
from tests.support.browser import Browser
from tests.support.documents import (
    RAN_NOTHING,
    document_of,
    poisoned,
    shows_hostile_texts,
)
from tests.support.page import RECORDINGS, TROUBLE, show

SHOWN = (
    "return document.getElementById('verdict').textContent"
    " + document.getElementById('report').textContent.replaceAll('\\n', '')"
)

REPORT = "return document.getElementById('report').textContent.replaceAll('\\n', '')"


def dropped(browser: Browser, content: Any, folder: Path, state: str = "shown") -> None:
    """Show a document on the page."""
    path = folder / "document.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    show(browser, path, state)


@pytest.mark.parametrize(
    "name", ["pymodbus_disturbed", "pymodbus_tcp", "pymodbus_plant", "seed_ascii"]
)
def test_a_document_is_shown_as_its_report(
    name: str, written: Path, browser: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """The same words, and the same plots in them."""
    document = document_of(modlens, name)
    report = tmp_path / "report.html"
    report.write_bytes(page(document))
    browser.open(report)
    text = browser.run(REPORT)
    browser.open(written, "ready")
    dropped(browser, document, tmp_path)
    assert browser.run(SHOWN) == text
    assert browser.log("browser") == []
    assert not browser.run("return document.getElementById('rows').checkVisibility()")


@pytest.fixture
def in_its_folder(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """The output of a command that names the file without a folder, as a page does."""

    def run(path: Path, command: str, *words: str) -> str:
        with monkeypatch.context() as patch:
            patch.chdir(path.parent)
            assert main([command, path.name, *words]) == 0
        return capsys.readouterr().out

    return run


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.parent.name)
def test_the_document_is_that_of_the_command(
    path: Path, opened: Browser, in_its_folder: Callable[..., str]
) -> None:
    """All of it: what the doctor says, statistics, time series, examples with their bytes."""
    show(opened, path)
    found = opened.ask("Page.ask({ call: 'report' }).then((it) => JSON.stringify(it.document))")
    wanted = in_its_folder(path, "stats", "--to", "json")
    assert json.loads(found) == json.loads(wanted)


def test_the_report_is_saved(
    opened: Browser, in_its_folder: Callable[..., str], tmp_path: Path
) -> None:
    """The file is that of the command but for how the document in it is compressed; it is drawn."""
    path = CAPTURES / "pymodbus_plant" / "recording.jsonl"
    show(opened, path)
    saved = opened.ask("Report.file().then((it) => it.text())")
    of_command = in_its_folder(path, "report", "-o", "-")
    (page_of_page, data), (page_of_command, other) = map(without_data, (saved, of_command))
    assert page_of_page == page_of_command
    assert data == other
    target = tmp_path / "saved.html"
    target.write_text(saved, encoding="utf-8")
    opened.open(target)
    assert opened.run("return document.querySelectorAll('.u-wrap').length") > 3
    assert opened.log("browser") == []


def without_data(text: str) -> tuple[str, Any]:
    """A report without the document in it, and the document."""
    before, _, rest = text.partition('<template id="data">')
    packed, _, after = rest.partition("</template>")
    return before + after, json.loads(gzip.decompress(base64.b64decode(packed)))


def test_the_viewer_is_the_page(written: Path, modlens: Modlens, tmp_path: Path) -> None:
    target = tmp_path / "viewer.html"
    assert modlens("report", "--viewer", "-o", target).status == 0
    assert target.read_bytes() == written.read_bytes()


def test_a_later_document_is_refused(opened: Browser, modlens: Modlens, tmp_path: Path) -> None:
    """So is one that was cut off; another JSON is no document."""
    later = {**document_of(modlens, "pymodbus_disturbed"), "version": 2}
    dropped(opened, later, tmp_path, "refused")
    assert "version 1 of the document, not 2" in opened.run(TROUBLE)
    dropped(opened, json.dumps(later)[:5000], tmp_path, "refused")
    dropped(opened, "{}", tmp_path, "refused")


def test_hostile_texts_are_shown_and_not_run(
    opened: Browser, modlens: Modlens, tmp_path: Path
) -> None:
    """Every text of the document is hostile."""
    opened.requests()
    dropped(opened, poisoned(document_of(modlens, "pymodbus_disturbed")), tmp_path)
    shows_hostile_texts(opened.run("return document.body.innerText"))
    assert opened.run(RAN_NOTHING)
    assert opened.requests() == []
    assert opened.log("browser") == []
