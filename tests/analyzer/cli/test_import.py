"""`modlens import` and the commands that take profiles, with everything that can be wrong.

Wrong files, encodings, spreadsheets of other countries: each is said with what, where, what to do.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path

import pytest

from analyzer.bus_file import load_bus_file
from analyzer.cli import main
from tests.conftest import CAPTURES, Done, Modlens

HEAD = "Address,Name,Unit\n"
TABLE = f"{HEAD}5,Größe,°C\n"


def of(path: Path, data: bytes | str) -> str:
    """A file with this in it."""
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return str(path)


@pytest.fixture
def here(capfd: pytest.CaptureFixture[str]) -> Modlens:
    """The command in this process: many wrong files are read in the time of one start."""

    def run(*words: str | Path, **_: str) -> Done:
        status = main([str(word) for word in words])
        return Done(status, *capfd.readouterr())

    return run


@pytest.mark.parametrize(
    ("data", "options", "note"),
    [
        (TABLE.encode(), (), None),
        (TABLE.encode("utf-8-sig"), (), None),
        (TABLE.encode("utf-16"), (), None),
        (TABLE.encode("cp1252"), (), "not UTF-8: read as Windows-1252 (assumed; --encoding names"),
        (TABLE.encode("utf-16-le"), (), "read as utf-16-le (assumed; --encoding names another)"),
        (TABLE.encode("utf-16-be"), (), "read as utf-16-be (assumed; --encoding names another)"),
        (TABLE.encode("cp850"), ("--encoding", "cp850"), None),
        (TABLE.replace("\n", "\r\n").encode(), (), None),
        (TABLE.replace(",", ";").encode("cp1252"), (), "Windows-1252"),
    ],
)
def test_encodings(
    data: bytes, options: tuple[str, ...], note: str | None, tmp_path: Path, here: Modlens
) -> None:
    """The encoding is that of the byte order mark, that of the option, or guessed with a note."""
    done = here("import", "csv", of(tmp_path / "map.csv", data), *options)
    assert done.status == 0
    (point,) = tomllib.loads(done.out)["registers"]
    assert (point["name"], point["unit"]) == ("Größe", "°C")
    said = [line for line in done.err.splitlines() if "read as" in line]
    assert bool(said) == (note is not None)
    assert note is None or note in said[0]


@pytest.mark.parametrize(
    "case",
    [
        ("csv", "", (), 2, "map: the file is empty"),
        (
            "csv",
            "Name,Type\nx,INT16\n",
            (),
            2,
            "map:1: no line names the columns: an address (Addr",
        ),
        (
            "csv",
            b"\x7fELF\x00\x00\x01",
            (),
            3,
            "map: not text: a zero at byte 4; --encoding names",
        ),
        ("csv", 'Address,Name\n7,"x\n', (), 2, "map:2: not CSV from here on: "),
        (
            "csv",
            f"{HEAD},x,\n",
            (),
            2,
            "map: it has no point that a profile can hold: line 2, x: no",
        ),
        ("csv", TABLE, ("--encoding", "utf-9"), 2, "--encoding utf-9: no such encoding"),
        ("csv", b"\xff\xfe\x00", (), 3, "map: not valid utf-16 at byte "),
        ("csv", TABLE, ("--base", "2"), 2, "--base: invalid choice: '2'"),
        ("csv", TABLE, ("--order", "ZZ"), 2, "--order: 'ZZ' is not a byte order; ABCD, CDAB"),
        (
            "csv",
            TABLE,
            ("--to", "yaml"),
            2,
            "no format 'yaml' that it writes; choose from toml, csv",
        ),
        ("csv", TABLE, ("-o", "/no/where.toml"), 3, "/no/where.toml: cannot be created: its dir"),
        ("csw", TABLE, (), 2, "no format 'csw' that it reads; did you mean 'csv'?"),
        ("telegraf", "x", (), 2, "map: not TOML: "),
        ("telegraf", TABLE, (), 2, "map: no file for telegraf: it is read by `modlens import csv`"),
        ("homeassistant", "a: [", (), 2, "map:1: not YAML: "),
        ("homeassistant", "a: \x01", (), 2, "map:1: not YAML: unacceptable character"),
        ("homeassistant", "a: !include b", (), 2, "map:1: no modbus: with sensors or switches in"),
        ("esphome", "sensor: []", (), 2, "map: no entity on platform modbus_controller in it"),
        ("sunspec", "{}", (), 2, "map: not a SunSpec model: 'group' is missing"),
    ],
)
def test_wrong_files(
    case: tuple[str, str | bytes, tuple[str, ...], int, str], tmp_path: Path, here: Modlens
) -> None:
    """One line that says what, where, what to do; nothing on standard output."""
    form, data, options, status, part = case
    path = of(tmp_path / "map", data)
    done = here("import", form, path, *options)
    assert (done.status, done.out) == (status, "")
    assert part in done.err.replace(path, "map")
    (_,) = [line for line in done.err.splitlines() if line.startswith("modlens: ")]


def test_a_file_that_is_not_there(tmp_path: Path, modlens: Modlens) -> None:
    """A missing file is reported by name; a folder without files gives nothing."""
    done = modlens("import", "csv", tmp_path / "no.csv")
    assert (done.status, "no.csv: cannot be read: No such file" in done.err) == (3, True)
    done = modlens("import", "csv", tmp_path)
    assert (done.status, "0 of 0 files taken" in done.err) == (3, True)


def test_a_spreadsheet_of_another_country(tmp_path: Path, modlens: Modlens) -> None:
    """Semicolons, decimal commas, a row that appears twice, a column too few: a note each."""
    path = of(
        tmp_path / "map.csv",
        "Register;Name;Faktor;Factor;Unit\r\n5;a;;0,1;V\r\n5;a;;0,1;V\r\n6;b;;1,5\r\n7;c;;x;A\r\n",
    )
    done = modlens("import", "csv", path, "--base", "0")
    points = tomllib.loads(done.out)["registers"]
    assert [(row["at"], row.get("scale"), row.get("unit")) for row in points] == [
        ("hr:5", 0.1, "V"), ("hr:6", 1.5, None), ("hr:7", None, "A"),
    ]  # fmt: skip
    assert done.err.splitlines() == [
        "3 registers",
        "addresses count from 0, as on the wire (as given; --base 0, 1 or modicon overrides)",
        "column 'Faktor' is not understood; skipped",
        "no column names the table: holding registers (assumed)",
        "line 3, a: hr:5 belongs to a; skipped",
        "line 5, c: scale 'x' is not a usable number; skipped",
    ]


def test_standard_input_and_other_formats(tmp_path: Path, modlens: Modlens) -> None:
    """A pipe in, another program's file out; what it cannot say is on standard error."""
    done = modlens("import", "csv", "-", "--to", "telegraf", stdin=TABLE.encode())
    assert done.status == 0
    assert '"Größe"' in done.out
    assert "unit cannot be kept in Telegraf: Größe" in done.err
    path = tmp_path / "meter.toml"
    assert modlens("import", "csv", "-", "-o", path, stdin=TABLE.encode()).out == ""
    assert modlens("profiles", "check", path).out == f"{path}: 1 register, no mistakes\n"


