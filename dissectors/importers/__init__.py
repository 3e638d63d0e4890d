"""Register maps of other programs: read into profiles, written from profiles. One registry.

A format is a module with `read(text, name, options) -> Imported` or `write(profile)` or both. What
cannot be carried over is a note, never silence; what the file does not say (how addresses count, in
which order bytes stand) is said by an option, or assumed with a note.

>>> found = read("telegraf", '''
... [[inputs.modbus]]
... holding_registers = [
...   {name = "flow", byte_order = "CDAB", data_type = "FLOAT32-IEEE", address = [7, 8]},
... ]
... ''', "telegraf.conf")
>>> found.model["registers"]
[{'at': 'hr:7', 'name': 'flow', 'type': 'f32', 'order': 'CDAB'}]
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

from dissectors.errors import ModlensError, ProfileError, UsageError
from dissectors.function_lookup import similar_name
from dissectors.importers.homeassistant_hubs import Hub
from dissectors.importers.profile_builder import Imported, Options, SeveralUnitsError, parse_order
from dissectors.profile import Profile

__all__ = [
    "FORMATS", "Format", "Imported", "Options", "SeveralUnitsError", "Written", "check_format",
    "detect", "hubs", "parse_order", "read", "write",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Format:
    """A format: what it is, its module, which ways it goes, and the suffix of its files.

    `options` are those of `Options` that a file of the format leaves open.
    """

    title: str
    module: str
    reads: bool
    writes: bool
    suffix: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Written:
    """The text of a file, and what of the profile it does not carry."""

    text: str
    notes: tuple[str, ...]


_MAX_RETRY_CHARACTERS = 50_000
"""A text that is not of the given format is tried as other ones only up to this length."""

_ORDERED = ("order", "unit")

FORMATS = {
    "toml": Format("the profile's own TOML", "toml", False, True, ".toml"),
    "csv": Format(
        "tables of any header, Kepware's among them", "csv", True, True, ".csv", ("base", *_ORDERED)
    ),
    "telegraf": Format("Telegraf inputs.modbus", "telegraf", True, True, ".conf", _ORDERED),
    "homeassistant": Format(
        "Home Assistant modbus:", "homeassistant", True, True, ".yaml", _ORDERED
    ),
    "esphome": Format("ESPHome modbus_controller", "esphome", True, False, ".yaml", _ORDERED),
    "sunspec": Format("SunSpec model JSON", "sunspec", True, False, ".json"),
    "solarman": Format(
        "solarman inverter definitions", "solarman", True, False, ".yaml", ("order",)
    ),
    "evcc": Format("evcc meter and charger templates", "evcc", True, False, ".yaml", ("order",)),
    "wb-mqtt-serial": Format(
        "wb-mqtt-serial templates", "wb_mqtt_serial", True, False, ".json", _ORDERED
    ),
    "openhab": Format(
        "openHAB things of the Modbus binding", "openhab", True, False, ".things", _ORDERED
    ),
    "modpoll": Format("modpoll configurations", "modpoll", True, False, ".csv", _ORDERED),
}
"""Name -> format; the module is dissectors/importers/<module>.py."""


def read(form: str, text: str, name: str, options: Options | None = None) -> Imported:
    """Read a file of another program; `name` names it in errors.

    `UsageError` for an unknown format; `ProfileError` where the text is not of this format, or none
    of its points can be converted.
    """
    module, given = _module(form, "reads"), options or Options()
    if not text.strip("\ufeff \r\n\t"):
        raise ProfileError("the file is empty", path=name)
    unused = [
        f"--{key} is ignored: a file for {form} states it itself"
        for key in ("base", "order", "unit")
        if getattr(given, key) is not None and key not in FORMATS[form].options
    ]
    try:
        found: Imported = module.read(text, name, given)
    except ProfileError as error:
        raise _with_format(error, form, text, name) from None
    notes = (*unused, *found.notes)
    if not found.model["registers"]:
        why = f": {notes[-1]}" if notes else ""
        raise ProfileError(f"it has no point that a profile can hold{why}", path=name)
    return Imported(found.model, notes)


def detect(text: str, name: str, unit: int | None = None) -> str:
    """The format of a text: the first one that finds points in it, those of `unit` if it is given.

    `ProfileError` if none does, `UsageError` where a file has several units and none is given.
    """
    reasons = {}
    for form, row in FORMATS.items():
        if row.reads:
            try:
                found = _module(form, "reads").read(text, name, Options(unit=unit))
            except SeveralUnitsError as error:
                error.form = form
                raise
            except UsageError:
                raise  # of this format, which needs a unit
            except ModlensError as error:
                reasons[form] = error.message.removeprefix(f"{name}: ")
                continue
            if found.model["registers"]:
                return form
    suffix = "." + name.rpartition(".")[2]
    alike = [f"{form}: {why}" for form, why in reasons.items() if FORMATS[form].suffix == suffix]
    why = f" ({'; '.join(alike)})" if alike else ""
    raise ProfileError(f"no register map of a known format{why}", path=name)


def _with_format(error: ProfileError, form: str, text: str, name: str) -> ProfileError:
    """The error to raise: one that names the right format where the text is of another one."""
    for other, row in FORMATS.items():
        if row.reads and other != form and len(text) <= _MAX_RETRY_CHARACTERS:
            try:
                found = _module(other, "reads").read(text, name, Options())
            except ModlensError:
                continue
            if found.model["registers"]:
                message = f"no file for {form}: it is read by `modlens import {other}`"
                return ProfileError(message, path=name)
    return error


def hubs(form: str, text: str, name: str, units: tuple[int, ...]) -> tuple[Hub, ...]:
    """The buses of a file with several units; a file of a format without buses is one bus."""
    of_format = getattr(_module(form, "reads"), "hubs", None)
    if of_format is None:
        return (
            Hub(
                {"name": name.replace("\\", "/").rpartition("/")[2].rpartition(".")[0] or name},
                units,
                text,
            ),
        )
    found: tuple[Hub, ...] = of_format(text, name)
    return found


def write(form: str, profile: Profile) -> Written:
    """Write a profile for another program; `UsageError` for an unknown format."""
    module = _module(form, "writes")
    text, notes = module.write(profile)
    return Written(text, tuple(notes))


def check_format(form: str, way: str) -> None:
    """`UsageError` with a similar name where a format does not exist, or does not read or write."""
    known = [name for name, row in FORMATS.items() if getattr(row, way)]
    if form not in known:
        hint = similar_name(form, known)
        question = f"did you mean {hint!r}?" if hint else f"choose from {', '.join(known)}"
        raise UsageError(f"no format {form!r} that it {way}; {question}")


def _module(form: str, way: str) -> Any:
    check_format(form, way)
    return importlib.import_module(f"dissectors.importers.{FORMATS[form].module}")
