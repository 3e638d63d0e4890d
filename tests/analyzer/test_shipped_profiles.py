"""Every shipped profile: its device is named from traffic that asks for its points, as masters do.

The values are of a usual size for each type; what is in the profile was checked against its source
by two readers.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import decode
from analyzer.cli.known_devices import device_hints, ranked, usable_profiles
from analyzer.profiles import load
from dissectors.profile import Profile
from tests.conftest import Modlens

NAMES = [name for name, _ in _modlens.shipped_profiles()]
PROFILES = list(usable_profiles())
READ = {"hr": 3, "ir": 4}
RELATIVES = {
    "eastron-sdm230": {"eastron-sdm120"},
    "durapulse-gs3": {"delta-vfd"},
}
"""Devices whose points are all in another map as well."""


def frame(*parts: bytes) -> str:
    """A frame in hex, with its checksum."""
    body = b"".join(parts)
    return (body + _modlens.crc16(body).to_bytes(2, "little")).hex(" ")


def value_of(point: Mapping[str, Any], width: int) -> bytes:
    """Registers as the device may send them."""
    kind = point.get("type", "u16")
    labels = sorted(map(int, point.get("enum", ()))) or [2310]
    plain = {"f32": struct.pack(">f", 229.8), "f64": struct.pack(">d", 4321.0)}.get(kind)
    data = plain or labels[0].to_bytes(2 * width, "big")
    words = [data[at : at + 2] for at in range(0, len(data), 2)]
    return b"".join(words[::-1] if point.get("order") == "CDAB" else words)


def polls(profile: Profile) -> Iterator[str]:
    """A request and its response for each point that can be read."""
    for point in profile.points:
        space, _, place = point["at"].partition(":")
        address = int(place.partition(".")[0])
        width = point.get("count") or {"32": 2, "64": 4}.get(point.get("type", "u16")[1:], 1)
        head = bytes([1, READ[space]])
        yield frame(head, struct.pack(">HH", address, width))
        yield frame(head, bytes([2 * width]), value_of(point, width))


@pytest.mark.parametrize("name", NAMES)
def test_the_device_is_named_from_its_polls(name: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.hex"
    path.write_text("\n".join(polls(load(name))) + "\n")
    survey = _modlens.Survey()
    for batch in decode(path, mode="rtu").batches("transactions"):
        survey.add(batch)
    tables = json.loads(survey.tables())
    best = ranked(tables, PROFILES)[0]
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
    lines = [frame(b"\x01\x04\x00\x00\x00\x50"), frame(b"\x01\x04\xa0", data)]
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


def test_registers_that_are_no_floats_speak_against_a_meter() -> None:
    """The upper register of a float of a usual size has an exponent near 127."""
    table = {
        "unit": 1,
        "space": "ir",
        "blocks": [{"first": 0, "count": 14, "reads": 9, "writes": 0, "exceptions": {}}],
        "registers": [
            {"address": at, "min": 2301, "max": 2320, "values": [], "read": True}
            for at in range(14)
        ],
        "points": [],
        "together": [],
    }
    (score, _), *_ = ranked([table], [load("eastron-sdm120")])
    assert not score.fits
    assert "no such number" in " ".join(score.reasons)
    assert list(device_hints([table], [load("eastron-sdm120")])) == []
