"""The registry of importers: what every format has to do, whatever it is."""

from __future__ import annotations

import importlib

import pytest

from dissectors import importers
from dissectors.errors import ProfileError, UsageError
from dissectors.importers import FORMATS
from tests.conftest import ROOT

READERS = [name for name, form in FORMATS.items() if form.reads]

EXAMPLES = {
    "csv": "Address,Name\n7,x\n",
    "telegraf": '[[inputs.modbus]]\nholding_registers = [{ name = "x", address = [7] }]\n',
    "homeassistant": "modbus:\n  - sensors:\n      - {name: x, address: 7}\n",
    "esphome": "sensor:\n  - {platform: modbus_controller, name: x, address: 7}\n",
    "sunspec": '{"id": 1, "group": {"points": [{"name": "ID", "type": "uint16"}]}}\n',
    "solarman": "parameters:\n  - items:\n      - {name: x, rule: 1, registers: [7]}\n",
    "evcc": "source: modbus\nregister:\n  address: 7\n  type: holding\n  decode: uint16\n",
    "wb-mqtt-serial": '{"device": {"channels": [{"name": "x", "address": 7}]}}\n',
    "openhab": 'Bridge modbus:poller:p [ type="holding" ] {\n'
    '  Thing data x [ readStart="7", readValueType="uint16" ]\n}\n',
    "modpoll": "device,d,1\npoll,holding_register,0,9,BE_BE\nref,x,7,uint16,r\n",
}
"""The smallest file of each."""


def test_every_format_that_is_read_has_an_example() -> None:
    """Every format that is read has an example, by which the tests below check it."""
    assert list(EXAMPLES) == READERS


@pytest.mark.parametrize("form", READERS)
def test_the_smallest_file_is_read(form: str) -> None:
    """One point; a byte order mark in front of it does no harm."""
    for mark in ("", "\ufeff"):
        assert len(importers.read(form, mark + EXAMPLES[form], "map").model["registers"]) == 1


@pytest.mark.parametrize("form", READERS)
@pytest.mark.parametrize("text", ["", "\n\n", "\ufeff"])
def test_an_empty_file_is_reported_as_empty(form: str, text: str) -> None:
    """An empty file is refused with its name."""
    with pytest.raises(ProfileError, match=r"^map: the file is empty$"):
        importers.read(form, text, "map")


@pytest.mark.parametrize("form", READERS)
@pytest.mark.parametrize("other", READERS)
def test_a_file_of_another_format_names_it(form: str, other: str) -> None:
    """What to do about it: the command that reads it."""
    if form == other:
        return
    said = f"^map: no file for {form}: it is read by `modlens import {other}`$"
    with pytest.raises(ProfileError, match=said):
        importers.read(form, EXAMPLES[other], "map")


@pytest.mark.parametrize("form", READERS)
def test_a_text_of_another_format_is_reported(form: str) -> None:
    """A text of another format is refused with the file's name."""
    with pytest.raises(ProfileError, match=r"^map"):
        importers.read(form, "x: [1]\n" if form in ("homeassistant", "esphome") else "{", "map")


def test_unknown_formats() -> None:
    """An unknown format is reported with a similar name."""
    with pytest.raises(UsageError, match="did you mean 'telegraf'"):
        importers.read("telegraph", "", "x")


def test_every_importer_is_in_the_registry() -> None:
    """Every module that reads or writes, and the ways that its row says."""
    folder = ROOT / "dissectors" / "importers"
    rows = {form.module: form for form in FORMATS.values()}
    for path in folder.glob("[!_]*.py"):
        module = importlib.import_module(f"dissectors.importers.{path.stem}")
        row = rows.get(path.stem)
        assert hasattr(module, "read") == (row is not None and row.reads), path.stem
        assert hasattr(module, "write") == (row is not None and row.writes), path.stem
