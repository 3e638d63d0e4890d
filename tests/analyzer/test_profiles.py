"""Where profiles come from: files, folders, entry points, bus files."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer.bus_file import choose_bus, load_bus_file
from analyzer.profiles import available_profiles, load, parse_binding, parse_units
from dissectors.errors import ProfileError, UsageError
from tests.conftest import Modlens

POINT = 'profile = 1\n[[registers]]\nat = "hr:{address}"\nname = "{name}"\n'


def test_a_folder_of_ones_own_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MODLENS_PROFILES, then the user's folder, then the shipped ones."""
    (tmp_path / "mightyzap.toml").write_text(POINT.format(address=1, name="mine"))
    assert load("mightyzap").points[0]["name"] == "goal_position"
    monkeypatch.setenv("MODLENS_PROFILES", str(tmp_path))
    assert load("mightyzap").points[0]["name"] == "mine"
    assert available_profiles()[0].origin == str(tmp_path / "mightyzap.toml")
    monkeypatch.delenv("MODLENS_PROFILES")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    folder = tmp_path / "modlens" / "profiles"
    folder.mkdir(parents=True)
    (folder / "pump.csv").write_text("at,name\nhr:1,speed\n")
    assert load("pump").points[0]["name"] == "speed"


def test_entry_points_of_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An installed package brings profiles as text or as a function."""
    (tmp_path / "acme_profiles.py").write_text(
        f"METER = {POINT.format(address=3, name='u')!r}\ndef pump():\n    return METER\n"
    )
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[modlens.profiles]\nacme-meter = acme_profiles:METER\nacme-pump = acme_profiles:pump\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    assert load("acme-meter").points == load("acme-pump").points
    assert "acme-meter" in [one.name for one in available_profiles()]


def test_units() -> None:
    """Units may be one number, a range, several, or all."""
    assert parse_units("1") == (1,)
    assert parse_units("2-4,9") == (2, 3, 4, 9)
    assert len(parse_units("*")) == 256
    assert parse_binding("mightyzap").units == parse_units("*")
    for text in ("", "x", "1-", "256", "5-2"):
        with pytest.raises(UsageError):
            parse_units(text)


PLANT = """\
plant = 1
[[bus]]
name = "pumps"
port = "/dev/ttyUSB0"
line = "9600-8N1"
[bus.units]
1 = "mightyzap"
"2-3" = "own.toml"
[[bus]]
name = "meters"
mode = "rtu"
"""


def test_a_bus_file(tmp_path: Path) -> None:
    """Port, line settings, profiles beside it; one of several buses by its name."""
    (tmp_path / "own.toml").write_text(POINT.format(address=7, name="own"))
    path = tmp_path / "plant.toml"
    path.write_text(PLANT)
    pumps = choose_bus(f"{path}:pumps")
    assert (pumps.port, pumps.line and pumps.line.baud) == ("/dev/ttyUSB0", 9600)
    assert [one.units for one in pumps.profiles] == [(1,), (2, 3)]
    with pytest.raises(UsageError, match="it has pumps, meters"):
        choose_bus(str(path))
    with pytest.raises(UsageError, match="did you mean 'pumps'"):
        choose_bus(f"{path}:pump")


def test_mistakes_in_a_bus_file_are_reported_at_once(tmp_path: Path) -> None:
    """All mistakes in a bus file are reported at once, with their keys."""
    path = tmp_path / "plant.toml"
    path.write_text(
        '[[bus]]\nprot = "x"\nline = "fast"\nmode = "udp"\n[bus.units]\nx = "mightyzap"\n'
    )
    with pytest.raises(ProfileError) as raised:
        load_bus_file(str(path))
    keys = [one.key for one in raised.value.mistakes]
    assert keys == ["plant", "bus[0].prot", "bus[0].line", "bus[0].mode", "bus[0].units.x"]


def test_decode_with_a_bus_file(tmp_path: Path, modlens: Modlens) -> None:
    """`--bus plant.toml` stands for --line and --profile."""
    path = tmp_path / "plant.toml"
    path.write_text('plant = 1\n[[bus]]\nline = "9600-8N1"\n[bus.units]\n1 = "mightyzap"\n')
    log = tmp_path / "bus.hex"
    log.write_text("01 03 00 D2 00 01 24 33\n01 03 02 03 E8 B8 FA\n")
    done = modlens("decode", str(log), "--bus", str(path))
    assert "present_position=1000" in done.out


def test_profiles_list_check_convert(tmp_path: Path, modlens: Modlens) -> None:
    """`modlens profiles` lists, checks and converts profiles."""
    assert "mightyzap" in modlens("profiles").out
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('profile = 1\n[[registers]]\nat = "hr:x"\ntyp = "y"\n')
    done = modlens("profiles", "check", str(wrong))
    assert done.status == 2
    assert len(done.err.splitlines()) == 3
    assert f"modlens: {wrong}:3: registers[0].at: " in done.err
    assert modlens("profiles", "check", "mightyzap").status == 0
    csv = tmp_path / "m.csv"
    assert modlens("profiles", "convert", "mightyzap", "-o", str(csv)).status == 0
    back = modlens("profiles", "convert", str(csv), "--to", "toml")
    assert back.out == modlens("profiles", "convert", "mightyzap").out


def test_import_says_what_it_assumed(tmp_path: Path, modlens: Modlens) -> None:
    """Notes on standard error, the profile on standard output; odd encodings are read."""
    path = tmp_path / "map.csv"
    path.write_bytes("Address;Name;Unit\n5;t;°C\n".encode("cp1252"))
    done = modlens("import", "csv", str(path))
    assert 'unit = "°C"' in done.out
    assert "addresses count from 0, as on the wire (assumed" in done.err
    assert "Windows-1252 (assumed" in done.err
    path.write_bytes("Address;Name\n5;Größe\n".encode("utf-16"))
    assert "Größe" in modlens("import", "csv", str(path)).out
