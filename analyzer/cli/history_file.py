"""A history of one value from another program: a CSV file with times and numbers.

Home Assistant, Grafana and web pages write such files, with different names, separators and ways to
write times.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from analyzer.cli.import_ import decode_text
from analyzer.times import parse_ns
from dissectors.errors import SourceError, UsageError

__all__ = ["History", "load_history"]

_MOST_ROWS = 200_000
_LEAST_ROWS = 8
_SHARE = 0.8
_HAS_ZONE = re.compile(r".*(?:Z|UTC|[+-]\d\d:?\d\d)$", re.IGNORECASE)
_EPOCH_S, _EPOCH_MS = 4e9, 4e12
_FORMATS = (
    "%d.%m.%Y %H:%M:%S", "%d.%m.%Y %H:%M", "%d/%m/%Y %H:%M:%S", "%d/%m/%Y %H:%M",
    "%m/%d/%Y %I:%M:%S %p", "%m/%d/%Y, %I:%M:%S %p", "%Y/%m/%d %H:%M:%S", "%Y/%m/%d %H:%M",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class History:
    """Times in nanoseconds since 1970 with the value at each, and whether their zone is known."""

    times: Sequence[int]
    values: Sequence[float]
    has_zone: bool


def load_history(path: str, name: str | None) -> History:
    """Read a history; `name` chooses a column, or an entity of a file with several of them.

    `SourceError` where the file has no times or numbers, `UsageError` where the choice is open.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise SourceError(f"{path}: cannot be read: {error.strerror or error}") from error
    head, rows = _table(decode_text(data, None, path)[0])
    times_at = next((i for i in range(len(head)) if _is_times(rows, i)), None)
    if times_at is None:
        raise SourceError(f"{path}: no column of times; write a CSV file with time and value")
    rows = _of_entity(path, head, rows, times_at, name)
    values_at = _value_column(path, head, rows, times_at, name)
    pairs = {}
    for row in rows:
        moment, value = _moment(_cell(row, times_at)), _number(_cell(row, values_at))
        if moment is not None and value is not None:
            pairs[moment[0]] = (value, moment[1])
    if len(pairs) < _LEAST_ROWS:
        raise SourceError(f"{path}: {len(pairs)} values with a time; {_LEAST_ROWS} are needed")
    times = sorted(pairs)
    has_zone = all(pairs[moment][1] for moment in times)
    return History(times, [pairs[moment][0] for moment in times], has_zone)


def _table(text: str) -> tuple[list[str], list[list[str]]]:
    """The head and the rows; the separator is the one that occurs most in the first line."""
    text = text.lstrip("\ufeff")
    first, _, rest = text.partition("\n")
    if first.lower().startswith("sep="):
        first, text = rest.partition("\n")[0], rest
    separator = max(",;\t", key=first.count)
    rows: list[list[str]] = []
    for row in csv.reader(io.StringIO(text), delimiter=separator):
        if len(rows) > _MOST_ROWS:
            break
        if row:
            rows.append([cell.strip() for cell in row])
    if not rows:
        return [], []
    return rows[0], rows[1:]


def _cell(row: Sequence[str], at: int) -> str:
    return row[at] if at < len(row) else ""


def _is_times(rows: Sequence[Sequence[str]], at: int) -> bool:
    cells = [_cell(row, at) for row in rows[:200]]
    return bool(cells) and sum(_moment(cell) is not None for cell in cells) >= _SHARE * len(cells)


def _of_entity(
    path: str, head: Sequence[str], rows: list[list[str]], times_at: int, name: str | None
) -> list[list[str]]:
    """The rows of one entity, where a column names them (Home Assistant's `entity_id`)."""
    for at, title in enumerate(head):
        if at == times_at or title.lower() not in ("entity_id", "entity", "series", "name"):
            continue
        names = sorted({_cell(row, at) for row in rows})
        if name in names:
            return [row for row in rows if _cell(row, at) == name]
        if len(names) > 1:
            raise UsageError(
                f"{path}: several series; choose one with --like {path}:NAME:"
                f" {', '.join(names[:8])}"
            )
    return rows


def _value_column(
    path: str, head: Sequence[str], rows: list[list[str]], times_at: int, name: str | None
) -> int:
    if name in head:
        return head.index(name)
    numeric = [
        at for at in range(len(head))
        if at != times_at and not _is_times(rows, at)
        and sum(_number(_cell(row, at)) is not None for row in rows[:200]) * 2 > len(rows[:200])
    ]  # fmt: skip
    if len(numeric) == 1:
        return numeric[0]
    if not numeric:
        raise SourceError(f"{path}: no column of numbers beside the times")
    titles = ", ".join(head[at] for at in numeric[:8])
    raise UsageError(f"{path}: several columns; choose one with --like {path}:NAME: {titles}")


def _moment(text: str) -> tuple[int, bool] | None:
    """Nanoseconds since 1970, and whether the zone is known; None where it is not a time.

    >>> _moment("2026-06-15 09:30:30"), _moment("1781515830000")
    ((1781515830000000000, False), (1781515830000000000, True))
    """
    number = _number(text)
    if number is not None:
        if _EPOCH_S / 4 < number < _EPOCH_S:
            return int(number * 1e9), True
        return (int(number * 1e6), True) if _EPOCH_MS / 4 < number < _EPOCH_MS else None
    moment = parse_ns(text.removesuffix(" UTC"))
    if moment is not None:
        return (moment, _HAS_ZONE.fullmatch(text) is not None) if ":" in text else None
    for form in _FORMATS:
        try:
            parsed = datetime.strptime(text, form).replace(tzinfo=UTC)
        except ValueError:
            continue
        return int(parsed.timestamp()) * 1_000_000_000, False
    return None


def _number(text: str) -> float | None:
    """A number, also with a decimal comma or a unit after it.

    >>> _number("231,4"), _number("2.5 kW"), _number("unavailable")
    (231.4, 2.5, None)
    """
    match = re.fullmatch(
        r"([+-]?\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)(?:\s*[^\d\s:.,/-][^\d]{0,8})?", text
    )
    return float(match[1].replace(",", ".")) if match else None
