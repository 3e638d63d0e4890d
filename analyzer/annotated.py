"""Looks up and draws a frame, or a request and its response: bytes beside their meaning."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import _modlens
from analyzer.filters import parse
from analyzer.session import FileRun
from analyzer.times import format_seconds
from analyzer.views.cells import milliseconds
from analyzer.views.detail import show_findings, show_frame, show_pause
from analyzer.views.screen import Screen, visible, width_of
from dissectors.describe import Mode, describe, has_checksum, pdu_of
from dissectors.errors import UsageError

__all__ = [
    "DisplayedExchange",
    "lookup_frame",
    "lookup_packet",
    "lookup_transaction",
    "show",
    "text_of",
]

Direction = Literal["request", "response"]


@dataclass(frozen=True, slots=True)
class DisplayedFrame:
    """One frame: its title, its bytes, and how they are to be read."""

    title: str
    data: bytes
    mode: Mode
    direction: Direction | Literal["unknown"]
    has_checksum: bool = True


@dataclass(frozen=True, slots=True)
class DisplayedExchange:
    """A frame, or a request and its response, with all that is shown of them.

    `pause` is the text between the two frames; `request` is the request's PDU, by which the
    response is decoded; `readings` are names and values from the unit's profile.
    """

    frames: tuple[DisplayedFrame, ...]
    pause: str
    request: bytes | None
    findings: list[dict[str, Any]]
    title: str = ""
    readings: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of_frame(
        cls, row: Any, *, request: bytes | None, findings: list[dict[str, Any]]
    ) -> DisplayedExchange:
        """From a row of the frames table; `request` is the frame that it responds to."""
        direction = _direction_text(row.direction)
        checksum = row.verdict != "no_checksum"
        one = DisplayedFrame(
            f"frame {row.frame}: {direction}, {row.mode}, {row.verdict}{_time_text(row)}",
            row.hex,
            row.mode,
            row.direction,
            checksum,
        )
        return cls((one,), "", pdu_of(request, row.mode, has_checksum=checksum), findings)

    @classmethod
    def of_transaction(
        cls, row: Any, findings: list[dict[str, Any]], readings: tuple[tuple[str, str], ...] = ()
    ) -> DisplayedExchange:
        """From a row of the transactions table; `readings` are pairs of name and value."""
        if row.exception is not None:
            findings = [_with_exception(found, row.exception) for found in findings]
        title = f"transaction {row.txn}: {row.mode}, {row.status}{_time_text(row)}"
        asked_checksum = has_checksum(
            row.request_hex, row.mode, is_sound=row.status != "bad_request"
        )
        answer_checksum = has_checksum(
            row.response_hex, row.mode, is_sound=row.status != "bad_response"
        )
        request = DisplayedFrame(
            f"request, frame {row.request_frame}",
            row.request_hex,
            row.mode,
            "request",
            asked_checksum,
        )
        answer = DisplayedFrame(
            f"response, frame {row.response_frame}",
            row.response_hex,
            row.mode,
            "response",
            answer_checksum,
        )
        frames = tuple(one for one in (request, answer) if one.data)
        return cls(
            frames,
            _pause_text(row),
            pdu_of(row.request_hex, row.mode, has_checksum=asked_checksum),
            findings,
            title,
            readings,
        )


def _with_exception(found: dict[str, Any], exception: int) -> dict[str, Any]:
    """A finding whose advice names the code of the exception that came."""
    advice = found["advice"].replace("explain exception N", f"explain exception {exception}")
    return found | {"advice": advice}


def show(
    exchange: DisplayedExchange,
    screen: Screen,
    functions: _modlens.Functions,
    direction: Direction | None,
) -> None:
    """Draw an exchange; `direction` overrides the detected one."""
    if exchange.title:
        screen.line(exchange.title, "head")
        screen.line("")
    for number, one in enumerate(exchange.frames):
        if number:
            show_pause(exchange.pause, screen)
            screen.line("")
        pieces = describe(
            one.data,
            mode=one.mode,
            direction=direction or one.direction,
            request=exchange.request,
            has_checksum=one.has_checksum,
            functions=functions,
        )
        show_frame(one.title, pieces, screen)
    if len(exchange.frames) == 1 and exchange.pause:
        show_pause(exchange.pause, screen)
    if exchange.readings:
        width = max(width_of(name) for name, _ in exchange.readings)
        screen.lines([[], [("readings", "head")]])
        for name, value in exchange.readings:
            screen.line(f"  {name}{' ' * (width - width_of(name))}  {value}")
    show_findings(exchange.findings, screen)


def text_of(
    run: FileRun,
    functions: _modlens.Functions,
    *,
    txn: object,
    frame: int | None,
    width: int,
) -> str:
    """A transaction or frame of a run as text; `UsageError` where there is none of this number.

    `txn` is a number, or a row of transactions or frames.
    """
    if frame is None and hasattr(txn, "direction"):
        txn, frame = None, getattr(txn, "frame", None)
    txn = getattr(txn, "txn", txn)
    number, what, look = (
        (txn, "transaction", lookup_transaction)
        if frame is None
        else (frame, "frame", lookup_frame)
    )
    if number is None or (txn is not None and frame is not None):
        raise UsageError("write show(txn=3) for a transaction, show(frame=5) for a frame")
    if not isinstance(number, int):
        raise UsageError(f"a {what} is named by its number such as 3, not {number!r}")
    found = look(run, number)
    if found is None:
        raise UsageError(f"there is no {what} {number}")
    text = io.StringIO()
    show(found, Screen(text, width=width), functions, None)
    return text.getvalue()


def lookup_frame(run: FileRun, number: int) -> DisplayedExchange | None:
    """Find a frame by its number; None if there is no such frame.

    Reads on until the transaction of the frame is known, because a response is decoded by its
    request.
    """
    wanted = parse(f"frame == {number}", "frames").predicate()
    of_frame_findings = parse(f"frame == {number}", "findings").predicate()
    row, findings = None, []
    for batch in run.batches():
        findings += [found.as_dict() for found in batch.findings.where(of_frame_findings)]
        row = row or next(iter(batch.frames.where(wanted)), None)
        if row is None:
            continue
        if row.txn is None or row.direction != "response":
            return DisplayedExchange.of_frame(row, request=None, findings=findings)
        pair = parse(f"txn == {row.txn}", "transactions").predicate()
        for transaction in batch.transactions.where(pair):
            return DisplayedExchange.of_frame(
                row, request=transaction.request_hex, findings=findings
            )
    return None if row is None else DisplayedExchange.of_frame(row, request=None, findings=findings)


def lookup_packet(run: FileRun, name: str, number: int) -> list[DisplayedExchange]:
    """Find the frames that begin in a packet of the capture called `name`; packets count from 1."""
    here = parse(f"source == {f'{name}#{number}'!r}", "frames").predicate()
    rows, requests, findings = [], {}, []
    for batch in run.batches():
        rows += list(batch.frames.where(here))
        wanted = {row.txn for row in rows}
        if not rows:
            continue
        requests.update(
            {row.txn: row.request_hex for row in batch.transactions if row.txn in wanted}
        )
        findings += [row.as_dict() for row in batch.findings if row.txn in wanted]
    return [
        DisplayedExchange.of_frame(
            row,
            request=requests.get(row.txn) if row.direction == "response" else None,
            findings=[found for found in findings if found["frame"] == row.frame],
        )
        for row in rows
    ]


def lookup_transaction(run: FileRun, number: int) -> DisplayedExchange | None:
    """Find a transaction by its number; None if there is no such transaction."""
    wanted = parse(f"txn == {number}", "transactions").predicate()
    of_frame_findings = parse(f"txn == {number}", "findings").predicate()
    findings: list[dict[str, Any]] = []
    for batch in run.batches():
        findings += [found.as_dict() for found in batch.findings.where(of_frame_findings)]
        for row in batch.transactions.where(wanted):
            values = batch.readings.where(parse(f"txn == {number}", "readings").predicate())
            return DisplayedExchange.of_transaction(row, findings, tuple(_readings(values)))
    return None


def _readings(rows: Iterable[Any]) -> Iterator[tuple[str, str]]:
    """Name, and value with its unit of measure, of each reading that a profile names."""
    for row in rows:
        if row.name is not None:
            value = row.status if row.value_text is None else row.value_text
            yield visible(row.name), visible(f"{value} {row.unit_of_measure or ''}".rstrip())


def _direction_text(direction: str) -> str:
    return "direction unknown" if direction == "unknown" else direction


def _time_text(row: Any) -> str:
    if row.time is not None:
        return f", {row.time.isoformat().replace('+00:00', 'Z')}"
    return "" if row.elapsed_us is None else f", at {format_seconds(row.elapsed_us, 6)} s"


def _pause_text(row: Any) -> str:
    if not row.request_hex:
        return ""
    if row.response_hex:
        time = milliseconds(row.response_time_us)
        return f"... {time} ms later" if time else "... answered by"
    waited = milliseconds(row.waited_us)
    if row.status == "not_observed":
        return "response not seen" + (f" (next request after {waited} ms)" if waited else "")
    return f"no response within {waited} ms" if waited else row.status.replace("_", " ")
