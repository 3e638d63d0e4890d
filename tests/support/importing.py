"""What the tests of importers have in common: a feature written out, and what has to come of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dissectors import importers
from dissectors.importers import Options
from dissectors.profile import from_model

__all__ = ["Feature", "imported", "notes", "points"]

ALWAYS = {
    "csv": (
        "addresses count ",
        "no column names the table",
        "values of several registers: highest register first",
    ),
    "telegraf": ("addresses count from 0, as Telegraf does",),
    "homeassistant": ("addresses count from 0, as Home Assistant does",),
    "esphome": ("addresses count from 0, as ESPHome does",),
    "sunspec": (),
}
"""Beginnings of the notes that every import of a format has; tests of their own look at them."""


@dataclass(frozen=True, slots=True)
class Feature:
    """A file, the points that it has to become, and all notes that have to be said."""

    text: str
    points: Mapping[str, Mapping[str, Any]]
    notes: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def found(self, form: str) -> tuple[dict[str, dict[str, Any]], list[str]]:
        """What comes of it: the points of the profile that the core has taken, and the notes."""
        return points(form, self.text, **self.options), notes(form, self.text, **self.options)

    @property
    def expected(self) -> tuple[Mapping[str, Mapping[str, Any]], list[str]]:
        """What has to come of it."""
        return self.points, list(self.notes)


def imported(form: str, text: str, **options: Any) -> dict[str, Any]:
    """The checked model of an imported file."""
    found = importers.read(form, text, "map", Options(**options))
    return from_model(found.model, "map").model


def points(form: str, text: str, **options: Any) -> dict[str, dict[str, Any]]:
    """The points of an imported file by name; what is beside the name."""
    rows = imported(form, text, **options)["registers"]
    return {row["name"]: {key: row[key] for key in row if key != "name"} for row in rows}


def notes(form: str, text: str, **options: Any) -> list[str]:
    """The notes of an import, without those that every import has."""
    found = importers.read(form, text, "map", Options(**options)).notes
    return [note for note in found if not note.startswith(ALWAYS[form])]
