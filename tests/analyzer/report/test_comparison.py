"""The section of the report about what changed: what was planted in a day, and nothing else."""

from __future__ import annotations

import base64
import gzip
import json
from pathlib import Path

import pytest

from analyzer.cli import main
from tests.analyzer.test_baseline import CHANGES, ORDINARY, STRANGER, day
from tests.doctor.test_documents import follows_schema


def section(page: Path) -> str:
    """The section of the page; empty where it has none."""
    _, begin, rest = page.read_text().partition('<section id="changes">')
    return rest.partition("</section>")[0] if begin else ""


def test_a_new_client_is_in_the_report(tmp_path: Path) -> None:
    before = day(tmp_path / "before.pcap", ORDINARY, 1)
    after = day(tmp_path / "after.pcap", CHANGES["new_client"], 2)
    page = tmp_path / "report.html"
    assert main(["report", after, "--against", before, "-o", str(page)]) == 0
    found = section(page)
    assert found.count("<tr>") == 2
    assert "new client" in found
    assert STRANGER in found
    # The days are named by their order: it is the second one that has the stranger.
    assert main(["report", before, "--against", after, "-o", str(page)]) == 0
    assert STRANGER not in section(page)


def test_days_that_are_alike_have_no_difference(tmp_path: Path) -> None:
    files = [day(tmp_path / f"{seed}.pcap", ORDINARY, seed) for seed in (1, 2, 3)]
    page = tmp_path / "report.html"
    words = ["report", files[0], "--against", files[1], "--against", files[2]]
    assert main([*words, "-o", str(page)]) == 0
    assert "No difference." in section(page)
    assert main(["report", files[0], "-o", str(page)]) == 0
    assert section(page) == ""


def test_the_comparison_is_in_the_schema(tmp_path: Path) -> None:

    before = day(tmp_path / "before.pcap", ORDINARY, 1)
    after = day(tmp_path / "after.pcap", CHANGES["missing_request"], 2)
    page = tmp_path / "report.html"
    assert main(["report", after, "--against", before, "-o", str(page)]) == 0
    packed = page.read_text().partition('<template id="data">')[2].partition("</template>")[0]
    document = json.loads(gzip.decompress(base64.b64decode(packed)))
    follows_schema(document)
    [row] = document["comparison"][0]["differences"]
    assert row["code"] == "missing_request"


def test_a_page_without_data_compares_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "--viewer", "--against", "x.pcap", "-o", "-"]) == 2
    assert "--against" in capsys.readouterr().err
