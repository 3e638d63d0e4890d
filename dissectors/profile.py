r"""Device profiles: the meaning of a device's registers, checked by the core.

One model in three spellings: TOML, YAML and CSV. The core checks and converts;
`dissectors/profiles/profile-1.json` is the JSON Schema for editors.

>>> meter = parse('''
... profile = 1
... [[registers]]
... at = "hr:0x10"
... name = "supply_air"
... type = "s16"
... scale = 0.1
... unit = "°C"
... ''', "meter.toml")
>>> [point["name"] for point in meter.points]
['supply_air']
>>> parse("profile = 1\n[[registers]]\nat = 'hr:1'\nname = 'x'\ntyp = 's16'\n", "meter.toml")
Traceback (most recent call last):
...
modlens.ProfileError: meter.toml:5: registers[0].typ: no such key; did you mean 'type'?
"""

from __future__ import annotations

import functools
import json
from collections.abc import Iterable, Mapping
from typing import Any

import _modlens
from dissectors.errors import ProfileError, UsageError
from dissectors.function_lookup import similar_name

__all__ = ["FORMS", "Profile", "form_of", "from_model", "parse", "shipped", "shipped_names"]

FORMS: Mapping[str, str] = {".toml": "toml", ".yaml": "yaml", ".yml": "yaml", ".csv": "csv"}
"""Suffix of a file -> format of the profile in it."""


class Profile:
    """A profile that has been checked; `core` is what `Session.bind` takes."""

    def __init__(self, name: str, core: _modlens.Profile) -> None:
        self.name = name
        self.core = core

    @functools.cached_property
    def model(self) -> dict[str, Any]:
        """The profile as plain data with the keys of its file, and wire addresses."""
        found: dict[str, Any] = json.loads(self.core.model())
        return found

    @property
    def device(self) -> dict[str, Any]:
        """The keys that describe the device as a whole."""
        found: dict[str, Any] = self.model["device"]
        return found

    @property
    def points(self) -> list[dict[str, Any]]:
        """The points, in the order of the file."""
        found: list[dict[str, Any]] = self.model["registers"]
        return found

    @property
    def title(self) -> str:
        """Vendor and model, or the id, or the name of the file."""
        words = [self.device.get("vendor"), self.device.get("model")]
        return " ".join(filter(None, words)) or self.device.get("id") or self.name

    def __repr__(self) -> str:
        return f"<Profile {self.name}: {len(self.points)} points>"


def form_of(path: str) -> str:
    """The format of a profile by its file's suffix; `UsageError` for another suffix."""
    suffix = path[path.rfind(".") :].lower() if "." in path else ""
    if suffix not in FORMS:
        raise UsageError(f"{path}: a profile is one of {', '.join(FORMS)}")
    return FORMS[suffix]


def parse(text: str, path: str, form: str | None = None) -> Profile:
    """Parse a profile; `path` names it in errors, and gives its format where `form` is None.

    `ProfileError` lists all mistakes at once.
    """
    return _checked(text, form or form_of(path), path)


def from_model(model: Mapping[str, Any], name: str) -> Profile:
    """A profile from plain data with the keys of its file, as importers make them."""
    return _checked(json.dumps(model), "json", name)


def shipped(name: str) -> Profile:
    """A shipped profile by its name; `UsageError` suggests a similar name."""
    texts = dict(_modlens.shipped_profiles())
    if name not in texts:
        hint = similar_name(name, texts)
        question = f"did you mean {hint!r}?" if hint else f"choose from {', '.join(texts)}"
        raise UsageError(f"no shipped profile {name!r}; {question}")
    return _checked(texts[name], "toml", name)


def shipped_names() -> tuple[str, ...]:
    """The names of the shipped profiles.

    >>> "mightyzap" in shipped_names()
    True
    """
    return tuple(name for name, _ in _modlens.shipped_profiles())


def _checked(text: str, form: str, path: str) -> Profile:
    try:
        return Profile(path, _modlens.Profile(text, form))
    except ValueError as error:
        raise _all(json.loads(str(error)), path) from None


def _all(mistakes: Iterable[Mapping[str, Any]], path: str) -> ProfileError:
    errors = [
        ProfileError(
            one["message"], path=path, line=one["line"], key=one["key"] or None, hint=one["hint"]
        )
        for one in mistakes
    ]
    return ProfileError.joined(errors)
