"""DataFrames of pandas: typed rows, values over time, outages, response times.

pandas and pyarrow are imported when one of these is called; without them it is a `UsageError`.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, Protocol

from analyzer.doubts import warn
from analyzer.installing import how_to_install
from dissectors.errors import UsageError

__all__ = ["library", "outages", "response_times", "typed", "wide"]

CATEGORIES = frozenset((
    "bus", "client", "server", "mode", "function_name", "operation", "register_type", "status",
    "exception_name", "name", "unit_of_measure", "verdict", "direction", "delimited_by", "code",
    "severity", "impact", "advice", "line", "certainty", "closed_by",
))  # fmt: skip
"""Columns of texts that come again and again."""

RULES = ("last", "first", "mean", "min", "max")
"""How several values of one interval become one."""

LEAST_REQUESTS = 3


class Rows(Protocol):
    """Rows of a table, as `analyzer.rows.Rows` has them."""

    name: str

    def select(self, *keys: str) -> Any:
        """These columns only."""

    def where(self, text: str) -> Any:
        """The rows that match a filter."""


def library(name: str) -> Any:
    """A library that is only needed here; `UsageError` where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise UsageError(f"{name} is not installed: {how_to_install(name)}") from None


def typed(table: Any) -> Any:
    """A `pyarrow.Table` of rows as a DataFrame whose columns keep their types.

    Texts that come again are categories, whole numbers and truth values may be missing (`Int64`,
    `boolean`), times have their zone.
    """
    pandas, arrow = library("pandas"), library("pyarrow")
    integers = {arrow.int64(): pandas.Int64Dtype(), arrow.bool_(): pandas.BooleanDtype()}
    categories = [name for name in table.column_names if name in CATEGORIES]
    return table.to_pandas(categories=categories, types_mapper=integers.get)


def wide(readings: Rows, every: str | None, how: str) -> Any:
    """Values over time, a column for each name; see `analyzer.rows.Rows.wide`."""
    pandas = library("pandas")
    if readings.name != "readings":
        raise UsageError(
            f"wide() is of readings, not of {readings.name}: recording.readings.wide()"
        )
    if how not in RULES:
        raise UsageError(f"how={how!r}; it is one of {', '.join(RULES)}")
    place = ("bus", "unit", "register_type", "address")
    keys = ("time", "elapsed_us", *place, "name", "unit_of_measure", "value")
    found = typed(readings.where("value is not None").select(*keys).to_arrow())
    found["column"] = _labels(found)
    index = _moments(pandas, found)
    table = found.assign(value=found["value"].astype("float64")).pivot_table(
        index=index, columns="column", values="value", aggfunc=how, observed=True, sort=False
    )
    table = table.sort_index()
    table.columns.name = None
    if every is not None and not table.empty:
        # An interval without a value stays empty: nothing is carried over a gap.
        table = getattr(table.resample(_interval(pandas, every)), how)()
    measured = found.dropna(subset="unit_of_measure").drop_duplicates("column")
    table.attrs["units"] = dict(zip(measured["column"], measured["unit_of_measure"], strict=True))
    return table


def outages(transactions: Rows, requests: int) -> Any:
    """Stretches in which a unit did not answer; see `analyzer.api.Decoding.outages`."""
    pandas = library("pandas")
    if requests < 1:
        raise UsageError(f"requests={requests}: how many in a row make an outage, 1 or more")
    keys = ("time", "elapsed_us", "bus", "unit", "status")
    asked = typed(transactions.select(*keys).to_arrow())
    asked = asked[asked["status"].isin(["ok", "exception", "no_response", "bad_response"])]
    asked["at"] = _moments(pandas, asked)
    runs = []
    for _, rows in asked.groupby(["bus", "unit"], observed=True, sort=False):
        silent = rows["status"] == "no_response"
        for _, run in rows[silent].groupby((~silent).cumsum()[silent]):
            if len(run) >= requests:
                after = rows.index[rows.index > run.index[-1]]
                runs.append((run.index[0], run.index[-1], after[0] if len(after) else -1, len(run)))
    first, last, after, counts = zip(*runs, strict=True) if runs else ((), (), (), ())

    def at(rows: Sequence[int]) -> Any:
        return asked["at"].reindex(list(rows)).reset_index(drop=True)

    table = asked.loc[list(first), ["bus", "unit"]].reset_index(drop=True)
    table = table.assign(begin=at(first), end=at(after), duration=at(after) - at(first))
    table = table.assign(last_request=at(last), requests=list(counts))
    return table.sort_values("begin", ignore_index=True)


def response_times(transactions: Rows, by: str | Sequence[str], every: str | None) -> Any:
    """How fast requests were answered; see `analyzer.api.Decoding.response_times`."""
    pandas = library("pandas")
    keys = [by] if isinstance(by, str) else list(by)
    asked = transactions.where("response_time_us is not None or status in ('ok', 'exception')")
    columns = dict.fromkeys(("time", "elapsed_us", *keys, "response_time_us"))
    found = typed(asked.select(*columns).to_arrow())
    groups: list[Any] = list(keys)
    if every is not None:
        frequency = _interval(pandas, every)
        found["interval"] = _moments(pandas, found)
        groups.insert(0, pandas.Grouper(key="interval", freq=frequency))
    times = found.groupby(groups, observed=True, dropna=False)["response_time_us"]
    columns_by_name = {
        "answered": times.size(),
        "count": times.count(),
        "p50_us": times.quantile(0.5),
        "p95_us": times.quantile(0.95),
        "max_us": times.max(),
    }
    table = pandas.DataFrame(columns_by_name)
    table = table[table["answered"] > 0]
    few = table[(table["count"] > 0) & (2 * table["count"] < table["answered"])]
    if len(few):
        row = few.iloc[0]
        warn(
            f"in {len(few)} of {len(table)} rows fewer than half of the answers have a time (in the"
            f" first {row['count']:.0f} of {row['answered']:.0f}); a coarse clock times slow"
            " answers only: compare count with answered"
        )
    return table


def _labels(found: Any) -> Any:
    """The column of each reading: its name, with unit and bus where several have that name."""
    place = found["register_type"].astype(str) + " " + found["address"].astype(str)
    named = found["name"].notna()
    label = found["name"].astype(object).where(named, place)
    owners = found.assign(label=label).groupby("label")
    several = owners["unit"].transform("nunique") > 1
    unit = "unit " + found["unit"].astype(str) + " "
    label = label.where(named & ~several, unit + label)
    if found["bus"].nunique() > 1:
        label = found["bus"].astype(str) + " " + label
    return label


def _moments(pandas: Any, found: Any) -> Any:
    """When each row was: times, or times since the start where the recording has no others."""
    if found["time"].notna().all():
        return found["time"]
    if found["elapsed_us"].isna().any():
        raise UsageError("this recording has no times; rows have numbers only (txn)")
    return pandas.to_timedelta(found["elapsed_us"], unit="us").rename("elapsed")


def _interval(pandas: Any, every: str) -> Any:
    """An interval as pandas spells it; `UsageError` for what is none."""
    try:
        return pandas.tseries.frequencies.to_offset(every)
    except (ValueError, TypeError):
        raise UsageError(
            f"every={every!r}: not an interval; write '10s', '15min', '1h' or '1D'"
        ) from None
