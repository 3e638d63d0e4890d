"""The sections of the report about registers: what is open, how values moved, equations."""

from __future__ import annotations

import base64
import gzip
import json
import re

import pytest

from analyzer.cli import main
from tests.doctor.test_documents import follows_schema
from tests.support.device_kinds import KINDS
from tests.support.learn_kinds import recording


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of half an hour of DTSD422, a meter of `tests.support.device_kinds`."""
    folder = tmp_path_factory.mktemp("learned")
    (folder / "meter.jsonl").write_text(recording(KINDS["dtsd422"], 7, 1800)[0])
    target = folder / "report.html"
    assert main(["report", str(folder / "meter.jsonl"), "--learn", "-o", str(target)]) == 0
    return target.read_text()


def section(page: str, name: str) -> str:
    """A section of the page; empty where it has none."""
    _, begin, rest = page.partition(f'<section id="{name}">')
    return rest.partition("</section>")[0] if begin else ""


def test_what_can_be_settled_is_said_first(page: str) -> None:
    sections = re.findall(r'<section id="(\w+)">', page)
    assert sections.index("settle") < sections.index("learned") < sections.index("equations")
    assert "a value on a display settles its register" in section(page, "settle")


def test_each_value_has_a_strip(page: str) -> None:
    """Voltages of three phases, in volts, and a band that covers the time."""
    [row] = re.findall(r"<tr>(?:(?!</tr>).)*hr 1</td>.*?</tr>", section(page, "learned"))
    assert "measurement" in row
    assert "<td>V</td>" in row
    [outline] = re.findall(r'<path class="c0" d="([^"]+)"', row)
    assert outline.startswith("M0 ")
    assert outline.count("z") == 60


def test_equations_have_what_is_left_over(page: str) -> None:
    """Power is the sum of the phases, as in the plant: four numbers near 1000, rounded."""
    [row] = re.findall(r"<tr>(?:(?!</tr>).)*hr 13 = .*?</tr>", section(page, "equations"))
    assert "hr 13 = hr 15 + hr 17 + hr 19" in row
    assert float(re.findall(r"([\d.]+) %", row)[0]) <= 0.1


def test_the_document_follows_its_schema(page: str) -> None:
    packed = page.partition('<template id="data">')[2].partition("</template>")[0]
    document = json.loads(gzip.decompress(base64.b64decode(packed)))
    follows_schema(document)
    assert [one["unit"] for one in document["learned"]] == [1]


def test_a_page_without_data_has_learned_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "--viewer", "--learn", "-o", "-"]) == 2
    assert "--learn" in capsys.readouterr().err
