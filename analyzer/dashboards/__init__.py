"""Dashboards for other programs, ready to import: a table of panels, and what makes files of it.

`panels.toml` has the queries; `grafana` puts them into Grafana's JSON. The blueprint for Home
Assistant is a file as it is: its devices announce themselves (`analyzer.feeds.home_assistant`).
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files

from analyzer.dashboards.grafana import dashboard

__all__ = ["DASHBOARDS", "Dashboard"]


@dataclass(frozen=True, slots=True)
class Dashboard:
    """A file for another program: what it is for, and what makes its text."""

    title: str
    text: Callable[[], str]


def _file(name: str) -> str:
    return files(__name__).joinpath(name).read_text(encoding="utf-8")


def _grafana(key: str) -> str:
    table = tomllib.loads(_file("panels.toml"))
    return json.dumps(dashboard(table[key]), indent=2) + "\n"


DASHBOARDS = {
    "grafana": Dashboard(
        "Grafana, from the Prometheus metrics of tap --metrics", lambda: _grafana("prometheus")
    ),
    "grafana-parquet": Dashboard(
        "Grafana with its DuckDB data source, from a folder of Parquet",
        lambda: _grafana("parquet"),
    ),
    "home-assistant": Dashboard(
        "Home Assistant: a blueprint that notifies of trouble on a bus or unit",
        lambda: _file("home_assistant.yaml"),
    ),
}
"""Name -> dashboard."""
