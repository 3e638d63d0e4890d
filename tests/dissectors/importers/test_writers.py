"""What is written for another program is read back: the same points, but for what a note names.

| writer | what comes back |
| --- | --- |
| `toml` | everything, exactly |
| `csv` | everything; a semicolon in a label becomes a comma, with a note |
| `telegraf` | at, type, order, scale; an array is a field a value |
| `homeassistant` | these, and offset, unit, the first nan, arrays; of single bits the lowest |
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings

from dissectors import importers
from dissectors.importers import FORMATS
from dissectors.importers.draft import WIDTHS
from dissectors.profile import Profile, from_model, parse, shipped, shipped_names
from tests.support.profiles import models

Row = dict[str, Any]


def back(form: str, profile: Profile) -> tuple[list[Row], str]:
    """The points that come back, by name, and what was said when they were written."""
    written = importers.write(form, profile)
    if form == "toml":
        rows = parse(written.text, "x.toml").points
    else:
        rows = from_model(importers.read(form, written.text, "x").model, "x").points
    return sorted(rows, key=lambda row: str(row["name"])), "\n".join(written.notes)


def carried(point: Row, profile: Profile, keys: tuple[str, ...]) -> Row:
    """A point with some of its keys, its order said by itself, where it says something."""
    row = {key: point[key] for key in ("at", "name", "type", *keys) if key in point}
    order = point.get("order", profile.device.get("order", "ABCD"))
    if WIDTHS.get(point["type"], 1) == 1:
        order = {"CDAB": "ABCD", "DCBA": "BADC"}.get(order, order)
    if order != "ABCD" and point["at"][:2] in ("hr", "ir"):
        row["order"] = order
    return row


def in_telegraf(profile: Profile) -> list[Row]:
    """What Telegraf can say, written down without looking at the writer."""
    rows = []
    for point in profile.points:
        space, place = point["at"].split(":")
        if "-" in place or point["type"] in ("bcd16", "bcd32", "strh", "strl", "raw"):
            continue
        row = carried(point, profile, ("scale", "count"))
        width = WIDTHS.get(point["type"])
        if width is None or row.get("count", width) == width:
            rows.append(row)
            continue
        size = row.pop("count")
        for turn in range(size // width):
            at = f"{space}:{int(place) + turn * width}"
            rows.append({**row, "at": at, "name": f"{row['name']}_{turn}"})
    return rows


def in_home_assistant(profile: Profile) -> list[Row]:
    """What Home Assistant can say, written down without looking at the writer."""
    rows = []
    for point in profile.points:
        space, place = point["at"].split(":")
        keys: tuple[str, ...] = ("count",)
        if space in ("hr", "ir") and "." not in place:
            keys = ("count", "scale", "offset", "unit", "nan")
            if point["type"] not in ("str", *(kind for kind in WIDTHS if kind[0] in "usf")):
                continue
            if point["type"].startswith(("u8", "s8")):
                continue
        row = carried(point, profile, keys)
        if "." in place and (not place.endswith(".0") or "order" in row):
            continue
        if space == "co" and point.get("access", "r") != "r":
            row["access"] = "rw"
        if "nan" in row:
            row["nan"] = row["nan"][:1]
        rows.append(row)
    return rows


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_toml_carries_everything(model: Row) -> None:
    """The same model, without a note."""
    profile = from_model(model, "x")
    written = importers.write("toml", profile)
    assert parse(written.text, "x.toml").model == profile.model
    assert written.notes == ()


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_csv_carries_everything(model: Row) -> None:
    """The same model, but for semicolons in lists of labels, which are a note."""
    profile = from_model(model, "x")
    written = importers.write("csv", profile)
    expected = json.loads(json.dumps(profile.model))
    mended = []
    for row in [expected["device"], *expected["registers"]]:
        for key in ("enum", "bits", "exceptions"):
            for raw, label in row.get(key, {}).items():
                row[key][raw] = label.replace(";", ",").strip()
                mended += [key] if row[key][raw] != label else []
    assert importers.read("csv", written.text, "x").model == expected
    assert len(written.notes) <= len(mended)
    assert bool(written.notes) == bool(mended)


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_telegraf_carries_what_it_has_words_for(model: Row) -> None:
    """The rest is named in a note: each key, each point that is left out."""
    profile = from_model(model, "x")
    expected = in_telegraf(profile)
    if not expected:
        return
    rows, notes = back("telegraf", profile)
    assert rows == sorted(expected, key=lambda row: str(row["name"]))
    names = {row["name"] for row in rows}
    for point in profile.points:
        arrays = f"{point['name']}_0" in names
        if point["name"] not in names and not arrays:
            assert f"{point['name']}: " in notes
            assert "cannot be read by Telegraf; left out" in notes
            continue
        assert not arrays or f"{point['name']}: " in notes
        for key in ("enum", "bits", "nan", "offset", "unit", "access", "group", "note"):
            assert key not in point or f"{key} has no place in Telegraf" in notes
    for key in profile.device:
        assert key in ("address_base", "order") or f"{key} has no place in Telegraf" in notes


@settings(deadline=None, max_examples=40)
@given(model=models())
def test_home_assistant_carries_what_it_has_words_for(model: Row) -> None:
    """The rest is named in a note: each key, each point that is left out."""
    profile = from_model(model, "x")
    expected = in_home_assistant(profile)
    if not expected:
        return
    rows, notes = back("homeassistant", profile)
    assert rows == sorted(expected, key=lambda row: str(row["name"]))
    by_name = {row["name"]: row for row in rows}
    for point in profile.points:
        found = by_name.get(point["name"])
        if found is None:
            assert f"{point['name']}: {point['type']} {point['at']} cannot be read" in notes
            continue
        for key in ("enum", "bits", "group", "note", "unit"):
            assert key not in point or key in found or f"{key} has no place in Home" in notes
        if len(point.get("nan", ())) > 1:
            assert "the second value of nan has no place in Home Assistant" in notes
        if point.get("access", "r") != found.get("access", "r"):
            assert "access has no place in Home Assistant" in notes
    for key in profile.device:
        assert key in ("address_base", "order") or f"{key} has no place in Home" in notes


WRITERS = [name for name, form in FORMATS.items() if form.writes]


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("name", shipped_names())
def test_shipped_profiles_come_back(form: str, name: str) -> None:
    """Tables, addresses and types of the profiles that everybody has."""
    profile = shipped(name)
    rows, _ = back(form, profile)
    assert {(row["at"], row["type"]) for row in rows} == {
        (row["at"], row["type"]) for row in profile.points
    }


EDGES = """\
profile = 1
[device]
note = "first line\\nsecond line"
[[registers]]
at = "hr:0"
name = "mode"
enum = {0 = "off; by hand", 1 = "on"}
note = "a \\"quoted\\" word, a comma\\nand a line"
[[registers]]
at = "hr:1"
name = "biggest"
type = "u64"
nan = 0xFFFFFFFFFFFFFFFF
[[registers]]
at = "hr:5"
name = "flow"
type = "f32"
nan = nan
scale = 1e-5
"""


def test_texts_that_a_cell_cannot_hold_are_mended_with_a_note() -> None:
    """Semicolons part labels, a setting is one line; quotation marks, commas and lines may stay."""
    profile = parse(EDGES, "x.toml")
    written = importers.write("csv", profile)
    assert written.notes == (
        "device.note: written on one line",
        "mode.enum: written with commas for semicolons, without blanks at the ends",
    )
    again = parse(written.text, "x.csv").model
    assert again["device"]["note"] == "first line second line"
    assert again["registers"][0]["enum"] == {"0": "off, by hand", "1": "on"}
    assert again["registers"][0]["note"] == 'a "quoted" word, a comma\nand a line'
    assert again["registers"][1:] == profile.points[1:]


def test_toml_holds_the_edges() -> None:
    """Lines in texts, the biggest whole number, a sentinel that is no number, small scales."""
    profile = parse(EDGES, "x.toml")
    assert parse(importers.write("toml", profile).text, "x.toml").model == profile.model
