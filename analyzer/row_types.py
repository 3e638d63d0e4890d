"""The rows of each table as types, so that a checker refuses a column that does not exist.

Generated from columns.toml (`python -m tests.support.row_types`). A row is a `_modlens.Row`: these
classes only say which attributes it has. A column that may be empty has `| Any` in its type: it is
None then, and a checker does not ask for a test, because filters usually exclude that. Names that
end in `_us` are microseconds.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any, Protocol

__all__ = [
    "AnyRow",
    "ConnectionRow",
    "DiagnosisRow",
    "FindingRow",
    "FrameRow",
    "ReadingRow",
    "TransactionRow",
]


class AnyRow(Protocol):
    """A row of any table."""

    def as_dict(self) -> dict[str, Any]:
        """Column -> value, in the table's order."""


class TransactionRow(AnyRow, Protocol):
    """A row of the table `transactions`."""

    @property
    def txn(self) -> int:
        """Running number from 1, in request order."""

    @property
    def time(self) -> datetime | Any:
        """Start of the request (of the response where there is no request), UTC."""

    @property
    def elapsed_us(self) -> float | Any:
        """Microseconds since the first byte of the recording."""

    @property
    def bus(self) -> str:
        """Name of the bus."""

    @property
    def client(self) -> str | Any:
        """TCP only: address of the client."""

    @property
    def server(self) -> str | Any:
        """TCP only: address of the server."""

    @property
    def connection(self) -> int | Any:
        """TCP only: number of the connection."""

    @property
    def mode(self) -> str:
        """Framing: rtu, ascii or tcp."""

    @property
    def unit(self) -> int:
        """Address of the server (slave)."""

    @property
    def function(self) -> int:
        """Function code without the exception bit."""

    @property
    def function_name(self) -> str | Any:
        """Name of the function in the specification."""

    @property
    def operation(self) -> str:
        """Read, write, read_write or other."""

    @property
    def register_type(self) -> str | Any:
        """Coil, discrete_input, holding_register or input_register."""

    @property
    def address(self) -> int | Any:
        """First register or bit read, as on the wire (0-based)."""

    @property
    def quantity(self) -> int | Any:
        """Number of registers or bits read."""

    @property
    def data(self) -> list[int] | Any:
        """Registers or bits read, in wire order; bits cut to the quantity."""

    @property
    def write_address(self) -> int | Any:
        """First register or bit written, as on the wire (0-based)."""

    @property
    def write_quantity(self) -> int | Any:
        """Number of registers or bits written."""

    @property
    def write_data(self) -> list[int] | Any:
        """Registers or bits written, in wire order."""

    @property
    def fields(self) -> dict[str, Any] | Any:
        """Decoded fields of functions whose content is not one block of registers or bits."""

    @property
    def readings(self) -> dict[str, Any] | Any:
        """Named, scaled values where a profile applies."""

    @property
    def status(self) -> str:
        """Ok, exception, no_response, broadcast, bad_request, bad_response.

        unsolicited or not_observed.
        """

    @property
    def confidence(self) -> int:
        """Confidence in bits, not above that of its frames.

        10 means 1000 to 1 that status and pairing are right.
        """

    @property
    def unconfirmed(self) -> bool:
        """A frame of it is unconfirmed, or status and pairing have odds below 32 to 1."""

    @property
    def exception(self) -> int | Any:
        """Exception code."""

    @property
    def exception_name(self) -> str | Any:
        """Name of the exception code."""

    @property
    def response_time_us(self) -> float | Any:
        """End of request to start of response; empty below twice the clock's resolution."""

    @property
    def waited_us(self) -> float | Any:
        """End of an unanswered request to the master's next request."""

    @property
    def late_response_us(self) -> float | Any:
        """End of the request to the start of its late response."""

    @property
    def retry_of(self) -> int | Any:
        """The transaction that this request repeats."""

    @property
    def late_response_to(self) -> int | Any:
        """The transaction that this late response belongs to."""

    @property
    def gap_us(self) -> float | Any:
        """Silence before the request."""

    @property
    def mbap_id(self) -> int | Any:
        """Transaction identifier of the MBAP header."""

    @property
    def request_hex(self) -> bytes | Any:
        """Bytes of the request."""

    @property
    def response_hex(self) -> bytes | Any:
        """Bytes of the response."""

    @property
    def request_frame(self) -> int | Any:
        """Number of the request's frame."""

    @property
    def response_frame(self) -> int | Any:
        """Number of the response's frame."""

    @property
    def findings(self) -> list[str]:
        """Codes of the findings of both frames and of the pair."""

    @property
    def source(self) -> str:
        """Location of the first frame: file:line, file#packet or file@offset."""


