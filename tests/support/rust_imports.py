"""Which file of a Rust crate needs which other one, read from the sources without a compiler.

A file needs another one where a path in it (`use crate::pdu::Pdu`, `pdu::decode(..)`)
leads to an item that the other one defines. A name that a module only passes on (`pub use`) is
looked up where it is defined, so a `mod.rs` that gathers the names of its children needs them only
if it uses them itself. Code under `#[cfg(test)]` does not count, nor do methods: they have no path.

Print the circles of all crates of this tree with `python -m tests.support.rust_imports`.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from tests.support.cycles import cycles
from tests.support.rust_tokens import Token, end_of_group, tokens, without_tests

DEFINING = frozenset(("fn", "struct", "enum", "union", "trait", "type", "const", "static"))


class Use(NamedTuple):
    """A name that `use` brings into a module: the path it stands for."""

    path: tuple[str, ...]
    line: int
    public: bool


class Reference(NamedTuple):
    """A path to another file: the file, the name it defines, the line of the path."""

    target: Path
    name: str
    line: int


@dataclass(slots=True)
class Module:
    """What a module defines, imports and mentions; an inline module is one as well."""

    file: Path
    parent: Module | None
    children: dict[str, Module] = field(default_factory=dict)
    items: set[str] = field(default_factory=set)
    uses: dict[str, list[Use]] = field(default_factory=lambda: defaultdict(list))
    globs: list[Use] = field(default_factory=list)
    paths: list[tuple[tuple[str, ...], int]] = field(default_factory=list)
    words: set[str] = field(default_factory=set)

    def all(self) -> Iterator[Module]:
        """This module and all below it."""
        yield self
        for child in self.children.values():
            yield from child.all()

    def root(self) -> Module:
        """The root of the crate."""
        return self.parent.root() if self.parent else self


def read_crate(root: Path) -> Module:
    """The modules of a crate, from its `lib.rs` or `main.rs` on."""
    return _read_file(root, root.parent, None)


def _read_file(file: Path, folder: Path, parent: Module | None) -> Module:
    """The module of a file; `folder` is where its children lie."""
    module = Module(file, parent)
    _read_items(without_tests(tokens(file.read_text("utf-8"))), module, folder)
    return module


def _read_items(source: list[Token], module: Module, folder: Path) -> None:
    """Enter the items of a module's tokens."""
    at = depth = 0
    while at < len(source):
        text, line = source[at]
        following = source[at + 1].text if at + 1 < len(source) else ""
        if text == "use" and following not in ("<", ","):
            end = next(i for i in range(at, len(source)) if source[i].text == ";")
            public = at > 0 and source[at - 1].text in ("pub", ")")
            for path, alias in _use_tree(source[at + 1 : end], ()):
                _enter_use(module, Use(path, line, public), alias)
            at = end
        elif text == "mod" and depth == 0 and source[at + 2].text == ";":
            below = folder / following
            file = below.with_suffix(".rs")
            module.children[following] = _read_file(
                file if file.is_file() else below / "mod.rs", below, module
            )
            at += 2
        elif text == "mod" and depth == 0 and source[at + 2].text == "{":
            end = end_of_group(source, at + 2)
            module.children[following] = inline = Module(module.file, module)
            _read_items(source[at + 3 : end - 1], inline, folder / following)
            at = end - 1
        elif text in DEFINING and depth == 0:
            if following not in ("fn", "unsafe", "_"):
                module.items.add(source[at + 2].text if following == "mut" else following)
                at += 1
        elif text == "macro_rules":
            module.items.add(source[at + 2].text)
            at += 2
        elif text.isidentifier():
            end = _end_of_path(source, at)
            module.paths.append((tuple(token.text for token in source[at:end:2]), line))
            module.words.add(text)
            at = end - 1
        depth += (text == "{") - (text == "}")
        at += 1


def _end_of_path(source: list[Token], at: int) -> int:
    """Returns the place that `a::b::c` names."""
    at += 1
    while at + 1 < len(source) and source[at].text == "::" and source[at + 1].text.isidentifier():
        at += 2
    return at


