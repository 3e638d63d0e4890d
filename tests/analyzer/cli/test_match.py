"""`modlens match` on devices of known and unknown maps, with values that chance moves.

The traffic follows the profiles (`tests.support.profile_traffic`); of the other family are devices
that answer the same requests with floats for integers, or integers for floats.
"""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

import _modlens
from analyzer import decode
from analyzer.cli.known_devices import ProfileScore, ranked, usable_profiles
from analyzer.profiles import load
from dissectors.profile import Profile, parse
from tests.conftest import Modlens
from tests.support.profile_traffic import frame, recording
from tests.support.random_devices import RandomDevice

PROFILES = list(usable_profiles())
SEEDS = (31, 32)
RELATIVES = {"eastron-sdm230": "eastron-sdm120", "durapulse-gs3": "delta-vfd"}
"""Devices whose points are all in another map as well."""


def scores(text: str, folder: Path, unit: int = 1) -> list[tuple[ProfileScore, Profile]]:
    """All known profiles for a recording in hex, the best first."""
    path = folder / "bus.hex"
    path.write_text(text)
    survey = _modlens.Survey()
    for batch in decode(path, mode="rtu").batches("transactions"):
        survey.add(batch)
    return ranked(survey, unit, PROFILES)


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.name)
def test_the_right_profile_is_first(profile: Profile, tmp_path: Path) -> None:
    """Also where the master asks for a part only; then no wrong one may fit."""
    for seed in SEEDS:
        score, first = scores(recording(profile, seed), tmp_path)[0]
        assert first.name in (profile.name, RELATIVES.get(profile.name)), score.reasons


@pytest.mark.parametrize("profile", PROFILES, ids=lambda profile: profile.name)
def test_no_profile_fits_a_device_of_the_other_family(profile: Profile, tmp_path: Path) -> None:
    for seed in SEEDS:
        found = scores(recording(profile, seed, other_family=True), tmp_path)
        fitting = {other.name: score.reasons for score, other in found if score.fits}
        assert not fitting


def test_no_profile_fits_devices_that_chance_has_made(tmp_path: Path) -> None:
    for seed in range(401, 409):
        assert not scores(RandomDevice(seed).recording(), tmp_path, unit=9)[0][0].fits


def test_a_float_meter_is_no_inverter_of_integers(tmp_path: Path, modlens: Modlens) -> None:
    """Addresses 0 to 79 are in several maps; voltages in floats are none of their integers."""
    lines = []
    for turn in range(30):
        values = [230.1 + turn % 7 / 10, 231.4, 229.8, 4.2 + turn % 5 / 9, 3.9, 4.4, 50.01]
        data = b"".join(struct.pack(">f", value) for value in (values * 6)[:40])
        lines += [frame(b"\x01\x04\x00\x00\x00\x50"), frame(b"\x01\x04\xa0" + data)]
    path = tmp_path / "bus.hex"
    path.write_text("\n".join(lines) + "\n")
    out = modlens("match", path, "--with", "eg4-luxpower").out
    assert int(out.splitlines()[1].split()[0]) < 20
    assert "no profile fits" in out


PHASES = """
profile = 1
[[registers]]
at = "hr:0"
name = "voltage_l1"
scale = 0.1
unit = "V"
[[registers]]
at = "hr:1"
name = "current_l1"
scale = 0.01
unit = "A"
[[registers]]
at = "hr:2"
name = "power_l1"
unit = "W"
"""


@pytest.mark.parametrize(("watts", "holds"), [(1840, True), (60_000, False)])
def test_a_power_is_voltage_times_current(watts: int, *, holds: bool, tmp_path: Path) -> None:
    """230 V times 8 A is 1,840 W."""
    lines = []
    for turn in range(20):
        data = struct.pack(">HHH", 2300 + turn % 3, 800 + turn % 2, watts + turn)
        lines += [frame(b"\x01\x03\x00\x00\x00\x03"), frame(b"\x01\x03\x06" + data)]
    path = tmp_path / "bus.hex"
    path.write_text("\n".join(lines) + "\n")
    survey = _modlens.Survey()
    for batch in decode(path, mode="rtu").batches("transactions"):
        survey.add(batch)
    ((score, _),) = ranked(survey, 1, [parse(PHASES, "phases.toml")])
    assert score.fits == holds
    relation = "power_l1 = voltage_l1 x current_l1"
    assert (relation if holds else f"not {relation}") in score.reasons


def test_a_value_outside_its_labels_speaks_against_a_profile(tmp_path: Path) -> None:
    text = 'profile = 1\n[[registers]]\nat = "hr:0"\nname = "m"\nenum = {0 = "off", 1 = "on"}\n'
    path = tmp_path / "bus.hex"
    lines = [frame(b"\x01\x03\x00\x00\x00\x01"), frame(b"\x01\x03\x02\x00\x4d")]
    path.write_text("\n".join(lines) + "\n")
    survey = _modlens.Survey()
    for batch in decode(path, mode="rtu").batches("transactions"):
        survey.add(batch)
    ((score, _),) = ranked(survey, 1, [parse(text, "m.toml")])
    assert not score.fits
    assert "m with values outside its labels" in score.reasons
    assert ranked(survey, 1, [load("grundfos")])[0][0].percent == 0