class FrameRow(AnyRow, Protocol):
    """A row of the table `frames`."""

    @property
    def frame(self) -> int:
        """Running number from 1."""

    @property
    def time(self) -> datetime | Any:
        """Start of the first character, UTC; empty where date or zone are unknown."""

    @property
    def elapsed_us(self) -> float | Any:
        """Microseconds since the first byte of the recording, wherever any clock exists."""

    @property
    def bus(self) -> str:
        """Name of the bus: the file or port as given; for TCP the server endpoint."""

    @property
    def line(self) -> str | Any:
        """Line of a two-line tap: A or B."""

    @property
    def client(self) -> str | Any:
        """TCP only: address of the client."""

    @property
    def server(self) -> str | Any:
        """TCP only: address of the server."""

    @property
    def connection(self) -> int | Any:
        """TCP only: number of the connection."""

    @property
    def byte_offset(self) -> int:
        """Position of the first byte in its stream."""

    @property
    def byte_length(self) -> int:
        """Number of bytes on the wire."""

    @property
    def mode(self) -> str:
        """Framing: rtu, ascii or tcp."""

    @property
    def direction(self) -> str:
        """Request, response or unknown, decided from context."""

    @property
    def unit(self) -> int | Any:
        """Address of the server (slave); 0 is broadcast on a serial line."""

    @property
    def function(self) -> int | Any:
        """Function code without the exception bit."""

    @property
    def function_name(self) -> str | Any:
        """Name of the function in the specification."""

    @property
    def exception(self) -> int | Any:
        """Exception code of an exception response."""

    @property
    def verdict(self) -> str:
        """Ok, bad_checksum, incomplete, noise or no_checksum."""

    @property
    def unconfirmed(self) -> bool:
        """Checksum OK, but isolated in noise.

        or hardly more likely than another reading (confidence below 5).
        """

    @property
    def confidence(self) -> int:
        """Confidence in bits, at most 15: 10 means 1000 to 1 that the row is right."""

    @property
    def gap_us(self) -> float | Any:
        """Silence before the frame; empty below twice the clock's resolution."""

    @property
    def delimited_by(self) -> str:
        """The evidence that ended the frame: silence, length, checksum, delimiter, record.

        restart, limit, frame (the next one begins) or end.
        """

    @property
    def txn(self) -> int | Any:
        """The transaction it belongs to."""

    @property
    def mbap_id(self) -> int | Any:
        """Transaction identifier of the MBAP header."""

    @property
    def findings(self) -> list[str]:
        """Codes of the findings; details in the findings table."""

    @property
    def source(self) -> str:
        """Location: file:line, file#packet or file@offset."""

    @property
    def hex(self) -> bytes:
        """The bytes."""


class ReadingRow(AnyRow, Protocol):
    """A row of the table `readings`."""

    @property
    def txn(self) -> int:
        """The transaction."""

    @property
    def frame(self) -> int:
        """The frame that carried the value."""

    @property
    def time(self) -> datetime | Any:
        """Start of that frame, UTC."""

    @property
    def elapsed_us(self) -> float | Any:
        """Microseconds since the first byte of the recording."""

    @property
    def bus(self) -> str:
        """Name of the bus."""

    @property
    def client(self) -> str | Any:
        """TCP only: address of the client."""

    @property
    def unit(self) -> int:
        """Address of the server (slave)."""

    @property
    def function(self) -> int:
        """Function code without the exception bit."""

    @property
    def register_type(self) -> str | Any:
        """Coil, discrete_input, holding_register or input_register."""

    @property
    def address(self) -> int:
        """The register or bit, as on the wire (0-based)."""

    @property
    def operation(self) -> str:
        """Read or write."""

    @property
    def status(self) -> str:
        """Status of the transaction: refused and unanswered writes are listed too."""

    @property
    def raw(self) -> list[int] | Any:
        """The register or bit as it was on the wire."""

    @property
    def name(self) -> str | Any:
        """Name of the point, where a profile applies."""

    @property
    def value(self) -> float | Any:
        """The value as a number; empty where that would not be exact, or is not a number."""

    @property
    def value_text(self) -> str | Any:
        """The value, always exact."""

    @property
    def unit_of_measure(self) -> str | Any:
        """Unit of measurement, where a profile applies."""


class FindingRow(AnyRow, Protocol):
    """A row of the table `findings`."""

    @property
    def frame(self) -> int | Any:
        """The frame that the finding is about."""

    @property
    def txn(self) -> int | Any:
        """The transaction that the finding is about."""

    @property
    def time(self) -> datetime | Any:
        """When it was observed, UTC."""

    @property
    def elapsed_us(self) -> float | Any:
        """Microseconds since the first byte of the recording."""

    @property
    def bus(self) -> str:
        """Name of the bus."""

    @property
    def unit(self) -> int | Any:
        """Address of the server (slave)."""

    @property
    def code(self) -> str:
        """Code of the finding; modlens explain CODE describes it."""

    @property
    def severity(self) -> str:
        """Info, warning or error."""

    @property
    def detail(self) -> str:
        """What was seen."""

    @property
    def impact(self) -> str:
        """Why it matters."""

    @property
    def advice(self) -> str:
        """What to check."""

    @property
    def source(self) -> str:
        """Location: file:line, file#packet or file@offset."""


