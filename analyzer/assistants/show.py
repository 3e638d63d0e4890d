"""The tool `show`: the bytes of frames beside their meaning."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import _modlens
from analyzer.assistants.answers import Row, page, without_empty
from analyzer.assistants.fence import Fence
from analyzer.assistants.reading import Reading
from analyzer.filters import parse
from analyzer.hex_text import frame_bytes
from analyzer.settings import Settings
from dissectors.describe import Piece, describe, has_checksum, pdu_of
from dissectors.errors import UsageError

__all__ = ["answer"]

_CHOICES = ("txn", "frame", "packet", "hex")

_FRAME = "frame,time,elapsed_us,direction,unit,verdict,unconfirmed,gap_us,byte_length,mode,source"
_TRANSACTION = (
    "txn,time,elapsed_us,bus,mode,unit,status,exception_name,response_time_us,waited_us,retry_of,"
    "late_response_to,request_frame,response_frame,readings"
)


def answer(fence: Fence, arguments: Mapping[str, Any]) -> str:
    """The frames that the arguments choose, byte by byte, with their findings."""
    chosen = [name for name in _CHOICES if name in arguments]
    if len(chosen) != 1:
        raise UsageError(f"show: name one of {', '.join(_CHOICES)}")
    (what,) = chosen
    if what == "hex":
        head, rows = {}, list(_hex(arguments["hex"]))
    else:
        if "file" not in arguments:
            raise UsageError(f"show: {what} needs a file; overview lists them")
        reading = Reading(fence, arguments)
        find = _transaction if what == "txn" else _frames
        rows = list(find(reading, what, arguments[what]))
        head = reading.head
        if not rows:
            raise UsageError(f"show: there is no {what} {arguments[what]} in {reading.name}")
    offset = arguments.get("offset", 0)
    return page(head, rows[offset:], offset=offset, total=len(rows))


def _transaction(reading: Reading, _: str, number: int) -> Iterator[Row]:
    """A transaction with its frames and findings."""
    wanted = parse(f"txn == {number}", "transactions").predicate()
    about = parse(f"txn == {number}", "findings").predicate()
    findings: list[Any] = []
    for batch in reading.batches("transactions", "findings", "readings"):
        findings += batch.findings.where(about)
        for row in batch.transactions.where(wanted):
            yield "transactions", _fields(row, _TRANSACTION)
            functions = reading.settings.functions
            checksums = {
                name: has_checksum(data, row.mode, is_sound=row.status != f"bad_{name}")
                for name, data in (("request", row.request_hex), ("response", row.response_hex))
            }
            request = pdu_of(row.request_hex, row.mode, has_checksum=checksums["request"])
            for name, data in (("request", row.request_hex), ("response", row.response_hex)):
                if data:
                    pieces = describe(
                        data,
                        mode=row.mode,
                        direction="request" if name == "request" else "response",
                        request=request if name == "response" else None,
                        has_checksum=checksums[name],
                        functions=functions,
                    )
                    yield from _pieces(f"{name}_bytes", pieces)
            yield from (("findings", _finding(one)) for one in findings)
            return


def _frames(reading: Reading, what: str, number: int) -> Iterator[Row]:
    """A frame, or the frames that begin in a packet, with their findings."""
    condition = f"frame == {number}"
    if what == "packet":
        condition = f"source == {f'{reading.path}#{number}'!r}"
    wanted = parse(condition, "frames").predicate()
    found, findings = list[Any](), list[Any]()
    requests: dict[int, Any] = {}
    for batch in reading.batches("frames", "transactions", "findings"):
        found += list(batch.frames.where(wanted))
        numbers = {row.txn for row in found}
        if found:
            requests |= {one.txn: one for one in batch.transactions if one.txn in numbers}
            findings += [one for one in batch.findings if one.txn in numbers]
    for row in found:
        transaction = requests.get(row.txn) if row.direction == "response" else None
        yield from _frame(row, transaction, reading.settings.functions)
        yield from (("findings", _finding(one)) for one in findings if one.frame == row.frame)


def _hex(text: str) -> Iterator[Row]:
    """The frames of pasted text."""
    data, mode = frame_bytes(text)
    settings = Settings()
    core = settings.core(live=False)
    core.feed(core.add_bus("hex", source="hex", mode=mode, line=None), data)
    core.flush()
    batch = core.take()
    requests = {row.txn: row for row in batch.transactions}
    for row in batch.frames:
        transaction = requests.get(row.txn) if row.direction == "response" else None
        yield from _frame(row, transaction, settings.functions)
        yield from (("findings", _finding(one)) for one in batch.findings if one.frame == row.frame)


def _frame(row: Any, transaction: Any, functions: _modlens.Functions) -> Iterator[Row]:
    yield "frames", _fields(row, _FRAME)
    checksum = row.verdict != "no_checksum"
    request = None
    if transaction is not None:
        request = pdu_of(transaction.request_hex, row.mode, has_checksum=checksum)
    pieces = describe(
        row.hex,
        mode=row.mode,
        direction=row.direction,
        request=request,
        has_checksum=checksum,
        functions=functions,
    )
    yield from _pieces("bytes", pieces)


def _pieces(name: str, pieces: Sequence[Piece]) -> Iterator[Row]:
    for piece in pieces:
        found = {
            "at": piece.offset,
            "hex": piece.data.hex(" "),
            "field": piece.name,
            "value": piece.value,
            "meaning": piece.meaning or None,
            "wrong": None if piece.is_valid else True,
        }
        yield name, without_empty(found)


def _fields(row: Any, columns: str) -> dict[str, Any]:
    """The columns of a row that have a value; times as ISO 8601."""
    found = {key: getattr(row, key) for key in columns.split(",")}
    if found.get("time") is not None:
        found["time"] = found["time"].isoformat().replace("+00:00", "Z")
    return without_empty(found)


def _finding(row: Any) -> dict[str, Any]:
    return _fields(row, "severity,code,detail,advice")
