"""Bytes beside their meaning, the register map, profiles, the values of a register over time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import modlens as api
from dissectors.describe import describe, has_checksum, pdu_of
from tests.conftest import CAPTURES, Modlens
from tests.support.browser import Browser
from tests.support.page import SPELLINGS, STATE, TROUBLE, TYPED, saved, show

BYTES = "Page.ask({ call: 'bytes', table: arguments[0], where: null, at: arguments[1] })"
MAP = "Page.ask({ call: 'map' })"

EXCHANGE = """\
Tx: 11 03 00 6B 00 02 B7 47
Rx: 11 03 04 00 D2 00 64 4A 20
Tx: 11 03 00 6B 00 02 B7 47
Rx: 11 03 04 00 DC 00 64 2B E3
"""
"""Registers 107 and 108 of unit 17: 210 and 100, then 220 and 100."""

PROFILE = {
    "toml": 'profile = 1\n[[registers]]\nat = "hr:107"\nname = "room"\ntype = "s16"\nscale = 0.1\n',
    "yaml": "# of the room\nprofile: 1\nregisters:\n  - at: hr:107\n    name: room\n"
    "    type: s16\n    scale: 0.1\n",
    "csv": "at,name,type,scale,unit\nhr:107,room,s16,0.1,degC\n",
}  # fmt: skip


@pytest.fixture
def exchange(tmp_path: Path) -> Path:
    """Two polls of two registers, as a log."""
    path = tmp_path / "polls.log"
    path.write_text(EXCHANGE)
    return path


def blocks(data: bytes, **known: Any) -> list[list[Any]]:
    """What `modlens show` draws of a frame."""
    return [
        [one.offset, one.data.hex(), one.name, one.value, one.meaning, one.is_valid]
        for one in describe(data, **known)
    ]


def test_a_row_shows_its_bytes_beside_their_meaning(opened: Browser, exchange: Path) -> None:
    """Numbers of registers come from the request; the wrong is marked in words, too."""
    show(opened, exchange)
    opened.run("document.querySelectorAll('.grid-lines .grid-row')[0].click()")
    opened.wait("document.documentElement.dataset.detail === '0'")
    cells = opened.run(
        "return [...document.querySelectorAll('#detail .bytes')].map((table) =>"
        " [...table.querySelectorAll('tbody tr')].map((row) =>"
        " [...row.cells].map((cell) => cell.textContent)))"
    )
    assert cells[0][2] == ["2", "00 6b", "address", "107", "107 = 0x006B, 400108 (40108)"]
    assert cells[1][3][2:] == ["registers[0]", "210", "400108: u16 210, s16 210, 0x00D2"]
    assert cells[1][-1][-1] == "CRC OK"


def test_bytes_are_those_of_the_command(opened: Browser) -> None:
    """Transactions and frames of lines with damage, of ASCII and of a network."""
    for name in ("pymodbus_disturbed", "pymodbus_ascii", "pymodbus_tcp"):
        (path,) = CAPTURES.joinpath(name).glob("recording.*")
        show(opened, path)
        decoded = api.decode(str(path))
        asked = {}
        for at, row in enumerate(list(decoded.transactions)[:40]):
            known = {
                which: has_checksum(data, row.mode, is_sound=row.status != f"bad_{which}")
                for which, data in (("request", row.request_hex), ("response", row.response_hex))
            }
            request = pdu_of(row.request_hex, row.mode, has_checksum=known["request"])
            asked[row.txn] = request
            shown = opened.ask(BYTES, "transactions", at)
            for one in shown:
                data = row.request_hex if one["title"] == "request" else row.response_hex
                assert one["blocks"] == blocks(
                    data,
                    mode=row.mode,
                    direction=one["title"],
                    request=request,
                    has_checksum=known[one["title"]],
                )
            assert len(shown) == bool(row.request_hex) + bool(row.response_hex)
        for at, frame in enumerate(list(decoded.frames)[:40]):
            (one,) = opened.ask(BYTES, "frames", at)
            assert one["blocks"] == blocks(
                frame.hex,
                mode=frame.mode,
                direction=frame.direction,
                request=asked.get(frame.txn) if frame.direction == "response" else None,
                has_checksum=frame.verdict != "no_checksum",
            )


def test_the_map_is_that_of_the_command(opened: Browser, modlens: Modlens) -> None:
    """Every register with its last value; the tab shows a line for each."""
    show(opened, TYPED)
    lines = modlens("map", TYPED, "--json").out.splitlines()
    expected = [json.loads(line) | {"bus": TYPED.name} for line in lines]
    assert expected
    assert opened.ask(MAP) == expected
    opened.run("document.getElementById('tab-registers').click()")
    opened.wait("document.querySelector('.grid').getAttribute('aria-label') === 'registers'")
    opened.wait("document.querySelectorAll('.grid-lines .grid-row').length > 0")
    assert opened.run("return document.getElementById('shown').textContent") == (
        f"{len(expected)} rows"
    )


@pytest.mark.parametrize("form", list(PROFILE))
def test_a_profile_names_the_registers(
    form: str, opened: Browser, exchange: Path, tmp_path: Path
) -> None:
    """Dropped after a recording, it is used at once; the register is drawn over time."""
    show(opened, exchange)
    profile = tmp_path / f"room.{form}"
    profile.write_text(PROFILE[form])
    show(opened, profile)
    first = opened.ask(MAP)[0]
    assert (first["name"], first["value"], first["min"]) == ("room", 22, 21)
    assert "room." in opened.run("return document.getElementById('profiles').textContent")
    opened.run("document.getElementById('tab-registers').click()")
    opened.wait("document.querySelectorAll('.grid-lines .grid-row').length === 2")
    opened.run("document.querySelectorAll('.grid-lines .grid-row')[0].click()")
    opened.wait("document.querySelector('#detail canvas')")
    assert (
        opened.run("return document.querySelector('#detail h2').textContent") == "room of unit 17"
    )


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        (
            "wrong.toml",
            'profile = 1\n[[registers]]\nat = "hr:1"\nname = "a"\ntype = "u23"\n',
            "wrong.toml: line 5, ",
        ),
        (
            "wrong.yaml",
            "profile: 1\nregisters:\n  - at: hr:1\n    name: a\n    type: u23\n",
            "wrong.yaml: line 5, ",
        ),
        ("broken.yml", "profile: 1\nregisters: [\n", "broken.yml: line 3: not YAML: "),
    ],
)
def test_mistakes_of_a_profile_are_said(
    name: str, text: str, said: str, opened: Browser, tmp_path: Path
) -> None:
    """With the line, as the command says them."""
    wrong = tmp_path / name
    wrong.write_text(text)
    opened.run(f"{STATE} = 'waiting'")
    opened.send_file("#file", wrong)
    opened.wait(f"{STATE} === 'refused'")
    assert opened.run(TROUBLE).startswith(said)


def test_yaml_gives_the_rows_of_toml(opened: Browser, modlens: Modlens, tmp_path: Path) -> None:
    """Values, map and transactions, and those of the command."""
    found = {}
    for form, text in SPELLINGS.items():
        profile = tmp_path / f"typed.{form}"
        profile.write_text(text, "utf-8")
        opened.open(Path(opened.run("return decodeURI(location.pathname)")), "ready")
        show(opened, TYPED)
        show(opened, profile)
        found[form] = opened.ask(MAP), saved(opened, "readings"), saved(opened, "transactions")
        lines = modlens("map", TYPED, "--json", "--profile", profile).out.splitlines()
        assert found[form][0] == [json.loads(line) | {"bus": TYPED.name} for line in lines]
    assert found["yaml"] == found["toml"]
    assert {"level", "flow", "mode", "NO"} <= {row.get("name") for row in found["yaml"][0]}


def test_register_types_are_called_as_in_profiles(opened: Browser) -> None:
    """The words of the format (docs/profiles.md), in the table of the registers."""
    show(opened, TYPED)
    opened.run("document.getElementById('tab-registers').click()")
    opened.wait("document.querySelectorAll('.grid-lines .grid-row').length > 0")
    types = opened.run(
        "return [...document.querySelectorAll('.grid-lines .grid-row')]"
        ".map((row) => row.children[1].textContent)"
    )
    assert {one.partition(":")[0] for one in types} == {"hr"}
    assert types[0] == "hr:0"
