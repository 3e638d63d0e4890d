"""Templates of evcc: the registers in them, not executed; addresses as on the wire.

A template is YAML with conditions of Go's templates between the lines, so that the same key may
are in it several times. Its lines are read one by one, and how far they are indented says what
belongs together.

>>> from dissectors.importers.profile_builder import Options
>>> text = '''template: meter
... render: |
...   power:
...     source: modbus
...     register:
...       address: 12
...       type: input
...       decode: float32s
...     scale: -1
... '''
>>> read(text, "x.yaml", Options()).model["registers"]
[{'at': 'ir:12', 'name': 'power', 'type': 'f32', 'order': 'CDAB', 'scale': -1}]
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from dissectors.errors import ProfileError
from dissectors.importers.profile_builder import (
    Imported,
    NotConvertible,
    Options,
    ProfileBuilder,
    parse_decimal,
)

__all__ = ["read"]

_LINE = re.compile(r"(?P<indent> *)(?P<item>(?:- +)*)(?P<key>[\w.-]+) *: *(?P<value>.*)")
_TEMPLATE = re.compile(r"\{\{.*?\}\}")
_USAGE = re.compile(r'\{\{-?\s*(?:else\s+)?if\s+(?:and\s+\()?eq\s+\.usage\s+"(\w+)"')
_SPACES = {
    "holding": "hr", "input": "ir", "coil": "co", "coils": "co", "discrete": "di",
    "writeholding": "hr", "writesingle": "hr", "writemultiple": "hr", "writecoil": "co",
}  # fmt: skip
_DECODE = re.compile(
    r"(?P<kind>u?int|float)(?P<bits>16|32|64)(?P<nan>nan)?(?P<swap>s)?(?P<nan2>nan)?"
)
_STRUCTURE = {
    "source", "register", "add", "mul", "set", "get", "in", "config", "switch", "sequence", "case",
    "render", "script", "modbus", "convert", "meter", "value",
}  # fmt: skip
"""Keys that say how values are put together, and are no names."""


@dataclass(slots=True)
class _Register:
    """A `register:` with its line, its name, its keys, the scale beside it, and its remark."""

    line: int
    name: str
    usage: str
    scale: str | None = None
    keys: dict[str, str] = field(default_factory=dict)
    remark: str = ""


def read(text: str, name: str, options: Options) -> Imported:
    """Read the registers; `ProfileError` where the file is no template, or has none."""
    text = text.lstrip("\ufeff")
    found = list(_registers(text))
    if not found or not re.search(
        r"^(template|render|type|source|\s+source) *:", text, re.MULTILINE
    ):
        why = " (model: names a device of its own list)" if "type: mbmd" in text else ""
        raise ProfileError(f"no register: with address, type and decode in it{why}", path=name)
    source = {"source": f"evcc template {name}"}
    builder = ProfileBuilder(_maker(text) | source, options.order)
    builder.notes.append("addresses are as on the wire, as evcc sends them")
    builder.notes.append("conditions of the template are not executed: registers of all cases")
    seen: dict[tuple[object, ...], str] = {}
    for register in found:
        with builder.noting_failures(f"line {register.line}, {register.name}"):
            _add(builder, register, seen)
    if re.search(r"value: *\S+:\S+|model: ", text):
        builder.note_once("values by a model's name (SunSpec, mbmd) have no registers in the file")
    return builder.build()


def _maker(text: str) -> dict[str, str]:
    """Vendors and models, where the template says them."""
    products = re.search(r"^products *:\s*\n((?:[ -].*\n)*)", text, re.MULTILINE)
    rows = [] if products is None else products[1].splitlines()
    found: dict[str, list[str]] = {"vendor": [], "model": []}
    for row in rows:
        match = _LINE.match(row)
        key = {"brand": "vendor", "generic": "model"}.get(match["key"] if match else "")
        if match and key:
            found[key].append(match["value"].partition(" #")[0].strip().strip("\"'"))
    return {key: ", ".join(dict.fromkeys(texts)) for key, texts in found.items() if texts}


def _registers(text: str) -> Iterator[_Register]:
    """The registers of a template in the order of its lines."""
    reader = _Reader()
    for number, line in enumerate(text.splitlines(), 1):
        condition = _USAGE.search(line)
        reader.usage = condition[1] if condition else reader.usage
        match = _LINE.match(_TEMPLATE.sub("?", line))
        if match is not None:
            yield from reader.line(number, match)
    yield from reader.close(0)


class _Reader:
    """Where in the template a line stands: the keys above it, and the registers still open."""

    def __init__(self) -> None:
        self.usage = ""
        self._path: list[tuple[int, str]] = []
        self._open: list[tuple[int, _Register]] = []
        self._scales: dict[int, str] = {}

    def line(self, number: int, match: re.Match[str]) -> Iterator[_Register]:
        """Take a line with a key; gives the registers that end in front of it."""
        outer = len(match["indent"])
        indent = outer + len(match["item"])
        # An item of a list begins a new table: what is as far in as its keys has ended.
        yield from self.close(indent if match["item"] else indent + 1)
        # A list may stand as far in as its key: `currents:`, and `- source:` below it.
        of_list = bool(match["item"])
        self._path = [
            (depth, key)
            for depth, key in self._path
            if depth < outer or (of_list and depth == outer and key not in _STRUCTURE)
        ]
        value, _, remark = match["value"].partition("#")
        key, value = match["key"], value.strip().strip("\"'")
        if key == "register" and not value:
            scale = self._scales.get(indent)
            self._open.append((indent, _Register(number, _name(self._path), self.usage, scale)))
        elif key == "scale":
            self._scales[indent] = value
        for depth, one in self._open:
            if depth < indent and key in ("address", "type", "decode"):
                one.keys.setdefault(key, value)
                one.remark = one.remark or (remark.strip() if key == "address" else "")
            elif depth == indent and key == "scale":
                one.scale = value
        self._path.append((indent, key))

    def close(self, indent: int) -> Iterator[_Register]:
        """The registers that are at least that far in; they and their scales have ended."""
        yield from (one for depth, one in self._open if depth >= indent)
        self._open = [(depth, one) for depth, one in self._open if depth < indent]
        self._scales = {depth: one for depth, one in self._scales.items() if depth < indent}


def _name(path: list[tuple[int, str]]) -> str:
    """What the register is for: the innermost key that is a name."""
    names = [key for _, key in path if key not in _STRUCTURE]
    return names[-1] if names else "register"


def _add(builder: ProfileBuilder, found: _Register, seen: dict[tuple[object, ...], str]) -> None:
    address = parse_decimal(found.keys.get("address"))
    if not isinstance(address, int):
        raise NotConvertible(f"address {found.keys.get('address', '')!r} is not a number")
    word = found.keys.get("type", "").lower()
    space = _SPACES.get(word)
    if space is None:
        raise NotConvertible(f"type {word!r} is not known")
    kind, order, nan = _kind(found.keys.get("decode", ""), space)
    scale = None if found.scale is None else parse_decimal(found.scale)
    if found.scale is not None and scale is None:
        builder.notes.append(f"line {found.line}: scale {found.scale!r} is not a number; left out")
    # Written and read registers are often the same; one that stands twice is one point.
    same = (space, address, kind)
    if same in seen:
        builder.note_once("a register that is in several cases is one point")
        return
    seen[same] = found.name
    access = "rw" if word.startswith("write") else None
    name = "_".join(part for part in (found.usage, found.name) if part)
    builder.add(
        name, space, address, type=kind, order=order, nan=nan, access=access, note=found.remark,
        scale=None if scale in (1, 0) else scale,
    )  # fmt: skip


def _kind(decode: str, space: str) -> tuple[str | None, str | None, list[int]]:
    """Type, order and the value that means none of a word such as `uint32nans`."""
    if space in ("co", "di") or decode.lower() in ("bool16", "bool8", "bool"):
        return None, None, []
    match = _DECODE.fullmatch(decode.lower())
    if match is None:
        raise NotConvertible(f"decode {decode!r} is not known")
    bits = int(match["bits"])
    letter = {"uint": "u", "int": "s", "float": "f"}[match["kind"]]
    kind = f"{letter}{bits}"
    nan: list[int] = []
    if (match["nan"] or match["nan2"]) and letter != "f":
        nan = [(1 << bits) - 1 if letter == "u" else -(1 << bits - 1)]
    order = "CDAB" if match["swap"] else "ABCD"
    return None if kind == "u16" else kind, order, nan