def test_without_the_extra(tmp_path: Path, modlens: Modlens) -> None:
    """Maps in YAML need ruamel.yaml: said with the command that installs it; nothing else does."""
    folder = tmp_path / "ruamel"
    folder.mkdir()
    (folder / "__init__.py").write_text("raise ImportError('not installed')\n")
    paths = {"PYTHONPATH": str(tmp_path)}
    assert sys.version_info >= (3, 11)
    yaml = of(tmp_path / "m.yaml", "profile: 1\n")
    wanted = "YAML needs ruamel.yaml; pip install ruamel.yaml"
    for words in (
        ("import", "homeassistant", yaml), ("import", "esphome", yaml),
    ):  # fmt: skip
        done = modlens(*words, **paths)
        assert (done.status, done.out) == (2, "")
        assert done.err == f"modlens: {yaml}: {wanted}\n"
    assert modlens("import", "csv", "-", stdin=TABLE.encode(), **paths).status == 0
    assert "ruamel" not in modlens("profiles", "check", yaml, **paths).err
    done = modlens("import", "telegraf", of(tmp_path / "x", "x"), **paths)
    assert "not TOML" in done.err


@pytest.mark.parametrize(
    "case",
    [
        ("a.toml", "", 2, ":1: profile: is missing; the file begins with profile = 1"),
        ("a.yaml", "", 2, ":1: profile: is missing; the file begins with profile = 1"),
        ("a.csv", "", 2, ":1: at: no line of keys such as at,name,type,scale,unit"),
        (
            "a.toml",
            "profile = 1\n".encode("utf-16"),
            3,
            ": not valid UTF-8 at byte 0; save it as UTF",
        ),
        (
            "a.csv",
            "at,name,unit\nhr:1,a,°C\n".encode("cp1252"),
            3,
            ": not valid UTF-8 at byte 20; sav",
        ),
    ],
)
def test_profiles_that_are_none(
    case: tuple[str, bytes | str, int, str], tmp_path: Path, here: Modlens
) -> None:
    """All commands that take a profile report an invalid one in the same words."""
    name, data, status, part = case
    path = of(tmp_path / name, data)
    bus = of(tmp_path / "bus.hex", "01 03 00 D2 00 01 24 33\n")
    for words in (
        ("profiles", "check", path), ("decode", bus, "--profile", path),
        ("match", bus, "--with", path),
    ):  # fmt: skip
        done = here(*words)
        assert done.status == status
        assert f"{path}{part}" in done.err


