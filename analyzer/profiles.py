"""Finds and loads device profiles, and binds them to units.

A word with a suffix or a folder is a file. Any other word is a name, which is looked up in the
folders of `MODLENS_PROFILES`, in the user's folder (`~/.config/modlens/profiles`), among the
shipped profiles, and in the entry points `modlens.profiles` of installed packages (each a text of
TOML, or a function without arguments that returns one).

>>> bound = parse_binding("1,4-6=mightyzap")
>>> bound.units, bound.profile.title
((1, 4, 5, 6), 'IR Robot mightyZAP 12Lf')
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import _modlens
from dissectors import importers
from dissectors.errors import ModlensError, ProfileError, SourceError, UsageError
from dissectors.function_lookup import similar_name
from dissectors.importers.profile_builder import SeveralUnitsError
from dissectors.profile import FORMS, Profile, parse, shipped, shipped_names

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint as _EntryPoint

__all__ = [
    "AvailableProfile",
    "Binding",
    "available_profiles",
    "load",
    "parse_binding",
    "parse_units",
    "with_vendor_functions",
]

ENTRY_POINTS = "modlens.profiles"

HIGHEST_UNIT = 255

_SAYS_PROFILE = re.compile(r"^\s*#?\s*profile\s*[:=]", re.MULTILINE)

_SAYS_BUS = re.compile(r"^\s*\[\[bus\]\]", re.MULTILINE)

_UNITS = re.compile(r"[\d\s,\-*]+")


@dataclass(frozen=True, slots=True)
class Binding:
    """A profile for some units: of the bus of this name, or of all buses for None."""

    profile: Profile
    units: tuple[int, ...]
    bus: str | None = None


@dataclass(frozen=True, slots=True)
class AvailableProfile:
    """A profile that can be loaded by name, and where it comes from."""

    name: str
    origin: str


def parse_binding(text: str) -> Binding:
    """Parse `--profile`: `UNITS=WORD`, or a word alone for all units.

    `UsageError` or `ProfileError` if that is not possible.
    """
    head, equals, word = text.partition("=")
    if not equals or not _UNITS.fullmatch(head):
        head, word = "*", text
    if not word:
        raise UsageError(f"--profile {text}: write units and a profile, such as 1=mightyzap")
    return Binding(load(word), parse_units(head))


def parse_units(text: str) -> tuple[int, ...]:
    """Parse units such as `1`, `2-7`, `1,4-6` or `*`; `UsageError` otherwise.

    >>> parse_units("2-4, 9")
    (2, 3, 4, 9)
    """
    units: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(?:\*|(\d+)\s*(?:-\s*(\d+))?)\s*", part)
        if match is None:
            raise UsageError(f"units {text!r}; write them as 1 or 2-7 or 1,4-6 or *")
        first = int(match[1] or 0)
        last = int(match[2] or match[1] or HIGHEST_UNIT)
        if not first <= last <= HIGHEST_UNIT:
            raise UsageError(f"units {text!r}; a unit is 0 to {HIGHEST_UNIT}, the lower one first")
        units |= dict.fromkeys(range(first, last + 1))
    return tuple(units)


def load(word: str) -> Profile:
    """Load the profile of a file or a name.

    `SourceError` if a file cannot be read, `ProfileError` with all mistakes in it, `UsageError` for
    a name that nobody knows.
    """
    if Path(word).suffix.lower() in FORMS or os.sep in word:
        return _of_file(word)
    for folder in _folders():
        for suffix in FORMS:
            path = folder / f"{word}{suffix}"
            if path.is_file():
                return parse(read(str(path)), str(path))
    if word in shipped_names():
        return shipped(word)
    for point in _entry_points():
        if point.name == word:
            return _from_entry_point(point)
    names = [one.name for one in available_profiles()]
    hint = similar_name(word, names)
    question = f"did you mean {hint!r}?" if hint else f"choose from {', '.join(names)}"
    raise UsageError(f"no profile {word!r}; {question}")


def _of_file(path: str) -> Profile:
    """The profile in a file; a `ProfileError` says if it is a bus file or another program's map."""
    text = read(path)
    try:
        return parse(text, path)
    except (ProfileError, UsageError):
        if _SAYS_BUS.search(text):
            raise ProfileError(
                f"no profile, but a bus file: write --bus {path} instead of --profile", path=path
            ) from None
        form = None if _SAYS_PROFILE.search(text) else _map_format(text, path)
        if form is None:
            raise
    what = importers.FORMATS[form].title
    raise ProfileError(
        f"no profile, but it looks like a map ({what}): first modlens import {form} {path} -o"
        f" {Path(path).stem}.toml",
        path=path,
    )


def _map_format(text: str, path: str) -> str | None:
    """The format of another program's map; None where it is of none."""
    try:
        return importers.detect(text, path)
    except SeveralUnitsError as error:
        return error.form or None
    except ModlensError:
        return None


def available_profiles() -> tuple[AvailableProfile, ...]:
    """All profiles that can be loaded by name, in the order in which names are looked up."""
    found: dict[str, AvailableProfile] = {}
    for folder in _folders():
        if folder.is_dir():
            for path in sorted(folder.iterdir()):
                if path.suffix.lower() in FORMS and path.is_file():
                    found.setdefault(path.stem, AvailableProfile(path.stem, str(path)))
    for name in shipped_names():
        found.setdefault(name, AvailableProfile(name, "shipped"))
    for point in _entry_points():
        found.setdefault(point.name, AvailableProfile(point.name, f"entry point {point.value}"))
    return tuple(found.values())


def read(path: str) -> str:
    """Read a text file in UTF-8; `SourceError` if it cannot be read."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeError as error:
        at = error.start if isinstance(error, UnicodeDecodeError) else 0
        raise SourceError(f"{path}: not valid UTF-8 at byte {at}; save it as UTF-8") from error
    except OSError as error:
        raise SourceError(f"{path}: cannot be read: {error.strerror or error}") from error


def with_vendor_functions(
    functions: _modlens.Functions, bindings: Iterable[Binding]
) -> _modlens.Functions:
    """Load into a table of functions the vendors' rows that the profiles ask for.

    Gives the table.
    """
    for one in bindings:
        for vendor in one.profile.device.get("vendor_functions", ()):
            try:
                functions.load_vendor(vendor)
            except ValueError as error:
                key = "device.vendor_functions"
                raise ProfileError(str(error), path=one.profile.name, key=key) from None
    return functions


def _folders() -> Iterator[Path]:
    for folder in os.environ.get("MODLENS_PROFILES", "").split(os.pathsep):
        if folder:
            yield Path(folder)
    config = os.environ.get("XDG_CONFIG_HOME")
    yield (Path(config) if config else Path.home() / ".config") / "modlens" / "profiles"


def _entry_points() -> Iterable[_EntryPoint]:
    from importlib.metadata import entry_points  # noqa: PLC0415 - slow to import

    return tuple(entry_points(group=ENTRY_POINTS))


def _from_entry_point(point: _EntryPoint) -> Profile:
    where = f"entry point {point.value}"
    try:
        found = point.load()
        text = found() if callable(found) else found
    # An entry point runs the code of another package, which may raise anything.
    except Exception as error:
        what = f"cannot be loaded: {type(error).__name__}: {error}; check its package"
        raise ProfileError(what, path=where) from error
    if not isinstance(text, str):
        raise ProfileError(f"is not the text of a profile, but {type(text).__name__}", path=where)
    return parse(text, where, "toml")
