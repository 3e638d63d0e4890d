"""One export under way: which rows of which table go to which output in which format."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import _modlens
from analyzer.columns import TABLES, pick
from analyzer.exports import Batches, Format, Wish, format_of, load
from analyzer.exports.output import NewFile, Output
from analyzer.filters import Filter, parse
from dissectors.errors import UsageError

__all__ = ["ExportSink", "Target", "check_style", "fitting", "tables_of", "target"]


@dataclass(frozen=True, slots=True)
class Target:
    """What `-o` asks for.

    A table, a format (a key of `analyzer.exports.FORMATS`), a path (None: standard output).
    """

    table: str
    format: str
    path: str | None


def target(text: str, table: str) -> Target:
    """The target that `log.csv` or `frames:log.csv` says.

    `table` is the one meant where none is named. `UsageError` if the format cannot hold the table;
    where it holds one only and none was named, that one is meant.

    >>> target("frames:f.csv", "transactions")
    Target(table='frames', format='csv', path='f.csv')
    >>> target("bus.simulator.json", "transactions").table
    'readings'
    """
    head, colon, rest = text.partition(":")
    if colon and head in TABLES:
        return fitting(Target(head, format_of(rest), rest), named=True)
    return fitting(Target(table, format_of(text), text), named=False)


def fitting(target: Target, *, named: bool) -> Target:
    """The target with a table that its format can hold; `named` is one that the user has named."""
    holds = load(target.format).tables
    if target.table in holds:
        return target
    if named or len(holds) > 1:
        where = f"-o {target.path}" if target.path else f"--to {target.format}"
        one_of = " or ".join(holds)
        raise UsageError(f"{where}: {target.format} holds {one_of}, not {target.table}")
    return replace(target, table=holds[0])


def tables_of(targets: Iterable[Target]) -> set[str]:
    """The tables that have to be built for these targets."""
    found = set()
    for one in targets:
        form = load(one.format)
        found |= set(form.needs) if issubclass(form, Batches) else {one.table}
    return found


def check_style(style: str | None, targets: Iterable[Target]) -> None:
    """`UsageError` if there is a style that no target knows."""
    known = {word for one in targets for word in load(one.format).styles}
    if style is not None and style not in known:
        there = f"there are {', '.join(sorted(known))}" if known else "no output here has styles"
        raise UsageError(f"--style {style}: {there}")


class ExportSink:
    """Writes the rows of one table; see `analyzer.session.Sink`.

    `columns` is the text of `--columns`, `where` that of `--where`; both must fit the table
    (`UsageError`, `FilterError`). With `growing` the file grows in place and must be new. `wish`
    says what else is wanted; its table, columns and `live` come from the other arguments.
    """

    def __init__(
        self,
        target: Target,
        *,
        columns: str | None,
        where: str | None,
        growing: bool,
        wish: Wish | None = None,
    ) -> None:
        form = load(target.format)
        if columns is not None and not form.chosen:
            raise UsageError(f"--columns: {target.format} has columns of its own")
        self.table = target.table
        self.rows = 0
        keys = pick(target.table, columns)
        wish = replace(wish or Wish("", ()), table=target.table, columns=keys, live=growing)
        if wish.style not in form.styles:
            wish = replace(wish, style="")
        self._format: Format = form(wish)
        wanted: Filter | None = None if where is None else parse(where, target.table)
        self._predicate = None if wanted is None else wanted.predicate()
        if growing and not form.grows and target.path is not None:
            self._output: Output = NewFile(target.path)
        else:
            self._output = self._format.output(target.path, growing=growing)
        self.name = self._output.name

    def put(self, batch: _modlens.Batch) -> None:
        """Write the batch's rows."""
        table: _modlens.Table = getattr(batch, self.table)
        kept = None if self._predicate is None else table.where(self._predicate)
        rows = table if kept is None else kept
        self.rows += len(rows)
        if isinstance(self._format, Batches):
            pieces = self._format.batch(batch, kept)
        else:
            pieces = self._format.pieces(rows)
        for data in pieces:
            if data:
                self._output.append(data)

    def close(self) -> None:
        """All rows are there."""
        data = self._format.end()
        if data:
            self._output.append(data)
        self._output.close()

    def remark(self) -> str:
        """What a person should know of the output; mostly nothing."""
        return self._format.remark()

    def abandon(self) -> None:
        """The input failed: leave nothing half written."""
        self._output.abandon()