def test_one_bad_profile_hides_no_other(tmp_path: Path, modlens: Modlens) -> None:
    """In a folder of one's own, and in packages: it is named, the rest is there."""
    of(tmp_path / "bad.toml", 'profile = 1\n[[registers]]\nat = "hr:x"\nname = "x"\n')
    (tmp_path / "folder.toml").mkdir()
    info = tmp_path / "acme-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[modlens.profiles]\nacme-gone = acme_gone:METER\nacme-number = acme_here:NUMBER\n"
    )
    (tmp_path / "acme_here.py").write_text("NUMBER = 3\n")
    paths = {"MODLENS_PROFILES": str(tmp_path), "PYTHONPATH": str(tmp_path)}
    listed = modlens("profiles", **paths)
    assert listed.status == 0
    assert re.search(r"^bad +cannot be used: ", listed.out, re.MULTILINE)
    assert f'{tmp_path}/bad.toml:3: registers[0].at: "x" is not an address' in listed.out
    assert "cannot be loaded: ModuleNotFoundError: No module named 'acme_gone'" in listed.out
    assert "is not the text of a profile, but int" in listed.out
    assert re.search(r"^mightyzap +IR Robot", listed.out, re.MULTILINE)
    assert "folder" not in listed.out
    bus = of(tmp_path / "bus.hex", "01 03 00 D2 00 01 24 33\n01 03 02 03 E8 B8 FA\n")
    found = modlens("match", bus, **paths)
    assert found.status == 0
    assert "bad is skipped: " in found.err
    assert "100 %  mightyzap" in found.out


def test_a_bus_file_tells_all_its_mistakes(tmp_path: Path, modlens: Modlens) -> None:
    """A profile that is not there among them, each once."""
    path = of(
        tmp_path / "plant.toml",
        'plant = 1\n[[bus]]\nname = "a"\nline = "19200-8X1"\nmode = ["rtu"]\n[bus.units]\n'
        '1 = "no.toml"\n2 = "mightyzip"\n3-x = "mightyzap"\n',
    )
    bus = of(tmp_path / "bus.hex", "01 03 00 D2 00 01 24 33\n")
    done = modlens("map", bus, "--bus", path)
    keys = [line.split(": ")[2] for line in done.err.splitlines()]
    assert done.status == 2
    assert keys == ["bus[0].mode", "bus[0].line", "bus[0].units.1", "bus[0].units.2",
                    "bus[0].units.3-x"]  # fmt: skip
    assert "no.toml: cannot be read: No such file or directory" in done.err


