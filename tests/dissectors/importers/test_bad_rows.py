"""One bad row costs one row; what a file says dozens of times is one note."""

from __future__ import annotations

import pytest

from dissectors.importers import csv, homeassistant
from dissectors.importers.profile_builder import Options
from dissectors.profile import from_model

GATEWAY = "variable name,data type,register,documented name,unit,values\n"
"""The header line of PythonProtocolGateway's tables."""


@pytest.mark.parametrize(
    ("cell", "scale", "unit"),
    [
        ("0.1V", 0.1, "V"),
        ("10 W", 10, "W"),
        ("0.01", 0.01, None),
        ("10.5", 10.5, None),
        ("V", None, "V"),
        ("1", None, None),
        ("m3", None, "m3"),
    ],
)
def test_a_unit_with_a_scale(cell: str, scale: float | None, unit: str | None) -> None:
    """A number is the scale, what follows it the unit."""
    found = csv.read(f"{GATEWAY}flow,USHORT,7,Flow,{cell},\n", "map.csv", Options())
    (point,) = found.model["registers"]
    assert point.get("scale", 1) == (scale or 1)
    assert point.get("unit") == unit
    from_model(found.model, "map")


def test_a_row_that_no_profile_can_hold_costs_itself_alone() -> None:
    """A scale of 0 makes every value 0: no profile can say that."""
    text = f"{GATEWAY}a,USHORT,1,A,V,\nb,USHORT,2,B,0W,\nc,USHORT,3,C,A,\n"
    found = csv.read(text, "map.csv", Options())
    assert [point["name"] for point in found.model["registers"]] == ["a", "c"]
    (note,) = (note for note in found.notes if note.startswith("b: "))
    assert "scale" in note
    assert note.endswith("skipped")


def test_many_secrets_are_one_note() -> None:
    """With their lines."""
    hubs = "".join(
        f"  - name: h{n}\n    host: !secret host{n}\n    sensors:\n"
        f"      - {{name: s{n}, address: {n}}}\n"
        for n in range(3)
    )
    found = homeassistant.read(f"modbus:\n{hubs}", "configuration.yaml", Options())
    notes = [note for note in found.notes if "secret" in note]
    assert notes == ["lines 3, 7, 11: !secret is not followed; skipped"]
