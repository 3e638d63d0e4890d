"""Export formats for other programs, and their registry: name -> module.

A format is a module with a class `Format`, which turns tables into bytes and knows nothing of
files; output.py decides where the bytes go. To add a format, write its module and name it here.

>>> format_of("frames.csv"), format_of("modbus_detailed.log")
('csv', 'icsnpp')
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, cast

from analyzer.columns import TABLES
from analyzer.exports.output import NewAtomicFile, Output, is_fifo, open_output
from dissectors.errors import UsageError

if TYPE_CHECKING:
    import _modlens

__all__ = ["FORMATS", "ExportOptions", "Format", "MultiTableFormat", "format_of", "load"]

FORMATS = {
    "csv": "analyzer.exports.csv",
    "xlsx": "analyzer.exports.xlsx",
    "jsonl": "analyzer.exports.jsonl",
    "parquet": "analyzer.exports.parquet",
    "arrow": "analyzer.exports.arrow",
    "sqlite": "analyzer.exports.sqlite",
    "pcapng": "analyzer.exports.pcapng",
    "pcap": "analyzer.exports.pcap",
    "md": "analyzer.exports.md",
    "txt": "analyzer.exports.txt",
    "zeek": "analyzer.exports.zeek",
    "icsnpp": "analyzer.exports.icsnpp",
    "influx": "analyzer.exports.influx",
    "simulator": "analyzer.exports.simulator",
}
"""Name, which is also the suffix without its dot -> module."""

ENDINGS = {
    "modbus_detailed.log": "icsnpp",
    "modbus.log": "zeek",
    ".simulator.json": "simulator",
    ".lp": "influx",
    ".db": "sqlite",
    ".feather": "arrow",
}
"""Further endings of file names -> format."""


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """The options of one export.

    - `table`: of which table the rows are
    - `columns`: the keys of its columns, in order
    - `style`: a word of the format's `styles`, or "" for its usual one
    - `live`: rows are written as they come, because the end may come at any moment
    - `context`: captures only: further frames before and after those that a filter keeps
    - `address`, `times`, `buses`: tables for people only, see
      `analyzer.views.row_lines.TableOptions`
    - `stopping`: whether a signal asks the program to end, so that nothing waits for a reader
    """

    table: str
    columns: Sequence[str]
    style: str = ""
    live: bool = False
    context: int = 0
    address: str = "wire"
    times: str = "utc"
    buses: Sequence[str] = ()
    stopping: Callable[[], bool] | None = None


class Format:
    """Encodes the rows of one table as the bytes of one file.

    `encode` is called for each batch of rows in order, then `footer` once.
    """

    tables: ClassVar[Sequence[str]] = TABLES
    """The tables whose rows the format can hold."""

    styles: ClassVar[Sequence[str]] = ()
    """The values of `--style`, the default first."""

    has_column_choice: ClassVar[bool] = True
    """Whether the user can choose the columns."""

    readable_while_written: ClassVar[bool] = True
    """Whether an incomplete file can be read, so that a live tap may let it grow in place."""

    any_thread: ClassVar[bool] = True
    """Whether rows may be encoded in another thread than that which opens and closes the file."""

    def __init__(self, options: ExportOptions) -> None:
        self.options = options

    def encode(self, table: _modlens.Table) -> bytes:
        """Encode further rows.

        The first call, which may have no rows, also gives what is before them.
        """
        raise NotImplementedError

    def encode_blocks(self, table: _modlens.Table) -> Iterable[bytes]:
        """Encode further rows in several blocks, each of which can be written before the next.

        Small blocks stay in the processor's cache, and their memory is reused.
        """
        return (self.encode(table),)

    def encoder(self) -> Callable[[_modlens.Table], Iterable[bytes]] | None:
        """What encodes the next rows, in any thread, and before or after all others.

        Called in the order of rows. None where the bytes depend on the rows in front of them.
        """
        return None

    def footer(self) -> bytes:
        """The bytes after the last row."""
        return b""

    def output(self, path: str | None, *, growing: bool) -> Output:
        """Open the output; None is standard output. `SourceError` if it cannot be written.

        A `growing` file is that of a live tap, and must be new.
        """
        if growing and not self.readable_while_written and path is not None and not is_fifo(path):
            return NewAtomicFile(path)
        return open_output(path, growing=growing, stopping=self.options.stopping)

    def closing_remark(self) -> str:
        """A remark for the user about the complete file; mostly empty."""
        return ""


class MultiTableFormat(Format):
    """A format made of several tables at once; a filter applies to `options.table` only."""

    required_tables: ClassVar[Sequence[str]] = TABLES
    """The tables that the format needs."""

    def encode_batch(self, batch: _modlens.Batch, kept: _modlens.Table | None) -> Iterable[bytes]:
        """Encode the rows of a batch, in small blocks.

        `kept` are the rows of `options.table` that match the filter; None without a filter.
        """
        raise NotImplementedError


def load(name: str) -> type[Format]:
    """Load a format by its name; `UsageError` lists the known ones."""
    if name not in FORMATS:
        from dissectors.function_lookup import similar_name  # noqa: PLC0415 - a message only

        hint = similar_name(name, FORMATS)
        question = f"did you mean {hint!r}?" if hint else f"choose from {', '.join(FORMATS)}"
        raise UsageError(f"no format {name!r} to write; {question}")
    return cast(type[Format], importlib.import_module(FORMATS[name]).Format)


def format_of(path: str) -> str:
    """The format that the ending of a file name stands for; `UsageError` for an unknown ending."""
    name = os.path.basename(path).lower()
    for ending, found in ENDINGS.items():
        if name.endswith(ending) and name != ending.removeprefix("."):
            return found
        if name == ending and not ending.startswith("."):
            return found
    suffix = os.path.splitext(name)[1].removeprefix(".")
    if suffix not in FORMATS:
        known = ", ".join(f".{name}" for name in FORMATS)
        raise UsageError(f"-o {path}: unknown extension; use one of {known}")
    return suffix
