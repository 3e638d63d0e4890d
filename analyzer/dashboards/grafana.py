"""Grafana's JSON of a dashboard, from a table of panels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["dashboard"]

SCHEMA_VERSION = 39
"""Of Grafana 10 and 11; later ones migrate it."""

_WIDTH = 24
_DATASOURCE = "${datasource}"

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "stat": {
        "graphMode": "area",
        "colorMode": "value",
        "justifyMode": "auto",
        "textMode": "auto",
        "orientation": "auto",
        "wideLayout": True,
        "showPercentChange": False,
        "percentChangeColorMode": "standard",
        "reduceOptions": {"calcs": ["lastNotNull"], "fields": "", "values": False},
    },
    "timeseries": {
        "legend": {"displayMode": "list", "placement": "bottom", "showLegend": True, "calcs": []},
        "tooltip": {"mode": "multi", "sort": "desc"},
    },
    "table": {"frameIndex": 0, "showHeader": True},
}
"""What Grafana's schema requires of the panels of each plugin."""

Table = Mapping[str, Any]


def dashboard(table: Table) -> dict[str, Any]:
    """The dashboard: panels from left to right in rows of their height, and its variables."""
    source = {"type": table["datasource"], "uid": _DATASOURCE}
    return {
        "uid": table["uid"],
        "title": table["title"],
        "description": table["description"],
        "tags": ["modbus", "modlens"],
        "schemaVersion": SCHEMA_VERSION,
        "editable": True,
        "refresh": table.get("refresh", ""),
        "time": {"from": table["from"], "to": "now"},
        "templating": {
            "list": [_datasource(table), *(_variable(v, source) for v in table["variable"])]
        },
        "annotations": {"list": []},
        "panels": _panels(table["panel"], source),
    }


def _datasource(table: Table) -> dict[str, Any]:
    return {
        "type": "datasource",
        "name": "datasource",
        "label": "Data source",
        "query": table["datasource"],
    }


def _variable(one: Table, source: Table) -> dict[str, Any]:
    """A variable: a text to type, or the values that a query finds."""
    if "text" in one:
        return {
            "type": "textbox",
            "name": one["name"],
            "label": one["label"],
            "query": one["text"],
            "current": {"text": one["text"], "value": one["text"]},
        }
    return {
        "type": "query",
        "name": one["name"],
        "label": one["label"],
        "datasource": dict(source),
        "query": one["query"],
        "refresh": 2,
        "sort": 3,
        "multi": True,
        "includeAll": True,
        "allValue": ".*",
        "current": {"text": "All", "value": "$__all"},
    }


def _panels(rows: Sequence[Table], source: Table) -> list[dict[str, Any]]:
    panels, x, y, line_height = [], 0, 0, 0
    for number, row in enumerate(rows, 1):
        if x + row["width"] > _WIDTH:
            x, y, line_height = 0, y + line_height, 0
        place = {"x": x, "y": y, "w": row["width"], "h": row["height"]}
        panels.append(_panel(number, row, source, place))
        x, line_height = x + row["width"], max(line_height, row["height"])
    return panels


def _panel(number: int, row: Table, source: Table, place: dict[str, int]) -> dict[str, Any]:
    defaults: dict[str, Any] = {"unit": row.get("unit", "short")}
    if "min" in row:
        defaults["min"] = row["min"]
    if "limits" in row:
        steps = [{"color": "green", "value": None}]
        steps += [{"color": color, "value": value} for color, value in row["limits"].items()]
        defaults["thresholds"] = {"mode": "absolute", "steps": steps}
    return {
        "id": number,
        "type": row["type"],
        "title": row["title"],
        "description": row["help"],
        "datasource": dict(source),
        "gridPos": place,
        "fieldConfig": {"defaults": defaults, "overrides": []},
        "options": dict(_OPTIONS[row["type"]]),
        "targets": [{"refId": "A", "datasource": dict(source), **_target(row)}],
    }


def _target(row: Table) -> dict[str, Any]:
    """The query of a panel, in the words of its data source."""
    if "sql" in row:
        return {"rawSql": row["sql"].strip(), "format": 0 if row["type"] == "timeseries" else 1}
    is_now = row["type"] in ("stat", "table")
    return {
        "expr": row["promql"].strip(),
        "legendFormat": row.get("legend", "__auto"),
        "instant": is_now,
        "range": not is_now,
        "format": "table" if row["type"] == "table" else "time_series",
    }
