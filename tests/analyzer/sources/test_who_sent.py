"""Who sent bytes, as a text says it: in words, by arrows, on a line of its own, by other lines."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from analyzer import decode
from analyzer.session import FileRun, RecordingStatus
from analyzer.settings import Settings
from tests.support.gateway_model import crc

Rows = Callable[[str], list[tuple[str, str, str]]]

# Examples 6.3, 6.6 and 7 of the application protocol with unit 17, whose CRC is computed.


def _rtu(text: str) -> bytes:
    adu = bytes.fromhex(text)
    return adu + crc(adu)


READ, VALUES = _rtu("11 03 006b 0003"), _rtu("11 03 06 022b 0000 0064")
REFUSED = _rtu("11 83 02")
WRITE = _rtu("11 06 0001 0003")


def _hex(data: bytes) -> str:
    return data.hex(" ").upper()


@pytest.fixture(name="rows")
def _rows(tmp_path: Path) -> Rows:
    def rows(text: str) -> list[tuple[str, str, str]]:
        """Direction, verdict and bytes of all frames and of the noise between them."""
        path = tmp_path / "bus.log"
        path.write_text(text, encoding="utf-8")
        return [(row.direction, row.verdict, row.hex.hex()) for row in decode(path).frames]

    return rows


LABELS = [
    ("TX:", "RX:"),
    ("18:39:11.5 - Station5_RTU ->", "18:39:11.7 - Station5_RTU <-"),
    ("Sent 8 bytes", "Received 8 bytes"),
    ("**Request**", "**Response**"),
    ("Gesendet:", "Empfangen:"),
    ("Запрос:", "Ответ:"),
    ("\u53d1\u9001\uff1a", "\u63a5\u6536\uff1a"),
    ("Enviado", "Recibido"),
]


@pytest.mark.parametrize(("asked", "answered"), LABELS)
def test_a_label_on_a_line_of_its_own_says_who_sent_what_is_below(
    asked: str, answered: str, rows: Rows
) -> None:
    """A write and its echo are the same bytes: only the label says which is the request."""
    lines = [(answered, WRITE), (asked, READ), (answered, REFUSED), (asked, WRITE)]
    text = "".join(f"{label}\n{_hex(data)}\n" for label, data in lines)
    assert [direction for direction, *_ in rows(text)] == [
        "response",
        "request",
        "response",
        "request",
    ]


@pytest.mark.parametrize(
    ("asked", "answered"),
    [
        *LABELS,
        ("uvw:", "xyz:"),
        ("Zapytanie:", "Odpowied\u017a:"),
        (">>>", "<<<"),
        ("\u2192", "\u2190"),
    ],
)
def test_a_damaged_frame_has_the_direction_of_its_label(
    asked: str, answered: str, rows: Rows
) -> None:
    """In front of the bytes as well; a label in no language is learned from its sound frames."""
    bad = bytes([VALUES[0], VALUES[1], 0x04, *VALUES[3:]])
    lines = [
        (asked, READ),
        (answered, VALUES),
        (asked, READ),
        (answered, REFUSED),
        (asked, READ),
        (answered, bad),
    ]
    text = "".join(f"{label} {_hex(data)}\n" for label, data in lines)
    direction, verdict, _ = rows(text)[-1]
    assert (direction, verdict) == ("response", "bad_checksum")


def test_an_arrow_in_front_of_all_lines_says_nothing(rows: Rows) -> None:
    """The serial monitor of Arduino prints one after each time."""
    data = [READ, VALUES, WRITE, WRITE, READ, REFUSED]
    text = "".join(f"12:30:0{at}.250 -> {_hex(one)}\n" for at, one in enumerate(data))
    assert [direction for direction, *_ in rows(text)] == ["request", "response"] * 3


def test_lines_without_the_mark_of_the_others_are_of_the_other_side(rows: Rows) -> None:
    text = f"{_hex(WRITE)}\n> {_hex(READ)}\n{_hex(REFUSED)}\n> {_hex(WRITE)}\n"
    assert [direction for direction, *_ in rows(text)] == [
        "response",
        "request",
        "response",
        "request",
    ]


@pytest.mark.parametrize(
    "line",
    [
        "0x{:02X},",
        "{:X}",
        "{:d}",
        "[{n}] {:02X}",
        "buf[{n}] = 0x{:02x}",
        "data[{n}]\tBYTE\t16#{:02X}",
        "Byte {n}: {:d}",
    ],
)
def test_a_byte_a_line_is_a_frame_in_any_notation(line: str, rows: Rows) -> None:
    def listed(data: bytes) -> str:
        return "".join(line.format(byte, n=at) + "\n" for at, byte in enumerate(data))

    text = f"Request:\n{listed(WRITE)}\nResponse:\n{listed(VALUES)}\n"
    assert rows(text) == [("request", "ok", WRITE.hex()), ("response", "ok", VALUES.hex())]


def test_a_frame_with_a_field_a_line_is_read(rows: Rows) -> None:
    """A unit and a function of one byte each, words of two, and the checksum."""
    text = (
        "I send\nAddress: 11\nFunction: 03\nStart: 006B\nCount: 0003\nCRC: "
        + READ[-2:].hex()
        + "\n"
    )
    assert rows(text) == [("request", "ok", READ.hex())]


@pytest.mark.parametrize("number", ["[{}]", "({})", "{},", "{} -"])
def test_a_number_that_counts_the_bytes_is_no_byte(number: str, rows: Rows) -> None:
    lines = [("TX", READ), ("RX", VALUES), ("TX", READ), ("RX", VALUES[:-1])]
    text = "".join(f"{label} {number.format(len(data))} {_hex(data)}\n" for label, data in lines)
    assert [found for *_, found in rows(text)] == [data.hex() for _, data in lines]


def test_a_number_in_front_of_a_label_is_no_byte(rows: Rows) -> None:
    """A free monitor of serial ports counts its records; what it reads are answers."""
    reads, writes = "Read Request (UP)", "Write Request (DOWN)"
    lines = [(reads, WRITE), (writes, READ), (reads, REFUSED)]
    text = "".join(
        f"{at:06d}: {label}, +0.0\n\n {_hex(data)}\n\n" for at, (label, data) in enumerate(lines)
    )
    assert rows(text) == [
        ("response", "ok", WRITE.hex()),
        ("request", "ok", READ.hex()),
        ("response", "ok", REFUSED.hex()),
    ]


def test_a_time_in_a_label_is_that_of_the_bytes_below(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(f"12:30:05.250 TX:\n{_hex(READ)}\n12:30:05.290 RX:\n{_hex(VALUES)}\n")
    asked, answered = decode(path).frames
    assert answered.elapsed_us - asked.elapsed_us == 40_000


@pytest.mark.parametrize("mark", ["16#{:02X}", "&H{:02X}", "${:02X}"])
def test_hex_as_other_languages_write_it(mark: str, rows: Rows) -> None:
    text = "".join(
        f"{label}: {' '.join(mark.format(byte) for byte in data)}\n"
        for label, data in (("Tx", READ), ("Rx", VALUES))
    )
    assert rows(text) == [("request", "ok", READ.hex()), ("response", "ok", VALUES.hex())]


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("<--129-4", 2),
        ("rx buffer <Buffer 11>", 1),
        ("1136022B06405", 7),
        (r"got b'\x11\x03\x06\x02'", 4),
        ("\n".join(f"Byte {at}: {byte:02X}" for at, byte in enumerate(VALUES[:7])), 7),
    ],
)
def test_bytes_that_are_not_read_are_counted(line: str, count: int, tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(f"asked {_hex(READ)} of the meter\n\nlong ago\n\n{line}\n", encoding="utf-8")
    on_status: list[RecordingStatus] = []
    for _ in FileRun([str(path)], Settings(), on_status=on_status.append).batches():
        pass
    assert on_status[-1].details["unparsed_hex_bytes"] == count
