"""Maps of other programs where a profile is wanted, and numbers of manuals in them."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissectors.errors import ProfileError
from dissectors.importers import read
from dissectors.importers.profile_builder import Options
from tests.conftest import CAPTURES, Modlens

RECORDING = str(CAPTURES / "pymodbus_types" / "recording.jsonl")
TABLE = "Address,Name,Type\n40001,flow,INT16\n40002,level,UINT16\n"
ENTITIES = """modbus:
  - name: hub
    type: tcp
    host: 10.0.0.1
    port: 502
    sensors:
      - name: flow
        slave: 1
        address: 10
        data_type: int16
"""


SECOND_UNIT = ENTITIES[ENTITIES.index("      - name") :].replace("slave: 1", "slave: 2")


@pytest.mark.parametrize(
    ("name", "text", "form"),
    [
        ("map.csv", TABLE, "csv"),
        ("ha.yaml", ENTITIES, "homeassistant"),
        ("ha.yaml", ENTITIES + SECOND_UNIT, "homeassistant"),
    ],
)
def test_a_map_given_as_profile_is_to_be_imported(
    name: str, text: str, form: str, tmp_path: Path, modlens: Modlens
) -> None:
    """One sentence with the command, instead of a mistake for each line."""
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    done = modlens("decode", RECORDING, "--profile", f"5={path}")
    assert done.status == 2
    assert f"first modlens import {form} {path}" in done.err
    assert "looks like a map" in done.err
    assert len(done.err.strip().splitlines()) == 1


def test_a_bus_file_given_as_profile(tmp_path: Path, modlens: Modlens) -> None:
    """What `modlens import` writes of several units belongs to --bus."""
    path = tmp_path / "ha.toml"
    path.write_text('plant = 1\n\n[[bus]]\nname = "pumps"\n', encoding="utf-8")
    done = modlens("decode", RECORDING, "--profile", str(path))
    assert (done.status, done.err.count("\n")) == (2, 1)
    assert f"write --bus {path}" in done.err


def test_mistakes_in_a_profile_are_still_told(tmp_path: Path, modlens: Modlens) -> None:
    """A file that says that it is a profile is judged as one."""
    path = tmp_path / "meter.yaml"
    path.write_text("profile: 1\nregisters:\n  - {at: 'hr:1', name: a, type: u23}\n", "utf-8")
    done = modlens("decode", RECORDING, "--profile", f"5={path}")
    assert "u23" in done.err
    assert "looks like a map" not in done.err


@pytest.mark.parametrize(
    ("first", "second", "noted"),
    [("40001", "40002", True), ("30101", "10001", True), 
     ("40000", "40002", False), ("107", "40002", False), ("50001", "50002", False)],
)  # fmt: skip
def test_numbers_of_a_manual_are_noted(first: str, second: str, noted: bool) -> None:
    """Only where all of them are in the ranges of Modicon's numbers, and no base is given."""
    text = TABLE.replace("40001", first).replace("40002", second)
    notes = " ".join(read("csv", text, "map.csv").notes)
    assert ("give --base modicon if they are" in notes) == noted


def test_numbers_of_six_digits_are_no_wire_addresses() -> None:
    """Nothing can be imported without the base, and the refusal names it."""
    text = TABLE.replace("40001", "400001").replace("40002", "465536")
    with pytest.raises(ProfileError, match="give --base modicon if they are"):
        read("csv", text, "map.csv")
    found = read("csv", text, "map.csv", Options(base="modicon")).model["registers"]
    assert [point["at"] for point in found] == ["hr:0", "hr:65535"]
