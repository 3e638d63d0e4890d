"""Which chosen columns had no value in any row of an output, and what can be done about it."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import compress
from typing import TYPE_CHECKING

from analyzer.columns import columns

if TYPE_CHECKING:
    import _modlens

__all__ = ["EmptyColumns"]

_NO_DATE = "the recording has no date or zone; --date and --timezone give them"
_NO_TIMES = (
    "the recording has no times, or its clock is too coarse; modlens tap --record keeps exact ones"
)
_TCP_ONLY = "only recordings of Modbus/TCP have it"
_NO_PROFILE = "no profile names these registers; --profile does, and modlens match finds one"

_REASONS: Mapping[str, str] = {
    **dict.fromkeys(("time", "opened", "closed", "since", "until"), _NO_DATE),
    **dict.fromkeys(("elapsed_us", "gap_us", "response_time_us", "idle_us"), _NO_TIMES),
    **dict.fromkeys(("client", "server", "connection", "mbap_id"), _TCP_ONLY),
    **dict.fromkeys(("readings", "name", "unit_of_measure"), _NO_PROFILE),
    "line": "only a tap of one bus on two ports (PORT+PORT) has it",
    "waited_us": f"every request was answered, or {_NO_TIMES}",
    "late_response_us": f"no response was late, or {_NO_TIMES}",
    **dict.fromkeys(("exception", "exception_name"), "no response was an exception"),
    **dict.fromkeys(("write_address", "write_quantity", "write_data"), "nothing was written"),
}
"""Column -> why it is empty in every row, and what to do where something can be done."""


class EmptyColumns:
    """Watches the rows of one table for columns that never have a value.

    >>> EmptyColumns("transactions", ["unit", "client"]).remarks(3)
    ['client is empty in all 3 rows: only recordings of Modbus/TCP have it']
    """

    def __init__(self, table: str, keys: Iterable[str]) -> None:
        self._table = table
        wanted = set(keys)
        self._unseen = [
            column.key
            for column in (columns(table) if wanted else ())
            if column.key in wanted and not column.always
        ]

    def seen(self, rows: _modlens.Table) -> Container[str]:
        """Those of the columns without a value so far that have one in these rows; any thread."""
        unseen = self._unseen
        return list(compress(unseen, rows.have_values(unseen))) if unseen else ()

    def drop(self, seen: Container[str]) -> None:
        """Rows with values in these columns are written."""
        self._unseen = [key for key in self._unseen if key not in seen]

    def remarks(self, row_count: int) -> Sequence[str]:
        """A remark for each column that was empty in all rows, of which there were so many."""
        if not row_count:
            return []
        rows = f"all {row_count:,} rows" if row_count > 1 else "the only row"
        helps = {column.key: column.help for column in columns(self._table)}
        return [
            f"{key} is empty in {rows}: {_REASONS.get(key) or helps[key]}" for key in self._unseen
        ]