def _use_tree(tree: list[Token], prefix: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    """The paths of a `use`, and the name that each has afterwards; `*` for all names.

    >>> list(_use_tree(tokens("crate::a::{self, B as C, d::*}"), ()))
    [(('crate', 'a'), 'a'), (('crate', 'a', 'B'), 'C'), (('crate', 'a', 'd'), '*')]
    """
    path = prefix
    at = 0
    while at < len(tree) and (tree[at].text == "::" or tree[at].text.isidentifier()):
        if tree[at].text == "as":
            break
        if tree[at].text != "::":
            path = (*path, tree[at].text)
        at += 1
    rest = [token.text for token in tree[at:]]
    if rest[:1] == ["{"]:
        begin = at + 1
        depth = 0
        for i in range(at, len(tree)):
            text = tree[i].text
            depth += (text == "{") - (text == "}")
            if (text == "," and depth == 1) or (text == "}" and depth == 0):
                if begin < i:
                    yield from _use_tree(tree[begin:i], path)
                begin = i + 1
        return
    if len(path) > 1 and path[-1] == "self":
        path = path[:-1]
    alias = rest[1] if rest[:1] == ["as"] else path[-1]
    yield path, "*" if rest[:1] == ["*"] else alias


def _enter_use(module: Module, use: Use, alias: str) -> None:
    if alias == "*":
        module.globs.append(use)
    else:
        module.uses[alias].append(use)


def resolve(module: Module, path: tuple[str, ...]) -> Module | tuple[Module, str] | None:
    """Where a path leads: a module, or a module and an item it defines; None outside the crate."""
    return _resolve(module, path, frozenset(), outermost=True)


def _resolve(
    module: Module,
    path: tuple[str, ...],
    tried: frozenset[tuple[int, str, bool]],
    *,
    outermost: bool,
) -> Module | tuple[Module, str] | None:
    name, *others = path
    rest = tuple(others)
    start = {"self": module, "crate": module.root(), "super": module.parent}.get(name)
    if start is not None:
        return _resolve(start, rest, tried, outermost=False) if rest else start
    step = (id(module), name, bool(rest))
    if step in tried:
        return None
    tried |= {step}
    # A module and a function may have one name; what follows `::` is in the module.
    if not rest and name in module.items:
        return module, name
    candidates = [(use, use.path) for use in module.uses.get(name, ())]
    candidates += [(use, (*use.path, name)) for use in module.globs]
    ends = [_resolve(module, target, tried, outermost=True) for _, target in candidates]
    inside = [end for end in ends if end is not None]
    if name in module.children:
        inside.append(module.children[name])
    inside.sort(key=lambda end: isinstance(end, Module) != bool(rest))
    if inside:
        end = inside[0]
        return (
            _resolve(end, rest, tried, outermost=False) if rest and isinstance(end, Module) else end
        )
    if name in module.items:
        return module, name
    # A macro may have defined it; a first name that is not known is another crate's.
    return None if outermost else (module, name)


def references(module: Module) -> Iterator[Reference]:
    """The other files that a module needs, one entry for each path that leads there."""
    named = [
        (use.path, use.line)
        for alias, uses in module.uses.items()
        for use in uses
        if not use.public or alias in module.words
    ]
    named += [(use.path, use.line) for use in module.globs if not use.public]
    for path, line in named + [(path, line) for path, line in module.paths if len(path) > 1]:
        end = resolve(module, path)
        # A module that is imported as such is needed for the items that are used of it.
        if isinstance(end, tuple) and end[0].file != module.file:
            yield Reference(end[0].file, end[1], line)


def crate_imports(source: Path) -> dict[str, dict[str, list[Reference]]]:
    """For each file below a crate's `src` the files of the crate that it needs, and for what."""
    roots = [source / "lib.rs", source / "main.rs", *sorted((source / "bin").glob("*.rs"))]
    found: dict[str, dict[str, list[Reference]]] = {}
    for root in roots:
        if root.is_file():
            for module in read_crate(root).all():
                needed = found.setdefault(_name(module.file, source), defaultdict(list))
                for reference in references(module):
                    needed[_name(reference.target, source)].append(reference)
    return found


def _name(file: Path, source: Path) -> str:
    return file.relative_to(source).as_posix()


def describe_cycles(imports: dict[str, dict[str, list[Reference]]]) -> list[str]:
    """The circles in the result of `crate_imports`, each with the lines that tie its files."""
    found = []
    for group in cycles({file: set(needed) for file, needed in imports.items()}):
        lines = [f"{len(group)} files need each other: {', '.join(group)}"]
        for file in group:
            for target, why in sorted(imports[file].items()):
                if target in group:
                    names = sorted({reference.name for reference in why})
                    line = min(reference.line for reference in why)
                    lines.append(f"  {file}:{line} -> {target}: {', '.join(names)}")
        found.append("\n".join(lines))
    return found


def main() -> None:
    """Print the circles of all crates."""
    root = Path(__file__).parents[2]
    for source in sorted(root.glob("crates/*/src")):
        circles = describe_cycles(crate_imports(source))
        sys.stdout.write("\n\n".join([f"# {source.parent.name}", *circles]) + "\n\n")


if __name__ == "__main__":
    main()
