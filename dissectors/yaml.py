"""YAML 1.2 with line numbers, for the register maps of other programs; the core reads profiles.

It is imported when YAML is read. PyYAML is not used: it reads YAML 1.1,
where `0107` is 71, `12:30` is 750 and `NO` is false.
"""

from __future__ import annotations

from typing import Any

from dissectors.errors import ProfileError, UsageError

__all__ = ["load", "plain_data", "scalar", "tag_notes"]

_MAX_DIGITS = 100
"""Longest number in digits: longer ones stay text, because Python refuses thousands of digits."""

_MAX_DEPTH = 100
"""Levels of nesting; what is deeper is no profile and no configuration."""

_MAX_GROWTH, _FREE_NODES = 10, 10_000
"""Aliases (`*name`) may make a file ten times as large as it is written: a few lines of them can
stand for more values than fit into any memory."""

_NAMED = 10
"""Lines that a note names at most; the others are counted."""

_RADIX = ("0x", "0o", "0b")


def load(text: str, path: str) -> Any:
    """Parse YAML into nodes with line numbers; None where the text is empty.

    `ProfileError` with the line where it is no YAML, `UsageError` without ruamel.yaml.
    """
    try:
        from ruamel.yaml import YAML  # noqa: PLC0415 - takes a while
        from ruamel.yaml.error import MarkedYAMLError, YAMLError  # noqa: PLC0415
    except ImportError:
        raise UsageError(f"{path}: YAML needs ruamel.yaml; pip install ruamel.yaml") from None
    try:
        root = YAML(typ="rt").compose(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = None if mark is None else mark.line + 1
        raise ProfileError(f"not YAML: {error.problem}", path=path, line=line) from None
    # The text has a character that YAML does not allow; such errors have a position instead of a
    # mark.
    except YAMLError as error:
        at = text.count("\n", 0, getattr(error, "position", 0)) + 1
        what = str(error).splitlines()[0]
        raise ProfileError(f"not YAML: {what}", path=path, line=at) from None
    except RecursionError:
        raise ProfileError("YAML that is nested too deeply", path=path) from None
    if root is not None:
        _check_extent(root, path)
    return root


def _check_extent(root: Any, path: str) -> None:
    """`ProfileError` where values are nested too deeply, or aliases multiply them beyond measure.

    A node that several aliases name is one node here, whatever it stands for.
    """
    extents: dict[int, tuple[int, int]] = {}
    above: set[int] = set()
    stack = [root]
    while stack:
        node = stack[-1]
        inside = _children(node)
        missing = [one for one in inside if id(one) not in extents]
        if missing and id(node) not in above:
            above.add(id(node))
            if any(id(one) in above for one in missing):
                raise ProfileError("an anchor that contains itself", path=path)
            stack += missing
            continue
        stack.pop()
        if id(node) in extents:
            continue
        above.discard(id(node))
        values = 1 + sum(extents[id(one)][0] for one in inside)
        depth = 1 + max((extents[id(one)][1] for one in inside), default=0)
        if depth > _MAX_DEPTH:
            raise ProfileError("YAML that is nested too deeply", path=path)
        extents[id(node)] = values, depth
    if extents[id(root)][0] > _MAX_GROWTH * len(extents) + _FREE_NODES:
        raise ProfileError("aliases (*name) that stand for too many values", path=path)


def _children(node: Any) -> list[Any]:
    if node.id == "mapping":
        return [one for pair in node.value for one in pair]
    return list(node.value) if node.id == "sequence" else []


def scalar(node: Any) -> Any:
    """The value of a scalar node by the rules of YAML 1.2."""
    tag = str(node.tag if isinstance(node.tag, str) else node.ctag or "").rsplit(":", 1)[-1]
    text = str(node.value)
    try:
        if tag == "int" and len(text) <= _MAX_DIGITS:
            base = 0 if text.lstrip("+-")[:2].lower() in _RADIX else 10
            return int(text.replace("_", ""), base)
        if tag == "float":
            return float(text.replace("_", "").replace(".inf", "inf").replace(".nan", "nan"))
    except ValueError:
        # A tag may contradict the text, as in `!!int x`.
        return text
    if tag == "bool":
        return text.lower() == "true"
    return None if tag == "null" else text


def plain_data(text: str, path: str) -> tuple[Any, list[tuple[int, str]]]:
    """Parse YAML into plain data; gives also the lines of tags that only its program knows.

    What follows `!include`, `!secret` or `!lambda` is None. Merged keys (`<<: *anchor`) stand
    where they are merged into.
    """
    root = load(text, path)
    tags: dict[tuple[int, str], None] = {}
    try:
        return (None if root is None else _plain(root, tags)), list(tags)
    except RecursionError:
        raise ProfileError("an anchor that contains itself", path=path) from None


def tag_notes(tags: list[tuple[int, str]], why: str) -> list[str]:
    """A note for each kind of tag with its lines, as a file may hold dozens of secrets.

    >>> tag_notes([(3, "!secret a"), (9, "!secret b")], "is not followed")
    ['lines 3, 9: !secret is not followed; skipped']
    >>> tag_notes([(12, "!include c.yaml")], "is not followed")
    ['line 12: !include c.yaml is not followed; skipped']
    """
    kinds: dict[str, list[tuple[int, str]]] = {}
    for line, tag in tags:
        kinds.setdefault(tag.split()[0], []).append((line, tag))
    notes = []
    for kind, found in kinds.items():
        lines = [str(line) for line, _ in found]
        where = f"line {lines[0]}" if len(lines) == 1 else f"lines {', '.join(lines[:_NAMED])}"
        more = f" and {len(lines) - _NAMED} more" if len(lines) > _NAMED else ""
        what = found[0][1] if len(found) == 1 else kind
        notes.append(f"{where}{more}: {what} {why}; skipped")
    return notes


def _plain(node: Any, tags: dict[tuple[int, str], None]) -> Any:
    tag = str(node.tag if isinstance(node.tag, str) else node.ctag or "")
    if tag.startswith("!"):
        what = f"{tag} {node.value}" if node.id == "scalar" else tag
        tags[node.start_mark.line + 1, what] = None
        return None
    if node.id == "mapping":
        return _merged([(_key(key, tags), _plain(value, tags)) for key, value in node.value])
    if node.id == "sequence":
        return [_plain(item, tags) for item in node.value]
    return scalar(node)


def _key(node: Any, tags: dict[tuple[int, str], None]) -> Any:
    key = _plain(node, tags)
    return key if key.__hash__ is not None else str(key)


def _merged(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    """A table with those merged by `<<`; its own keys take precedence."""
    table: dict[Any, Any] = {}
    for key, value in pairs:
        if key == "<<":
            for one in value if isinstance(value, list) else [value]:
                table = {**(one if isinstance(one, dict) else {}), **table}
    own = {key: value for key, value in pairs if key != "<<"}
    return {**table, **own}
