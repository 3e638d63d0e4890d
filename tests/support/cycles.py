"""Circles in a graph of imports: files that need each other, directly or by way of others."""

from __future__ import annotations

from collections.abc import Mapping, Set


def cycles(imports: Mapping[str, Set[str]]) -> list[list[str]]:
    """The groups of files in which each file reaches every other one; the largest first.

    `imports` has the files that each file imports. The groups are the strongly connected components
    of more than one file. What each file reaches is collected first: that is quadratic, and
    fast enough for the hundreds of files of a crate or package.

    >>> cycles({"a": {"b"}, "b": {"c"}, "c": {"b"}})
    [['b', 'c']]
    """
    reached = {file: _reached(file, imports) for file in imports}
    groups = {
        tuple(sorted(other for other in files if file in reached.get(other, ())))
        for file, files in reached.items()
    }
    return [
        list(group)
        for group in sorted(groups, key=lambda group: (-len(group), group))
        if len(group) > 1
    ]


def _reached(file: str, imports: Mapping[str, Set[str]]) -> set[str]:
    """All files that a file imports, directly or by way of others."""
    found: set[str] = set()
    waiting = [file]
    while waiting:
        new = imports.get(waiting.pop(), set()) - found
        found |= new
        waiting += new
    return found