class ConnectionRow(AnyRow, Protocol):
    """A row of the table `connections`."""

    @property
    def connection(self) -> int:
        """Running number from 1, in the order in which connections begin."""

    @property
    def bus(self) -> str:
        """Name of the bus: the server endpoint."""

    @property
    def client(self) -> str:
        """Address of the client."""

    @property
    def client_port(self) -> int:
        """TCP port of the client."""

    @property
    def server(self) -> str:
        """Address and port of the server."""

    @property
    def opened(self) -> datetime | Any:
        """When the client asked for the connection (its first SYN), UTC.

        empty where it is older than the recording.
        """

    @property
    def closed(self) -> datetime | Any:
        """When the first FIN or RST ended it, UTC.

        empty where it is still open at the end of the recording.
        """

    @property
    def closed_by(self) -> str | Any:
        """Who sent that: client or server."""

    @property
    def refused(self) -> bool:
        """The server answered the SYN with a RST."""

    @property
    def reset(self) -> bool:
        """A RST ended it, before both sides had sent their FIN."""

    @property
    def requests(self) -> int:
        """Requests of the client."""

    @property
    def writes(self) -> int:
        """Requests that write registers or bits."""

    @property
    def answered(self) -> int:
        """Requests with an answer, exceptions included."""

    @property
    def first_status(self) -> str | Any:
        """Status of the first request."""

    @property
    def in_flight_max(self) -> int:
        """The most requests that waited for their answers at the same time, at most 64."""

    @property
    def lockstep(self) -> int:
        """Answers to a request that was given up.

        in the place of the answer to the one after it.
        """

    @property
    def client_framing(self) -> str | Any:
        """Framing in which the client writes: tcp, rtu, ascii or other.

        empty where it sent nothing.
        """

    @property
    def server_framing(self) -> str | Any:
        """Framing in which the server writes."""

    @property
    def retransmitted_segments(self) -> int:
        """TCP segments that were transmitted again, SYNs included."""

    @property
    def lost_bytes(self) -> int:
        """Bytes of both directions that are missing from the recording."""

    @property
    def idle_us(self) -> float | Any:
        """Silence before it was closed, in microseconds."""

    @property
    def findings(self) -> list[str]:
        """Codes of the findings on the connection itself."""

    @property
    def source(self) -> str:
        """Location of its first packet: file#packet."""


class DiagnosisRow(AnyRow, Protocol):
    """A row of the table `diagnoses`."""

    @property
    def code(self) -> str:
        """Kind of trouble; modlens explain CODE describes it."""

    @property
    def severity(self) -> str:
        """Info, warning or error."""

    @property
    def bus(self) -> str:
        """Name of the bus."""

    @property
    def unit(self) -> int | Any:
        """Address of the server (slave); empty where the whole line is meant."""

    @property
    def function(self) -> int | Any:
        """Function code, where the trouble is of one function."""

    @property
    def address(self) -> int | Any:
        """First register or bit, where the trouble is of one request."""

    @property
    def client(self) -> str | Any:
        """Address of the client, where the trouble is of one client."""

    @property
    def failed(self) -> int:
        """How many transactions bear it; the sentence says if it counts other things."""

    @property
    def total(self) -> int:
        """Of how many."""

    @property
    def since(self) -> datetime | Any:
        """Start of the first that bears it, UTC."""

    @property
    def until(self) -> datetime | Any:
        """Start of the last one, UTC, if the trouble is over."""

    @property
    def episodes(self) -> str | Any:
        """Its runs, as ISO 8601 intervals in UTC separated by spaces.

        lone failures far from a run are left out.
        """

    @property
    def certainty(self) -> str:
        """Suspected (a few examples), likely or diagnosed."""

    @property
    def chance(self) -> float | Any:
        """Corrected probability that the contrast is an accident."""

    @property
    def share(self) -> float | Any:
        """Share of all odd transactions and bytes of the bus that it explains, from 0 to 1."""

    @property
    def odds(self) -> float | Any:
        """Odds against the best rival cause, at most a million."""

    @property
    def sentence(self) -> str:
        """The cause in words, with how many of how many and since when."""

    @property
    def advice(self) -> str:
        """What to check."""

    @property
    def proof(self) -> str:
        """The experiment that would prove it."""

    @property
    def examples(self) -> list[int]:
        """Numbers of transactions that show it; modlens show FILE --txn N shows one."""
