"""Says what to write instead of keywords that a call does not have.

>>> def decode(*, line=None, mode="auto"): ...
>>> refuse(decode, {"baud": 19200, "parity": "E"})
Traceback (most recent call last):
modlens.UsageError: decode has no 'baud'; write line="19200-8E1"
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dissectors.errors import UsageError
from dissectors.function_lookup import similar_name

__all__ = ["OF_FRAMES", "OF_RECORDINGS", "check_filter", "refuse"]

_LINE = {
    "rate": ("baud", "baudrate", "baud_rate", "rate", "speed"),
    "bits": ("bits", "bytesize", "byte_size", "databits", "data_bits"),
    "parity": ("parity",),
    "stop": ("stop", "stopbits", "stop_bits"),
}
"""The parts of `line`, as other programs name them."""

_INSTEAD = {
    "profile": 'profiles=["1=meter.toml"]',
    "port": "ports=[502]",
    "format": "read_as=",
    "tz": "timezone=",
    "columns": 'select("unit", "status")',
    "framer": 'mode="rtu"',
    "method": 'mode="rtu"',
    **dict.fromkeys(("unit", "units", "slave", "slave_id"), '.where("unit == 1")'),
    **dict.fromkeys(("where", "filter", "select"), '.where("unit == 1")'),
    **dict.fromkeys(("between", "start", "end"), ".where(\"time >= '12:00'\")"),
}

_FILES = {"csv": "csv", "excel": "xlsx", "parquet": "parquet", "json": "jsonl", "sql": "sqlite"}

OF_FRAMES = {
    **dict.fromkeys(("query", "filter"), 'where("unit == 1")'),
    "between": "where(\"time >= '12:00' and time < '13:00'\")",
    **{f"to_{name}": f'write("rows.{ending}")' for name, ending in _FILES.items()},
    **dict.fromkeys(
        ("describe", "dtypes", "groupby", "iloc", "join", "loc", "merge", "pivot_table", "plot",
         "resample", "shape", "sort_values", "tail", "value_counts", "values"),
        "to_pandas(), which gives a DataFrame",
    ),
}  # fmt: skip
"""What to write instead of what a DataFrame has, and rows have not."""

OF_RECORDINGS = {
    **dict.fromkeys(("df", "dataframe", "data"), "transactions.to_pandas()"),
    **dict.fromkeys(("statistics", "summary"), "stats()"),
    **dict.fromkeys(("diagnose", "diagnosis", "verdict"), "doctor()"),
    **dict.fromkeys(("registers", "values"), "readings"),
    "requests": "transactions",
}
"""What to write instead of what people look for in a recording."""


def refuse(call: Callable[..., object], given: Mapping[str, object]) -> None:
    """Raise `UsageError` for the first of these keywords, if there is one."""
    if not given:
        return
    first, known = next(iter(given)), tuple(getattr(call, "__kwdefaults__", None) or ())
    if any(first in names for names in _LINE.values()):
        instead = f'; write line="{_line(given)}"'
    elif first in _INSTEAD:
        instead = f"; write {_INSTEAD[first]}"
    elif hint := similar_name(first, known):
        instead = f"; did you mean {hint!r}?"
    else:
        instead = f"; it has {', '.join(known) or 'no keywords'}"
    raise UsageError(f"{call.__name__} has no {first!r}{instead}")


def _line(given: Mapping[str, object]) -> str:
    """The line settings in these keywords; those that are not given are the usual ones."""

    def part(name: str, usual: str) -> str:
        return next((str(given[word]) for word in _LINE[name] if word in given), usual)

    parity = part("parity", "N").upper()[:1]
    return f"{part('rate', '19200')}-{part('bits', '8')}{parity}{part('stop', '1')}"


def check_filter(text: object, columns: Mapping[str, object]) -> None:
    """Raise `UsageError` for what is no text, and for columns that are given as keywords."""
    if columns:
        conditions = " and ".join(f"{key} == {value!r}" for key, value in columns.items())
        raise UsageError(f'a filter is a text: write where("{conditions}")')
    if not isinstance(text, str):
        raise UsageError('a filter is a text such as where("unit == 1 and exception")')
