"""Both sides of a gateway: a capture of the network joined with a recording of its serial line.

The core matches (`_modlens.Join`); this module feeds it the side of which less was read, and
knows the columns of its rows: the table `joined.toml`.

>>> [column.key for column in joined_columns()][:4]
['time', 'txn', 'upstream_txn', 'upstream_client']
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from functools import cache
from importlib import resources
from typing import Any

import _modlens
from analyzer.columns import Column, columns

__all__ = ["JoinedRow", "join", "joined_columns", "outcomes", "sentences", "time_text"]

JoinedRow = Mapping[str, Any]
"""A row: a value for each column; `time_ns` is the time as a number."""

_ONE_YEAR_NS = 31_536_000_000_000_000
_PPM_DIGITS = 1


@cache
def _table() -> dict[str, Any]:
    text = resources.files("analyzer").joinpath("joined.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


@cache
def joined_columns() -> tuple[Column, ...]:
    """The columns of a joined row, in order."""
    copied = {column.key: column for column in columns("transactions")}
    rows = _table()["columns"]
    return tuple(Column(**row) if "type" in row else copied[row["key"]] for row in rows)


def outcomes() -> dict[str, str]:
    """What a gateway does with requests, and what each word means."""
    found: dict[str, str] = _table()["outcomes"]
    return found


def join(
    sides: Mapping[str, Iterator[_modlens.Batch]], core: _modlens.Join
) -> Iterator[list[JoinedRow]]:
    """Feed batches of both sides, `network` and `line`, to `core`; gives rows as they are certain.

    It ends without rows where the two have no traffic in common (`core.is_aligned`).
    """
    while (side := core.wants()) is not None:
        batch = next(sides[side], None)
        if batch is None:
            core.end(side)
        else:
            core.add(side, batch)
        yield [{**row, "time": time_text(row["time_ns"])} for row in json.loads(core.rows())]


def time_text(ns: int) -> str | None:
    """A time as the tables write it; None where it is only a time since the start.

    >>> time_text(1_700_000_000_000_000_001)
    '2023-11-14T22:13:20.000000001Z'
    """
    if ns < _ONE_YEAR_NS:
        return None
    seconds, rest = divmod(ns, 1_000_000_000)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest:09d}Z"


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """What was found about the gateway, a sentence each; `summary` is that of the core."""
    yield (
        f"gateway {summary['server']}: {summary['line_matched']} of"
        f" {summary['line_transactions']} transactions on the line were caused by the network"
    )
    clocks = summary["clocks"]
    if clocks:
        yield _clock(clocks)
    if summary["rival_offset_s"] is not None:
        yield (
            "the traffic is too regular to be sure of the offset:"
            f" {summary['rival_offset_s']:.3f} s fits as well"
        )
    renamed = {above: below for above, below in summary["units"].items() if above != str(below)}
    if renamed:
        pairs = ", ".join(f"{above} is {below} on the line" for above, below in renamed.items())
        yield f"the gateway renames units: {pairs}"
    yield ", ".join(f"{count} {word}" for word, count in summary["outcomes"].items())
    yield from _timeouts(summary["gateway_timeout_ms"], summary["client_timeout_ms"])


def _clock(clocks: Mapping[str, Any]) -> str:
    offset, error = clocks["offset_s"], clocks["offset_error_s"]
    ahead = "ahead of" if offset >= 0 else "behind"
    text = f"the line's clock is {abs(offset):.4f} s {ahead} the network's (± {error * 1e3:.1f} ms)"
    drift = clocks["drift_ppm"]
    if drift is not None:
        gains = "gains" if drift >= 0 else "loses"
        text += f" and {gains} {abs(drift):.{_PPM_DIGITS}f} ppm"
        text += f" (± {clocks['drift_error_ppm']:.{_PPM_DIGITS}f})"
    if not clocks["is_straight"]:
        text += "; one of them was set: no even rate fits all exchanges"
    return text


def _timeouts(gateway_ms: float | None, client_ms: float | None) -> Iterator[str]:
    if gateway_ms is not None:
        yield f"the gateway gives up after {gateway_ms:.0f} ms"
    if client_ms is not None:
        yield f"the client gives up after {client_ms:.0f} ms"
    if gateway_ms is not None and client_ms is not None and client_ms < gateway_ms:
        yield (
            "the client gives up before the gateway: answers can come after it has, and be taken"
            " for those to the next request; set the client's timeout above the gateway's"
        )
