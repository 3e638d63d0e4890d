"""Files that other programs read. One registry: name -> the module of its format.

A format is a file of its own with a class `Format`, which turns tables into bytes and knows nothing
of files; where the bytes go is the business of output.py. To add a format: write its module, name
it here.

>>> format_of("frames.csv"), format_of("modbus_detailed.log")
('csv', 'icsnpp')
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, ClassVar, cast

from analyzer.columns import TABLES
from analyzer.exports.output import Output, open_output
from dissectors.errors import UsageError
from dissectors.function_lookup import similar_name

if TYPE_CHECKING:
    import _modlens

__all__ = ["FORMATS", "ExportOptions", "Format", "MultiTableFormat", "format_of", "load"]

FORMATS = {
    "csv": "analyzer.exports.csv",
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
"""Name, and suffix without its dot -> module."""

ENDINGS = {
    "modbus_detailed.log": "icsnpp",
    "modbus.log": "zeek",
    ".simulator.json": "simulator",
    ".lp": "influx",
    ".db": "sqlite",
    ".feather": "arrow",
}
"""Other ends of file names that say a format."""


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """What is asked of one export.

    - `table`: of which table the rows are
    - `columns`: the keys of its columns, in order
    - `style`: a word of the format's `styles`, or "" for its usual one
    - `live`: rows are written as they come, because the end may come at any moment
    - `context`: captures only: further frames before and behind those that a filter keeps
    - `address`, `times`, `buses`: tables for people only, see
      `analyzer.views.row_lines.TableOptions`
    """

    table: str
    columns: Sequence[str]
    style: str = ""
    live: bool = False
    context: int = 0
    address: str = "wire"
    times: str = "utc"
    buses: Sequence[str] = ()


class Format:
    """Turns tables of one kind into the bytes of one file, in order."""

    tables: ClassVar[Sequence[str]] = TABLES
    """The tables whose rows it can hold."""

    styles: ClassVar[Sequence[str]] = ()
    """Words that `--style` may say, the usual one first."""

    has_column_choice: ClassVar[bool] = True
    """Whether columns can be chosen."""

    readable_while_written: ClassVar[bool] = True
    """Whether what has been written so far can be read."""

    def __init__(self, options: ExportOptions) -> None:
        self.options = options

    def encode(self, table: _modlens.Table) -> bytes:
        """The bytes of some more rows.

        The first call, which may bring none, also gives what stands in front.
        """
        raise NotImplementedError

    def encode_blocks(self, table: _modlens.Table) -> Iterable[bytes]:
        """The same piece by piece, for formats whose text can be written before all of it is made.

        Small pieces stay in the processor's cache, and their memory is used again.
        """
        return (self.encode(table),)

    def footer(self) -> bytes:
        """What stands behind the last row."""
        return b""

    def output(self, path: str | None, *, growing: bool) -> Output:
        """Where the bytes go; None is standard output. `SourceError` if it cannot be written."""
        return open_output(path, growing=growing)

    def closing_remark(self) -> str:
        """What a person should know of the file when it is complete; mostly nothing."""
        return ""


class MultiTableFormat(Format):
    """A format made of several tables at once; a filter applies to `options.table` only."""

    required_tables: ClassVar[Sequence[str]] = TABLES
    """The tables that it is made of."""

    def encode_batch(self, batch: _modlens.Batch, kept: _modlens.Table | None) -> Iterable[bytes]:
        """The bytes of some more rows, in small pieces; `kept` are those that a filter kept.

        It is None without a filter.
        """
        raise NotImplementedError


def load(name: str) -> type[Format]:
    """The format of that name; `UsageError` with the known ones otherwise."""
    if name not in FORMATS:
        hint = similar_name(name, FORMATS)
        question = f"did you mean {hint!r}?" if hint else f"there are {', '.join(FORMATS)}"
        raise UsageError(f"no format {name!r} to write; {question}")
    return cast(type[Format], importlib.import_module(FORMATS[name]).Format)


def format_of(path: str) -> str:
    """The format that a file's name says by its end; `UsageError` if it says none."""
    name = PurePath(path).name.lower()
    for ending, found in ENDINGS.items():
        if name.endswith(ending) and name != ending.removeprefix("."):
            return found
        if name == ending and not ending.startswith("."):
            return found
    suffix = PurePath(name).suffix.removeprefix(".")
    if suffix not in FORMATS:
        known = ", ".join(f".{name}" for name in FORMATS)
        raise UsageError(f"-o {path}: the suffix says what to write; it is one of {known}")
    return suffix
