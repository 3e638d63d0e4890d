"""Dashboards load, and ask for nothing that modlens does not write."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import duckdb
import promql_parser
import pytest
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models.dashboard import Dashboard
from ruamel.yaml import YAML

from analyzer.dashboards import DASHBOARDS
from analyzer.exports.recorder import RecordingStatus
from analyzer.feeds.metrics import Metrics
from tests.analyzer.cli.test_triggers import batches
from tests.analyzer.feeds.test_metrics import STATS, scrape
from tests.conftest import CAPTURES, ROOT, Modlens, command, environment

NAMES = ("grafana", "grafana-parquet")
METRIC = re.compile(
    r"\b(?:modbus|modlens)_\w+_(?:total|seconds|seconds_\w+|ratio|value|bytes|works|connected|messages)\b"
)


def grafana(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(DASHBOARDS[name].text())
    return found


def targets(name: str) -> Iterator[dict[str, Any]]:
    for panel in grafana(name)["panels"]:
        yield from panel["targets"]


class Broker:
    """A feed to a broker that has three messages left."""

    is_connected = True
    waiting = 3


@pytest.fixture(scope="module")
def exported() -> dict[str, set[str]]:
    """Every metric that the exporter serves, with its labels."""
    status = RecordingStatus("bus.pcapng", None, False, 100, 0, 0)
    metrics = Metrics(("127.0.0.1", 0), lambda: STATS, Broker(), lambda: status)
    for batch in batches("..x"):
        metrics.put(batch)
    found: dict[str, set[str]] = {"modbus_register_value": {"bus", "unit", "name"}}
    for key in scrape(metrics):
        name, *labels = key.split()
        found.setdefault(name, set()).update(label.partition("=")[0] for label in labels)
    metrics.close()
    return found


def selectors(node: Any) -> Iterator[Any]:
    """The selectors of series in a parsed query."""
    if type(node).__name__ == "VectorSelector":
        yield node
    for name in ("expr", "lhs", "rhs", "vector_selector", "param"):
        below = getattr(node, name, None)
        if below is not None and not isinstance(below, str):
            yield from selectors(below)
    for one in getattr(node, "args", None) or []:
        yield from selectors(one)


def test_queries_ask_for_metrics_and_labels_that_are_served(exported: dict[str, set[str]]) -> None:
    """A query of Prometheus without a series is an empty panel, never an error."""
    asked = 0
    for target in targets("grafana"):
        for one in selectors(promql_parser.parse(target["expr"])):
            asked += 1
            labels = {matcher.name for matcher in one.matchers.matchers}
            assert labels <= exported[one.name], one.name
        legend = set(re.findall(r"{{(\w+)}}", target["legendFormat"]))
        assert legend <= set().union(*exported.values())
    assert asked > 10
    for variable in grafana("grafana")["templating"]["list"][1:]:
        name, label = re.fullmatch(r"label_values\((\w+).*, (\w+)\)", variable["query"]).groups()  # type: ignore[union-attr] # else the test fails
        assert label in exported[name]


@pytest.mark.parametrize("path", sorted((ROOT / "docs").rglob("*.md")), ids=lambda path: path.stem)
def test_documents_name_metrics_that_are_served(path: Path, exported: dict[str, set[str]]) -> None:
    """The cookbook named one that was not."""
    named = set(METRIC.findall(path.read_text("utf-8")))
    formerly = {"modbus_bus_busy_ratio"} if path.stem == "records" else set()
    assert named - formerly <= set(exported)


@pytest.mark.parametrize("name", NAMES)
def test_grafana_knows_every_key(name: str) -> None:
    """Read by Grafana's own types and written again, nothing is missing."""
    ours = grafana(name)
    theirs = json.loads(JSONEncoder().encode(Dashboard.from_json(ours)))
    assert not list(missing(ours, theirs))
    places = [panel["gridPos"] for panel in ours["panels"]]
    cells = [
        (x, y)
        for place in places
        for x in range(place["x"], place["x"] + place["w"])
        for y in range(place["y"], place["y"] + place["h"])
    ]
    assert len(cells) == len(set(cells))
    assert max(x for x, _ in cells) == 23


def missing(ours: Any, theirs: Any, where: str = "") -> Iterator[str]:
    """Keys and items of ours that theirs lacks."""
    if isinstance(ours, dict):
        for key, value in ours.items():
            if value in (None, {}, []):
                continue
            if key not in theirs:
                yield f"{where}.{key}"
            else:
                yield from missing(value, theirs[key], f"{where}.{key}")
    elif isinstance(ours, list):
        for number, (one, other) in enumerate(zip(ours, theirs, strict=True)):
            yield from missing(one, other, f"{where}[{number}]")
    elif ours != theirs:
        yield f"{where}: {ours!r} became {theirs!r}"


@pytest.fixture(scope="module")
def parquet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that the command has written."""
    folder = tmp_path_factory.mktemp("parquet")
    words = command("export", CAPTURES / "pymodbus_disturbed" / "recording.jsonl", "-o")
    subprocess.run(
        [*words, str(folder / "bus.parquet")], check=True, env=environment(), capture_output=True
    )
    return folder


@pytest.mark.parametrize(
    "target", list(targets("grafana-parquet")), ids=lambda one: one["rawSql"][:40]
)
def test_sql_runs_on_what_is_exported(target: dict[str, Any], parquet: Path) -> None:
    """A series has a time, a name and a number."""
    text = target["rawSql"].replace("${folder}", str(parquet))
    text = text.replace("${__from}", "0").replace("${__to}", "4000000000000")
    found = duckdb.connect().execute(
        f"SELECT * REPLACE (CAST(time AS VARCHAR) AS time) FROM ({text})"
        if target["format"] == 0
        else f"SELECT count(*) FROM ({text})"
    )
    rows = found.fetchall()
    assert rows
    if target["format"] == 0:
        assert [name for name, *_ in found.description][:2] == ["time", "metric"]
        assert all(isinstance(value, float) for *_, value in rows)


def test_the_panel_of_answers_counts_right(parquet: Path) -> None:
    """24 of 35 were answered, as the recording's origin says."""
    text = next(iter(targets("grafana-parquet")))["rawSql"].replace("${folder}", str(parquet))
    text = text.replace("${__from}", "0").replace("${__to}", "4000000000000")
    assert duckdb.connect().execute(text).fetchall() == [(24 / 35,)]


def test_the_blueprint_is_one() -> None:
    """YAML with the keys that Home Assistant wants; each input that is used is declared."""
    text = DASHBOARDS["home-assistant"].text()
    yaml = YAML(typ="safe")
    yaml.constructor.add_constructor("!input", lambda _, node: f"input {node.value}")
    found = yaml.load(text)
    assert found["blueprint"]["domain"] == "automation"
    assert {"triggers", "actions", "mode"} <= set(found)
    assert set(re.findall(r"!input (\w+)", text)) == set(found["blueprint"]["input"])


def test_the_command_writes_the_file(modlens: Modlens, tmp_path: Path) -> None:
    for name, one in DASHBOARDS.items():
        assert modlens("dashboards", name, "-o", tmp_path / name).status == 0
        assert (tmp_path / name).read_text("utf-8") == one.text()
    assert "invalid choice" in modlens("dashboards", "kibana").err
