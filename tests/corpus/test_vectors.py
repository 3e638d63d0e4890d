"""Single frames of other projects' tests and of documents, each with its meaning.

Needs the environment variable CORPUS: a folder with vectors/{rtu,ascii,tcp,seed_documents}.jsonl.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

import _modlens

VECTORS = Path(os.environ["CORPUS"]) / "vectors"
WORDS = {
    "addr": ("address", "write_address"),
    "qty": ("quantity", "write_quantity"),
    "value": ("write_data",),
    "regs": ("data",),
}


def load(name: str) -> list[dict[str, Any]]:
    lines = (VECTORS / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


def decode(mode: str, *frames: bytes) -> _modlens.Batch:
    """Frames as lines of hex text, so that each is a record."""
    session = _modlens.Session(_modlens.Functions())
    bus = session.add_bus("vector", source="vector", mode=mode)
    text = "\n".join(frame.hex(" ") for frame in frames)
    session.open_text(bus, "hex", ordered=True)
    session.feed_text(bus, text.encode(), final=True)
    session.flush()
    return session.take()


def wire(row: dict[str, Any]) -> bytes:
    return bytes.fromhex(row.get("complete_hex") or row["hex"])


FRAMES = {
    f"{name}-{i}": row
    for name in ("rtu", "ascii", "tcp", "seed_documents")
    for i, row in enumerate(load(name))
    if row["mode"] in ("rtu", "ascii", "tcp") and row.get("expect", "valid") == "valid"
}
SERIAL = {name: row for name, row in FRAMES.items() if row["mode"] != "tcp"}


def says(meaning: str, txn: dict[str, Any]) -> list[str]:
    """What the source's words and our columns have differently."""
    wrong = []
    for part in meaning.split():
        key, _, text = part.partition("=")
        if key == "fc":
            if int(text) != txn["function"]:
                wrong.append(part)
        elif key == "code":
            if int(text) != txn["exception"]:
                wrong.append(part)
        elif key in ("addr", "qty") and "response" not in meaning and text.isdigit():
            values = [txn[column] for column in WORDS[key]] + [(txn["fields"] or {}).get("address")]
            if int(text) not in values:
                wrong.append(part)
    if "regs=" in meaning:
        registers = json.loads(meaning.split("regs=")[1])
        if txn["data"] != registers:
            wrong.append("regs")
    return wrong


@pytest.mark.parametrize("row", FRAMES.values(), ids=FRAMES)
def test_valid_frames_decode_to_their_meaning(row: dict[str, Any]) -> None:
    batch = decode(row["mode"], wire(row))
    frame = batch.frames[0].as_dict()
    assert frame["verdict"] == "ok"
    assert frame["unit"] == row.get("unit", frame["unit"])
    if row["direction"] != "unknown" and not echoes(row):
        assert frame["direction"] == row["direction"]
    if row.get("meaning") and row["direction"] != "unknown" and not echoes(row):
        assert says(row["meaning"], batch.transactions[0].as_dict()) == [], row["meaning"]


def echoes(row: dict[str, Any]) -> bool:
    """A response that equals its request: alone, its direction is not decidable."""
    return row["direction"] == "response" and row["function"] in (5, 6, 8, 21, 22)


@pytest.mark.parametrize("row", SERIAL.values(), ids=SERIAL)
def test_damaged_frames_are_reported_as_damaged(row: dict[str, Any]) -> None:
    data = wire(row)
    if row["mode"] == "ascii":
        data = data.rstrip(b"\r\n")
    whole = decode(row["mode"], wire(row)).frames[0]
    at = len(data) // 2
    damaged = [data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :], data[:-1]]
    if whole.byte_length < len(wire(row)):
        damaged.pop()  # a stray byte follows the frame; without it the frame is whole
    for bad in damaged:
        rows = decode(row["mode"], bad).frames
        assert rows[0].verdict in ("bad_checksum", "incomplete"), bad.hex(" ")


WRONG = [
    (row, bytes.fromhex(request))
    for row in load("rtu")
    if row.get("expect") == "wrong-answer"
    for request in [
        {
            "01 03 02 00 00 09 84 74": "01 03 00 CA 00 01 A5 F4",
            "01 10 00 33 00 01 41 42": "01 10 00 33 00 01 02 00 63 E3 9A",
            "01 10 00 34 00 02 00 06": "01 10 00 34 00 01 02 00 63 E2 2D",
            "01 10 00 36 00 01 E1 C7": "01 10 00 35 00 01 02 00 63 E3 FC",
            "01 06 00 37 00 62 B9 ED": "01 06 00 37 00 63 78 2D",
            "01 10 54 52 73 70 55 3C": "01 10 00 00 00 01 02 00 01 66 50",
            "14 03 01 21 00 01 D7 39 14 03 02 03 02 34 B6": "14 03 01 21 00 01 D7 39",
        }[row["hex"]]
    ]
]


@pytest.mark.parametrize(("row", "request_frame"), WRONG)
def test_wrong_answers_get_a_finding(row: dict[str, Any], request_frame: bytes) -> None:
    body = request_frame[:-2]
    asked = body + _modlens.crc16(body).to_bytes(2, "little")
    batch = decode("rtu", asked, wire(row))
    if wire(row).startswith(asked):
        # A local echo or a retry: without a clock nothing reports, and nothing is claimed.
        assert [txn.status for txn in batch.transactions] == ["not_observed", "ok"]
    else:
        assert [finding.code for finding in batch.findings] != []


def test_document_mistakes_are_reported() -> None:
    by_hex = {row["hex"]: row for row in load("seed_documents")}
    assert by_hex["01 86 04 40 F3"]["checksum_ok"] is False
    batch = decode("rtu", bytes.fromhex("01 86 04 40 F3"))
    codes = {finding.code: finding.detail for finding in batch.findings}
    assert codes["checksum_of_another_frame"] == "40f3 is the checksum of 018304"
    asked = bytes.fromhex("01 10 00 D0 00 02 04 03 E8 03 20 7F AB")
    batch = decode("rtu", asked, bytes.fromhex("01 83 04 40 F3"))
    assert "wrong_function" in [finding.code for finding in batch.findings]
    batch = decode(
        "rtu", bytes.fromhex("01 01 00 00 00 07 7D C8"), bytes.fromhex("01 01 01 80 50 28")
    )
    assert [finding.code for finding in batch.findings] == ["padding_bits"]
