"""Filters: one Python-like expression that chooses rows of one table (`--where`, `Rows.where`).

```
unit == 1 and function in (3, 4) and 100 <= address < 200
'retry' in findings or response_time_us > 50e3
write_address >= '40100' and touches(hr, 107)
time >= '2023-10-11T14:00:00Z' and status != 'ok'
```

The grammar is a part of Python's expressions: names of columns, numbers, texts, `and or not`,
comparisons (chained as well), `in`, `not in`, `is None`, `is not None`, arithmetic
`+ - * / // % &`, tuples and lists of literals, and the two questions `touches(type, where)` and
`writes(type, where)`. The core parses it (`crates/modlens-filters`, for the page as well) and makes
the tree below of it, which it interprets row by row.

A word alone is a condition as well: `exception` (a column that is not empty), `retry` (a finding),
`no_response` (a status), `noise` (a verdict), `write` (every function that writes, also file
records and read/write; `read` likewise). `findings` alone means that there is at least one. Words
of other languages and programs (`=`, `&&`, `slave`, `fc`) are refused with the right one, and so
are values that a column never has (`status == 'no_respons'`). An address is a wire address, from 0;
the number of a manual is in quotes: `address == '40001'`.

## The tree

Nested JSON lists; the first item says what the node is.

| node | meaning |
| --- | --- |
| `["col", name]` | the value of a column of the table |
| `["num", n]` | a number, integer or float (`True` and `False` are 1 and 0) |
| `["text", s]` | a text |
| `["time", ns]` | a moment, nanoseconds since 1970 UTC |
| `["none"]` | null; stands nowhere today, kept for later writers of trees |
| `["list", [item, ...]]` | a list of `num` and `text` nodes, only on the right of `in` |
| `["and", a, b]` `["or", a, b]` `["not", a]` | of conditions |
| `["cmp", op, a, b]` | op is one of `== != < <= > >=` |
| `["in", a, b]` | a equals an item of b (a list, or a list column), or is a part of b (a text) |
| `["is_none", a]` | a is null |
| `["arith", op, a, b]` | as in Python; op is one of `+ - * / // % &` |
| `["neg", a]` | minus a |
| `["touches", register_type, first, last]` | the row reads or writes one of these registers |
| `["writes", register_type, first, last]` | the row writes one of them |

A time without a date, `time >= '12:00:05'`, holds on every day; it becomes arithmetic on the
column. Times are UTC unless they say their zone: `'12:00:05 local'`, `'12:00 +02:00'`.

First and last are inclusive wire addresses. A division by zero and an overflow give null.

Conditions are true or false, never null: `cmp` and `in` with a null on either side are false, so
`!=` and `not in` are false there, too (`not in` is compiled with an `is_none` in front). Bool
columns count as 1 and 0. `hex` columns are text: lower-case digits without spaces. A list without
items is not null. Integers compare exactly with integers.

>>> filter = parse("unit == 1 and 'retry' in findings")
>>> print(filter)
unit == 1 and 'retry' in findings
>>> filter.tree
['and', ['cmp', '==', ['col', 'unit'], ['num', 1]], ['in', ['text', 'retry'], ['col', 'findings']]]
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import _modlens
from analyzer.columns import columns
from analyzer.times import utc_offset_changes
from dissectors.errors import FilterError, UsageError

__all__ = ["Filter", "Tree", "parse", "selection"]

Tree = list[Any]
"""A node of the filter tree: nested JSON lists."""


@dataclass(frozen=True, slots=True)
class Filter:
    """A filter for the rows of one table; `str()` gives it in normalized spelling.

    `notes` are sentences about what is valid, but may be meant otherwise.
    """

    table: str
    text: str
    tree: Tree
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return self.text

    @property
    def columns(self) -> frozenset[str]:
        """The columns that it compares."""
        return frozenset(_columns(self.tree))

    def predicate(self) -> _modlens.Predicate:
        """The compiled filter for `Table.where(predicate)`."""
        return _modlens.Predicate(self.table, json.dumps(self.tree))


def _columns(tree: Any) -> Iterator[str]:
    """The columns in a tree."""
    if isinstance(tree, list) and tree[:1] == ["col"]:
        yield tree[1]
    elif isinstance(tree, list):
        for part in tree:
            yield from _columns(part)


def parse(text: str, table: str = "transactions") -> Filter:
    """Parse a filter for the rows of `table`.

    `FilterError` says what is not valid, at which column of the text, and the most similar name.
    `UsageError` if there is no such table.
    """
    columns(table)
    found = json.loads(_modlens.parse_filter(text, table, lambda: utc_offset_changes("local")))
    if "error" in found:
        raise FilterError(
            found["error"], text=found["text"], column=found["column"], hint=found["hint"]
        )
    return Filter(table, found["text"], found["tree"], tuple(found["notes"]))


def selection(text_for: Callable[[str], str]) -> tuple[_modlens.Predicate, ...]:
    """Compiles a condition for transactions, and for each other table that has its columns.

    `text_for` gives the text for a table. The result is for `Settings.select`: frames and findings
    follow their transaction, those without one have to meet the condition themselves.
    """
    found = [parse(text_for("transactions"), "transactions")]
    for table in ("frames", "findings", "connections"):
        try:
            found.append(parse(text_for(table), table))
        except (FilterError, UsageError):
            continue  # The condition is about transactions: no row without one can meet it.
    return tuple(one.predicate() for one in found)