def test_a_folder_says_what_was_taken_and_why_not(modlens: Modlens, tmp_path: Path) -> None:
    """Each file has its line; the profiles are written to another folder of the same shape."""
    maps, out = tmp_path / "maps", tmp_path / "profiles"
    (maps / "inner").mkdir(parents=True)
    (maps / "a.csv").write_text("Address,Name\n7,flow\n8,\n")
    (maps / "inner" / "b.yaml").write_text(
        "parameters:\n  - items:\n      - {name: x, rule: 1, registers: [7]}\n"
    )
    (maps / "notes.txt").write_text("remember the milk\n")
    done = modlens("import", "auto", maps, "-o", out)
    assert done.status == 0
    lines = done.out.splitlines()
    assert [line.split(":")[0].split() for line in lines] == [
        ["taken", "a.csv"],
        ["taken", "inner/b.yaml"],
        ["not", "taken", "notes.txt"],
    ]
    assert "no register map" in lines[2]
    assert "2 of 3 files taken" in done.err
    assert sorted(path.name for path in out.rglob("*.toml")) == ["a.toml", "b.toml"]
    assert modlens("profiles", "check", out / "inner" / "b.toml").status == 0


def test_a_file_alone_is_read_as_what_it_is(modlens: Modlens, tmp_path: Path) -> None:
    """Without a format it is found; where there is none, each like it says why."""
    (tmp_path / "a.csv").write_text("Address,Name\n7,flow\n")
    done = modlens("import", tmp_path / "a.csv")
    assert (done.status, "read as csv (detected)" in done.err) == (0, True)
    (tmp_path / "b.json").write_text('{"device": {"protocol": "ivtm", "channels": [{}]}}')
    assert "wb-mqtt-serial: protocol ivtm, not Modbus" in modlens("import", tmp_path / "b.json").err


def test_a_folder_without_a_map_is_unreadable(modlens: Modlens, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("remember the milk\n")
    assert modlens("import", "auto", tmp_path).status == 3
    assert "did you mean 'solarman'" in modlens("import", "solarmann", tmp_path).err


HOME_ASSISTANT = """
modbus:
  - name: "Plant room"
    type: serial
    port: /dev/ttyUSB0
    baudrate: 19200
    parity: E
    sensors:
      - {name: "Room temperature", slave: 1, address: 0, scale: 0.1}
      - {name: "Tank level", slave: 2, address: 100}
  - name: heat pump
    type: tcp
    host: 10.0.0.5
    sensors:
      - {name: flow, slave: 1, address: 3}
"""


def test_a_file_of_several_units_becomes_a_bus_file(here: Modlens, tmp_path: Path) -> None:
    """Each hub is a bus with its own units: unit 1 of one hub is not unit 1 of the other."""
    source, target = tmp_path / "ha.yaml", tmp_path / "plant.toml"
    source.write_text(HOME_ASSISTANT, encoding="utf-8")
    done = here("import", str(source))
    assert done.status == 2
    assert "choose a unit with --unit N; there are 1, 2. Or -o FILE.toml" in done.err
    assert here("import", str(source), "-o", str(target)).status == 0
    room, pump = load_bus_file(str(target))
    assert (room.name, room.port, str(room.line), room.mode) == (
        "Plant room", "/dev/ttyUSB0", "19200-8E1", "rtu",
    )  # fmt: skip
    assert (pump.name, pump.port, pump.mode) == ("heat pump", None, "tcp")
    names = [
        [
            (tuple(one.units), [point["name"] for point in one.profile.points])
            for one in bus.profiles
        ]
        for bus in (room, pump)
    ]
    assert names == [[((1,), ["Room temperature"]), ((2,), ["Tank level"])], [((1,), ["flow"])]]
    recording = str(CAPTURES / "pymodbus_two_units" / "recording.jsonl")
    done = here("map", recording, "--bus", f"{target}:Plant room", "--named", "--json")
    assert [(row["unit"], row["name"]) for row in map(json.loads, done.out.splitlines())] == [
        (1, "Room temperature"), (2, "Tank level"),
    ]  # fmt: skip


def test_a_unit_is_chosen_without_a_format(here: Modlens, tmp_path: Path) -> None:
    source = tmp_path / "ha.yaml"
    source.write_text(HOME_ASSISTANT, encoding="utf-8")
    done = here("import", str(source), "--unit", "2")
    assert done.status == 0
    assert "Tank level" in done.out
    assert "Room temperature" not in done.out


def test_one_unit_on_two_hubs_is_not_mixed(here: Modlens, tmp_path: Path) -> None:
    source = tmp_path / "ha.yaml"
    source.write_text(HOME_ASSISTANT.replace("slave: 2", "slave: 1"), encoding="utf-8")
    done = here("import", "homeassistant", str(source), "--unit", "1")
    assert done.status == 2
    assert "-o FILE.toml" in done.err
