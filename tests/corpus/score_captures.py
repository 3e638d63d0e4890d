"""Captures: the messages that TShark saw are those that modlens sees, packet by packet.

Compared for each packet and message: transaction identifier, unit, function, exception, addresses
and counts, and which packet asked what this one answers. TShark is one opinion, not the truth:
`EXPLAINED` names each difference, with who is right and why. A capture with an empty table must
give no frame.
"""

from __future__ import annotations

import csv
import gzip
import json
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import _modlens
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from tests.corpus.explained import EXPLAINED
from tests.corpus.score import Score

__all__ = ["score"]

Message = dict[str, str]

FIELDS = {
    "modbus.reference_num": "address",
    "modbus.write_reference_num": "write_address",
    "modbus.diagnostic_code": "sub_function",
    "modbus.and_mask": "and_mask",
    "modbus.or_mask": "or_mask",
    "modbus.mei": "mei_type",
}
"""TShark's field -> the core's; quantities and byte counts have several names and are below."""

QUANTITY = {
    "modbus.word_cnt": {3, 4, 16},
    "modbus.bit_cnt": {1, 2, 15},
}
READ_WRITE = 23
"""TShark calls the fields of its reading half otherwise."""

FIFO = 24
"""TShark shows the count of the queue as a word count."""

FILES = {20, 21}
"""Functions of file records: TShark shows their groups' references in the same fields."""

MBAP = 7


def score(folder: Path) -> Iterator[Score]:
    """A score for each capture of the folder."""
    for path in sorted([*folder.glob("*.pcap"), *folder.glob("*.pcapng")]):
        yield _score(path)


def _score(path: Path) -> Score:
    on_status: list[RecordingStatus] = []
    run = FileRun([str(path)], Settings(), on_status=on_status.append)
    batches = list(run.batches())
    ours = _ours(batches)
    theirs, asked = _theirs(path.with_name(f"{path.stem}.expected.tsv.gz"))
    known = EXPLAINED.get(path.name, {})
    wrong, explained = [], Counter[str]()
    for packet in sorted({*ours, *theirs}):
        for text in _differences(ours.get(packet, []), theirs.get(packet, [])):
            reason = known.get(packet) or known.get(0)
            if reason is None:
                wrong.append(f"packet {packet}: {text}")
            else:
                explained[reason] += 1
    wrong += [f"packet {at}: {text}" for at, text in _pairs(batches, asked, known)]
    notes = [f"{on_status[-1].format}, {sum(map(len, ours.values()))} messages"]
    notes += [f"{count} x {reason}" for reason, count in explained.items()]
    wanted = sum(map(len, theirs.values()))
    return Score(
        path.name, wanted, wanted - min(wanted, len(wrong)), "; ".join(notes), tuple(wrong)
    )


def _packet(source: str) -> int:
    return int(source.rpartition("#")[2])


def _ours(batches: list[_modlens.Batch]) -> dict[int, list[Message]]:
    functions = _modlens.Functions()
    found: dict[int, list[Message]] = defaultdict(list)
    for batch in batches:
        for frame in batch.frames:
            if frame.verdict == "ok":
                found[_packet(frame.source)].append(_message(functions, frame))
    return found


def _message(functions: _modlens.Functions, frame: Any) -> Message:
    body = frame.hex[MBAP:] if frame.mode == "tcp" else frame.hex[1:-2]
    on_status = json.loads(functions.decode(body, frame.direction.replace("unknown", "request")))
    fields = {field["name"]: field["value"] for field in on_status["fields"]}
    message = {"unit": str(frame.unit), "modbus.func_code": str(frame.function)}
    if frame.mode == "tcp":
        message["mbtcp.trans_id"] = str(frame.mbap_id)
    if frame.exception is not None:
        message["modbus.exception_code"] = str(frame.exception)
        return message
    for theirs, name in FIELDS.items():
        if name in fields and frame.function not in FILES:
            read = frame.function == READ_WRITE and name == "address"
            message["modbus.read_reference_num" if read else theirs] = str(fields[name])
    for theirs, codes in QUANTITY.items():
        if frame.function in codes and "quantity" in fields:
            message[theirs] = str(fields["quantity"])
    if frame.function == FIFO and "fifo_count" in fields:
        message["modbus.word_cnt"] = str(fields["fifo_count"])
    return message


def _theirs(path: Path) -> tuple[dict[int, list[Message]], dict[int, int]]:
    found: dict[int, list[Message]] = {}
    asked: dict[int, int] = {}
    with gzip.open(path, "rt", encoding="utf-8", newline="") as lines:
        for row in csv.DictReader(lines, delimiter="\t"):
            number = int(row["frame.number"])
            found[number] = _messages(row)
            request = row.get("modbus.request_frame") or ""
            if request and "," not in request:
                asked[number] = int(request)
    return found, asked


def _messages(row: dict[str, str]) -> list[Message]:
    """The messages of a packet; where there are several, the fields that each of them has."""
    units = (row.get("mbtcp.unit_id") or row.get("mbrtu.unit_id") or "").split(",")
    every = ("mbtcp.trans_id", "modbus.func_code")
    names = (*FIELDS, "modbus.read_reference_num", *QUANTITY)
    some = () if len(units) > 1 else ("modbus.exception_code", *names)
    messages = []
    for at, unit in enumerate(units):
        message = {"unit": unit}
        for name in (*every, *some):
            cells = (row.get(name) or "").split(",")
            if name in some and row.get(name):
                message[name] = str(int(row[name].split(",")[0], 0))
            elif name in every and at < len(cells) and cells[at]:
                message[name] = cells[at]
        messages.append(message)
    return messages


def _differences(ours: list[Message], theirs: list[Message]) -> Iterator[str]:
    if len(ours) != len(theirs):
        yield f"{len(ours)} messages, TShark has {len(theirs)}"
        return
    for mine, other in zip(ours, theirs, strict=True):
        names = set(other) if len(theirs) > 1 else {*mine, *other}
        for name in sorted(names):
            if mine.get(name) != other.get(name):
                yield f"{name} is {mine.get(name)}, TShark has {other.get(name)}"


def _pairs(
    batches: list[_modlens.Batch], asked: dict[int, int], known: dict[int, str]
) -> Iterator[tuple[int, str]]:
    packets = {frame.frame: _packet(frame.source) for batch in batches for frame in batch.frames}
    pairs: dict[int, set[int | None]] = defaultdict(set)
    for batch in batches:
        for row in batch.transactions:
            if row.response_frame is not None:
                pairs[packets[row.response_frame]].add(packets.get(row.request_frame))
    for response, request in asked.items():
        if request not in pairs.get(response, set()) and not (known.get(response) or known.get(0)):
            yield response, f"answers packet {request}, says TShark; here {pairs.get(response)}"
