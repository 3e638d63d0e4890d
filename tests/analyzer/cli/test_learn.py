"""`learn`, `match`, `map`, `show --at`: what traffic reports a device."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

import _modlens
from analyzer import decode
from dissectors.profile import parse
from tests.conftest import CAPTURES, Done, Modlens
from tests.support.typed_device import SINGLES, TRUTH

TYPES = str(CAPTURES / "pymodbus_types" / "recording.jsonl")


def learnt(modlens: Modlens) -> dict[int, tuple[str, str]]:
    """Address -> type and order that were claimed for several registers."""
    done = modlens("learn", TYPES, "--line", "57600-8E1")
    model = tomllib.loads(done.out)
    claims = {}
    for point in model["registers"]:
        kind = point.get("type", "u16")
        if kind not in ("u16", "s16"):
            claims[int(point["at"].removeprefix("hr:"))] = (kind, point.get("order", "ABCD"))
    return claims


def test_learn_finds_types_and_orders(modlens: Modlens) -> None:
    """Nine of ten values of several registers, and at most one claim of twenty is wrong."""
    claims = learnt(modlens)
    right = {
        address for address, wide in TRUTH.items()
        if claims.get(address) == (wide.kind, wide.order)
    }  # fmt: skip
    wrong = {address: claim for address, claim in claims.items() if address not in right}
    assert len(right) >= 0.9 * len(TRUTH), sorted(set(TRUTH) - right)
    assert len(wrong) <= 0.05 * len(claims), wrong


def test_learn_says_why(modlens: Modlens) -> None:
    """The evidence of claims and blocks; single registers by what they look like."""
    done = modlens("learn", TYPES, "--line", "57600-8E1")
    assert "unit 5 hr 10: u32 ABCD" in done.err
    assert "the upper register steps as the lower one wraps around" in done.err
    assert "0-65 (60 reads)" in done.err
    profile = parse(done.out, "learnt.toml")
    notes = {point["at"]: point["note"] for point in profile.points}
    assert notes["hr:1"] == "one of 0, 1, 3"
    assert notes["hr:36"] == "constant 4711"
    assert notes["hr:57"].startswith("signed")
    assert set(SINGLES) - {1, 36, 57} <= {int(at[3:]) for at in notes}


def test_a_learnt_profile_reads_the_recording(modlens: Modlens, tmp_path: Path) -> None:
    """What was learnt decodes to the values that the device had."""
    path = tmp_path / "device.toml"
    assert modlens("learn", TYPES, "--line", "57600-8E1", "-o", str(path)).status == 0
    rows = decode(TYPES, line="57600-8E1", profiles=[f"5={path}"]).readings
    found = {row.name: row.value_text for row in rows.where("txn == 1")}
    assert found["hr_26"] == "modlens typed device"
    assert float(str(found["hr_2"])) == TRUTH[2].value(1)
    assert found["hr_12"] == str(TRUTH[12].value(1))


def frames(tmp_path: Path, *lines: str) -> str:
    """A file of hex lines, checksums added."""
    path = tmp_path / "bus.hex"
    texts = []
    for line in lines:
        data = bytes.fromhex(line)
        texts.append((data + _modlens.crc16(data).to_bytes(2, "little")).hex(" "))
    path.write_text("\n".join(texts) + "\n")
    return str(path)


MIGHTYZAP = (
    "01 03 00D2 0001", "01 03 02 03E8", "01 03 00D3 0001", "01 03 02 01AA",
    "01 06 00CD 03E8", "01 06 00CD 03E8",
)  # fmt: skip


def test_match_finds_the_profile(tmp_path: Path, modlens: Modlens) -> None:
    """The servo's frames fit the servo's profile, and no other."""
    done = modlens("match", frames(tmp_path, *MIGHTYZAP))
    assert done.status == 0
    lines = done.out.splitlines()
    assert lines[0] == "unit 1"
    assert lines[1].startswith("  100 %  mightyzap: 3 of 3 requested addresses are in this profile")
    assert all(int(line.split()[0]) < 60 for line in lines[2:])
    assert len(lines) == 6


def test_refusals_and_cut_values_lower_the_score(tmp_path: Path, modlens: Modlens) -> None:
    """A profile whose registers the device refuses does not fit."""
    refused = frames(tmp_path, "01 03 00D2 0001", "01 83 02", "01 03 00D3 0001", "01 03 02 01AA")
    done = modlens("match", refused, "--with", "mightyzap")
    assert " 50 %  mightyzap" in done.out
    assert "1 of 2 requests for them got an exception" in done.out
    wide = tmp_path / "wide.toml"
    wide.write_text('profile = 1\n[[registers]]\nat = "hr:210"\nname = "w"\ntype = "u32"\n')
    done = modlens("match", frames(tmp_path, *MIGHTYZAP), "--with", str(wide))
    assert "w only partly covered by requests" in done.out


def test_map(tmp_path: Path, modlens: Modlens) -> None:
    """Last value, range, changes; writes count, refused ones do not."""
    path = frames(
        tmp_path, "01 03 00D2 0001", "01 03 02 03E8", "01 03 00D2 0001", "01 03 02 0010",
        "01 06 00CD 0320", "01 06 00CD 0320", "01 06 00CD 0001", "01 86 03",
    )  # fmt: skip
    done = modlens("map", path, "--profile", "1=mightyzap", "--json")
    rows = {row["name"]: row for row in map(json.loads, done.out.splitlines())}
    position = rows["present_position"]
    assert (position["value"], position["min"], position["max"]) == (16, 16, 1000)
    assert (position["count"], position["changes"], position["reads"]) == (2, 1, 2)
    assert (rows["goal_position"]["value"], rows["goal_position"]["writes"]) == (800, 1)
    done = modlens("map", path, "--profile", "1=mightyzap", "--named", "--address", "6digit")
    assert "400211" in done.out
    assert "present_position" in done.out


def test_show_at_marks_the_plausible_reading(modlens: Modlens) -> None:
    """A float in swapped words: the raw words, every reading, and the reason."""
    done = modlens("show", TYPES, "--line", "57600-8E1", "--at", "5:hr:6", "--count", "2")
    assert "*f32 CDAB" in done.out
    assert "plausible: f32 CDAB: " in done.out.splitlines()[-1]
    done = modlens("show", TYPES, "--line", "57600-8E1", "--at", "5:hr:10", "--as", "u32")
    assert "*u32 ABCD" in done.out
    assert "f32" not in done.out.splitlines()[1]
    done = modlens("show", TYPES, "--line", "57600-8E1", "--at", "5:hr:0", "--count", "1")
    assert done.status == 0


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("--at", "5:xx:6"), "3:hr:107"),
        (("--at", "5:hr:6", "--count", "3"), "1, 2 or 4"),
        (("--at", "5:hr:6", "--as", "f64"), "choose from u32, s32, f32"),
        (("--at", "6:hr:6"), "no transaction"),
        (("--at", "5:hr:6", "--txn", "1"), "neither --frame"),
    ],
)
def test_show_at_wrong_use(words: tuple[str, ...], part: str, modlens: Modlens) -> None:
    """Invalid values of `--at`, `--count` and `--as` are reported with valid ones."""
    done = modlens("show", TYPES, *words)
    assert done.status == 2
    assert part in done.err


def test_order_mismatch_is_found(tmp_path: Path, modlens: Modlens) -> None:
    """A profile with the wrong order of floats is reported once, with the right order."""
    path = tmp_path / "wrong.toml"
    path.write_text(
        'profile = 1\n[[registers]]\nat = "hr:6"\nname = "power"\ntype = "f32"\n'
        '[[registers]]\nat = "hr:2"\nname = "voltage"\ntype = "f32"\n'
    )
    recording = decode(TYPES, line="57600-8E1", profiles=[f"5={path}"])
    rows = list(recording.findings.where("code == 'order_mismatch'"))
    assert [row.detail.split(":")[0] for row in rows] == ["power"]
    assert "CDAB, not ABCD" in rows[0].detail
    assert modlens("explain", "order_mismatch").status == 0


def phases(tmp_path: Path) -> Path:
    """Three voltages of a mains of 120 V, three currents and powers, in integers, once a second."""
    lines = []
    for turn in range(200):
        volts = [1203 + turn * step % 31 for step in (7, 11, 13)]
        amps = [400 + turn * step % 350 for step in (17, 23, 29)]
        watts = [round(0.97 * u * i / 1000) for u, i in zip(volts, amps, strict=True)]
        data = b"".join(word.to_bytes(2, "big") for word in (*volts, *amps, *watts))
        for delay, body in ((0.0, b"\x01\x03\x00\x00\x00\x09"), (0.05, b"\x01\x03\x12" + data)):
            frame = body + _modlens.crc16(body).to_bytes(2, "little")
            lines.append(json.dumps({"t": 1_781_515_800 + turn + delay, "hex": frame.hex()}))
    path = tmp_path / "phases.jsonl"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_value_that_a_display_showed_settles_the_scale_of_its_group(
    tmp_path: Path, modlens: Modlens
) -> None:
    """Of 120 V nothing is known beforehand; one voltage says it of all three phases."""
    path = phases(tmp_path)
    scales = {
        row["address"]: row["scale"] for row in rows_of(modlens("learn", path, "--to", "jsonl"))
    }
    assert scales[0] is None
    value = f"{(1203 + 100 * 7 % 31) / 10}"
    shown = ("--value", value, "--at", "2026-06-15T09:31:40Z", "--within", "1s")
    more = ("--value", f"{(1203 + 150 * 7 % 31) / 10}", "--at", "2026-06-15T09:32:30Z")
    done = modlens("learn", path, "--to", "jsonl", *shown, *more)
    assert "unit 1 hr 0 x 0.1 holds the value" in done.err
    scales = {row["address"]: row["scale"] for row in rows_of(done)}
    assert [scales[at] for at in range(3)] == [0.1, 0.1, 0.1]


def test_a_value_that_no_register_holds_settles_nothing(tmp_path: Path, modlens: Modlens) -> None:
    words = ("--value", "77777.7", "--at", "2026-06-15T09:31:40Z")
    done = modlens("learn", phases(tmp_path), *words)
    assert "which register holds the value is open" in done.err


def rows_of(done: Done) -> list[dict[str, Any]]:
    """The rows of JSON lines."""
    assert done.status == 0, done.err
    return [json.loads(line) for line in done.out.splitlines()]


def test_the_table_says_first_what_a_person_can_settle(tmp_path: Path, modlens: Modlens) -> None:
    """Nothing fixes the scale of a mains of 120 V; the registers are named with a command."""
    done = modlens("learn", phases(tmp_path), "--to", "table")
    lines = done.out.splitlines()
    assert lines[0].startswith("unit 1  holding registers  200 reads, ")
    assert lines[1].startswith("  scale open: hr 0, 1, 2")
    assert "--value X --at TIME" in lines[2]
    row = next(line for line in lines if line.startswith("  hr 0 "))
    assert "u16" in row
    assert "measurement" in row
    assert " %" in row


def test_the_table_is_for_a_terminal(tmp_path: Path, modlens: Modlens) -> None:
    """A file gets a profile or JSON lines."""
    done = modlens("learn", phases(tmp_path), "--to", "table", "-o", str(tmp_path / "out"))
    assert done.status != 0
    assert "--to table" in done.err
