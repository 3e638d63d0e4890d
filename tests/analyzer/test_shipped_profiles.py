"""Every shipped profile: its device is named from traffic that asks for its points, as masters do.

The values are of a usual size for each unit; what is in the profile was checked against its source
by two readers.
"""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

import _modlens
from analyzer import decode
from analyzer.cli.known_devices import ranked, usable_profiles
from analyzer.profiles import load
from tests.conftest import Modlens
from tests.support.profile_traffic import frame, recording

NAMES = [name for name, _ in _modlens.shipped_profiles()]
PROFILES = list(usable_profiles())
RELATIVES = {
    "eastron-sdm230": {"eastron-sdm120"},
    "durapulse-gs3": {"delta-vfd"},
}
"""Devices whose points are all in another map as well."""


@pytest.mark.parametrize("name", NAMES)
def test_the_device_is_named_from_its_polls(name: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.hex"
    path.write_text(recording(load(name), 7, polls=3, one_by_one=True))
    survey = _modlens.Survey()
    for batch in decode(path, mode="rtu").batches("transactions"):
        survey.add(batch)
    best = ranked(survey, 1, PROFILES)[0]
    assert best[0].fits
    assert best[1].name in {name} | RELATIVES.get(name, set())


@pytest.mark.parametrize("name", NAMES)
def test_a_profile_names_its_source(name: str) -> None:
    device = load(name).device
    assert len(str(device["source"])) > 20
    assert device["vendor"]


def test_match_and_map_name_a_meter(tmp_path: Path, modlens: Modlens) -> None:
    """A block with holes, as masters read it, of a single-phase meter; others also begin at 0."""
    registers = dict.fromkeys(range(0x50), 0)
    for at, value in (
        (0, 231.2),
        (6, 1.5),
        (12, 340.0),
        (0x1E, 0.98),
        (0x46, 50.01),
        (0x48, 812.5),
    ):
        registers[at], registers[at + 1] = struct.unpack(">HH", struct.pack(">f", value))
    data = b"".join(word.to_bytes(2, "big") for word in registers.values())
    path = tmp_path / "bus.hex"
    lines = [frame(b"\x01\x04\x00\x00\x00\x50"), frame(b"\x01\x04\xa0" + data)]
    path.write_text("\n".join(lines) + "\n")
    matched = modlens("match", path).out.splitlines()
    assert "eastron-sdm" in matched[1]
    assert len(matched) == 6
    hinted = modlens("map", path).err
    assert "unit 1 may be Eastron SDM" in hinted
    assert "--profile 1=eastron-sdm" in hinted
    assert "may be" not in modlens("map", path, "--profile", "1=eastron-sdm120").err


def test_a_map_of_no_known_device_says_so(tmp_path: Path, modlens: Modlens) -> None:
    path = tmp_path / "bus.hex"
    path.write_text(
        frame(b"\x01\x03\xf0\x00\x00\x01") + "\n" + frame(b"\x01\x03\x02\x00\x07") + "\n"
    )
    assert "modlens learn makes a draft" in modlens("match", path).out
    assert "may be" not in modlens("map", path).err
