"""Draws joined rows: a line for each request, with the client that caused it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from analyzer.views.screen import Screen, fit

__all__ = ["show_joined"]

_WIDTHS = (("time", 24), ("client", 21), ("unit", 7), ("request", 26), ("outcome", 15))
_STYLES = {
    "forwarded": "",
    "repeated": "odd",
    "cached": "note",
    "own_request": "dim",
    "not_covered": "dim",
}


def show_joined(rows: Iterable[Mapping[str, Any]], screen: Screen, *, head: bool) -> None:
    """Show rows, the first time with a head; `delay` is that of the request, or the age."""
    if head:
        screen.line(_joined([(name, width) for name, width in _WIDTHS], "delay ms"), "head")
    for row in rows:
        cells = (
            _time(row.get("time")),
            row.get("upstream_client") or ("" if row.get("upstream_txn") is None else "?"),
            _unit(row),
            _request(row),
            row["outcome"],
        )
        text = _joined(list(zip(cells, (width for _, width in _WIDTHS), strict=True)), _delay(row))
        screen.line(text, _STYLES.get(row["outcome"], "bad"))


def _joined(cells: list[tuple[str, int]], last: str) -> str:
    return "  ".join([*(fit(text, width) for text, width in cells), last]).rstrip()


def _time(text: str | None) -> str:
    """Milliseconds are enough to find a row."""
    return "" if text is None else text[:23] + "Z"


def _unit(row: Mapping[str, Any]) -> str:
    above, below = row.get("upstream_unit"), row.get("unit")
    if above is None or below is None or above == below:
        return str(below if above is None else above)
    return f"{above}>{below}"


def _request(row: Mapping[str, Any]) -> str:
    function = row["function"]
    for verb, key in (("write", "write_"), ("read", "")):
        address, quantity = row.get(f"{key}address"), row.get(f"{key}quantity")
        if address is not None:
            last = f"-{address + quantity - 1}" if quantity and quantity > 1 else ""
            return f"{function} {verb} {address}{last}"
    return f"{function} {row.get('function_name') or ''}".rstrip()


def _delay(row: Mapping[str, Any]) -> str:
    if row.get("cache_age_us") is not None:
        return f"{row['cache_age_us'] / 1e3:.1f} old"
    if row.get("belongs_to") is not None:
        return f"answer to {row['belongs_to']}"
    delay = row.get("gateway_delay_us")
    return "" if delay is None else f"{delay / 1e3:.1f}"
