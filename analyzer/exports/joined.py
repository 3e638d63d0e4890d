"""Files of joined rows: CSV, JSON lines, Markdown and Parquet.

Unlike the tables of a recording, these rows come from the core as JSON.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from analyzer.columns import Column
from analyzer.installing import how_to_install
from analyzer.visible import spreadsheet_cell
from dissectors.errors import UsageError

__all__ = ["JOINED_FORMATS", "JoinedEncoder", "encoder"]

_ROW_GROUP = 65_536

Rows = Sequence[Mapping[str, Any]]


class JoinedEncoder(Protocol):
    """Encodes rows in one format."""

    def rows(self, rows: Rows) -> bytes:
        """Encode further rows."""

    def end(self) -> bytes:
        """Return what follows the last row."""


class _Lines:
    """A format with a line for each row."""

    def __init__(self, columns: Sequence[Column]) -> None:
        self._keys = [column.key for column in columns]
        self._begun = False

    def rows(self, rows: Rows) -> bytes:
        head = "" if self._begun else self._head()
        self._begun = True
        return (head + "".join(map(self._line, rows))).encode()

    def end(self) -> bytes:
        return self.rows(())

    def _head(self) -> str:
        return ""

    def _line(self, row: Mapping[str, Any]) -> str:
        raise NotImplementedError


class _JsonLines(_Lines):
    def _line(self, row: Mapping[str, Any]) -> str:
        found = {key: row[key] for key in self._keys if row.get(key) is not None}
        return json.dumps(found, ensure_ascii=False, separators=(",", ":")) + "\n"


class _Csv(_Lines):
    def _head(self) -> str:
        return ",".join(self._keys) + "\r\n"

    def _line(self, row: Mapping[str, Any]) -> str:
        text = io.StringIO()
        csv.writer(text).writerow([spreadsheet_cell(row.get(key)) for key in self._keys])
        return text.getvalue()


class _Markdown(_Lines):
    def _head(self) -> str:
        return f"| {' | '.join(self._keys)} |\n|{' --- |' * len(self._keys)}\n"

    def _line(self, row: Mapping[str, Any]) -> str:
        cells = (str(spreadsheet_cell(row.get(key))).replace("|", "\\|") for key in self._keys)
        return f"| {' | '.join(cells)} |\n"


class _Parquet:
    """Parquet, by pyarrow; `UsageError` where that is not installed."""

    def __init__(self, columns: Sequence[Column]) -> None:
        try:
            import pyarrow as pa  # noqa: PLC0415 - optional
            import pyarrow.parquet as pq  # noqa: PLC0415
        except ImportError as error:
            raise UsageError(
                f"Parquet of join needs a package: {how_to_install('pyarrow')}"
            ) from error
        types = {
            "int": pa.int64(),
            "us": pa.float64(),
            "time": pa.timestamp("ns", tz="UTC"),
            "ints": pa.list_(pa.int32()),
        }
        self._arrow = pa
        self._columns = columns
        self._schema = pa.schema([(one.key, types.get(one.type, pa.string())) for one in columns])
        self._sink = _Sink()
        self._writer = pq.ParquetWriter(self._sink, self._schema, compression="zstd")
        self._waiting: list[Mapping[str, Any]] = []

    def rows(self, rows: Rows) -> bytes:
        self._waiting.extend(rows)
        if len(self._waiting) >= _ROW_GROUP:
            self._write()
        return self._sink.taken()

    def end(self) -> bytes:
        self._write()
        self._writer.close()
        return self._sink.taken()

    def _write(self) -> None:
        rows, self._waiting = self._waiting, []
        keys = {one.key: "time_ns" if one.type == "time" else one.key for one in self._columns}
        data = {key: [row.get(source) for row in rows] for key, source in keys.items()}
        self._writer.write_table(self._arrow.table(data, schema=self._schema))


class _Sink(io.RawIOBase):
    """Collects what is written until it is taken."""

    def __init__(self) -> None:
        super().__init__()
        self._parts: list[bytes] = []
        self._position = 0

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._parts.append(bytes(data))
        self._position += len(self._parts[-1])
        return len(self._parts[-1])

    def tell(self) -> int:
        return self._position

    def taken(self) -> bytes:
        parts, self._parts = self._parts, []
        return b"".join(parts)


JOINED_FORMATS: Mapping[str, Callable[[Sequence[Column]], JoinedEncoder]] = {
    "csv": _Csv,
    "jsonl": _JsonLines,
    "md": _Markdown,
    "parquet": _Parquet,
}


def encoder(form: str, columns: Sequence[Column]) -> JoinedEncoder:
    """The encoder of a format; `UsageError` if joined rows cannot be written in it."""
    if form not in JOINED_FORMATS:
        raise UsageError(f"join: no format {form!r}; choose from {', '.join(JOINED_FORMATS)}")
    return JOINED_FORMATS[form](columns)
