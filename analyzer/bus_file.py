"""Bus files: port, line settings and the profiles of the units of each bus, in a TOML file.

```toml
plant = 1

[[bus]]
name = "pumps"
port = "/dev/ttyUSB0"
line = "19200-8E1"

[bus.units]
1 = "mightyzap"
"2-7" = "profiles/pump.yaml"
```

A profile's file is looked for beside the bus file first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analyzer.line import Line, parse_line
from analyzer.profiles import Binding, load, parse_units, read
from dissectors import toml
from dissectors.errors import ModlensError, ProfileError, UsageError
from dissectors.function_lookup import similar_name

__all__ = ["BUS_KEYS", "FILE_KEYS", "Bus", "choose_bus", "choose_buses", "load_bus_file"]

FILE_KEYS: Mapping[str, str] = {
    "plant": "1, the version of this format; the file begins with it",
    "bus": "one `[[bus]]` for each bus",
}
"""Key of the file -> what it is; the documents are made from it."""

BUS_KEYS: Mapping[str, str] = {
    "name": "name of the bus in tables and topics (default: the port)",
    "port": "serial device or URL, or two joined by + for a four-wire line",
    "line": "line settings, such as 19200-8E1; without them a tap finds them by listening",
    "mode": "framing: auto (default), rtu, ascii or tcp",
    "units": 'profiles by unit: a table such as 1 = "mightyzap" or "2-7" = "pump.yaml"; a file is '
    "looked for beside the bus file first",
    "note": "free text",
}
"""Key of a `[[bus]]` -> what it is."""

_MODES = ("auto", "rtu", "ascii", "tcp")


@dataclass(frozen=True, slots=True)
class Bus:
    """One bus of a bus file; port and line are None where the file does not give them."""

    name: str
    port: str | None
    line: Line | None
    mode: str
    profiles: tuple[Binding, ...]


def choose_bus(text: str) -> Bus:
    """The bus of `--bus FILE` or `FILE:NAME`; the name may be left out for a file with one bus.

    `SourceError` if the file cannot be read, `ProfileError` for mistakes in it, `UsageError` if the
    bus is not in it or not the only one.
    """
    buses = choose_buses(text)
    if len(buses) == 1:
        return buses[0]
    names = ", ".join(bus.name for bus in buses)
    raise UsageError(
        f"--bus {text}: several buses; choose one with --bus {text}:NAME: it has {names}"
    )


def choose_buses(text: str) -> list[Bus]:
    """All buses of `--bus FILE`, or the one of `FILE:NAME`; raises as `choose_bus` does."""
    path, colon, name = text.rpartition(":")
    if not colon or Path(text).exists():
        path, name = text, ""
    buses = load_bus_file(path)
    if not name:
        return buses
    names = [bus.name for bus in buses]
    for bus in buses:
        if bus.name == name:
            return [bus]
    hint = similar_name(name, names)
    question = f"did you mean {hint!r}?" if hint else f"it has {', '.join(names)}"
    raise UsageError(f"--bus {path}: no bus {name!r}; {question}")


def load_bus_file(path: str) -> list[Bus]:
    """Read a bus file; `ProfileError` lists all mistakes in it at once."""
    data = toml.load(read(path), path)
    mistakes: list[ProfileError] = []
    _check_keys(data, FILE_KEYS, "", path, mistakes)
    if data.get("plant") != 1:
        message = "must be 1, the version of this format: the file begins with plant = 1"
        mistakes.append(ProfileError(message, path=path, key="plant"))
    rows = data.get("bus")
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        mistakes.append(ProfileError("a [[bus]] is missing", path=path, key="bus"))
        rows = []
    buses = [_bus(row, f"bus[{number}]", path, mistakes) for number, row in enumerate(rows)]
    if mistakes:
        raise ProfileError.joined(mistakes)
    return buses


def _bus(row: dict[str, Any], key: str, path: str, mistakes: list[ProfileError]) -> Bus:
    """The bus of one [[bus]] table; what is wrong with it is added to `mistakes`.

    `key` is the table's place in the file, such as `bus[0]`. A key with a mistake counts as not
    given, so that the other keys are still checked.
    """
    _check_keys(row, BUS_KEYS, f"{key}.", path, mistakes)

    def wrong(name: str, message: str) -> None:
        mistakes.append(ProfileError(message, path=path, key=f"{key}.{name}"))

    for name in ("name", "port", "line", "mode"):
        if not isinstance(row.get(name, ""), str):
            wrong(name, f"must be text, not {row[name]!r}")
    line = None
    if isinstance(row.get("line"), str):
        try:
            line = parse_line(row["line"])
        except UsageError as error:
            wrong("line", error.message)
    mode = row.get("mode", "auto")
    if isinstance(mode, str) and mode not in _MODES:
        wrong("mode", f"{mode!r} is not one of {', '.join(_MODES)}")
    port = row.get("port")
    units = row.get("units", {})
    if not isinstance(units, dict):
        wrong("units", 'must be a table such as 1 = "mightyzap"')
        units = {}
    bindings: list[Binding] = []
    for text, word in units.items():
        try:
            bindings.append(
                Binding(load(_resolve_profile_path(path, str(word))), parse_units(text))
            )
        except ModlensError as error:
            wrong(f"units.{text}", error.message)
    name = str(row.get("name", port or key))
    return Bus(name, port, line, str(mode), tuple(bindings))


def _resolve_profile_path(path: str, word: str) -> str:
    near_by = Path(path).parent / word
    return str(near_by) if near_by.is_file() else word


def _check_keys(
    table: dict[str, Any],
    known: Iterable[str],
    prefix: str,
    path: str,
    mistakes: list[ProfileError],
) -> None:
    for key in table:
        if key not in known:
            hint = similar_name(key, known)
            mistakes.append(ProfileError("no such key", path=path, key=f"{prefix}{key}", hint=hint))
