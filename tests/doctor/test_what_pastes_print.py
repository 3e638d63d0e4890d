"""How a program prints frames is no trouble of the line: ASCII, a byte a line, a full buffer."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer import SourceError, decode
from tests.doctor.frames import read_answer, read_request, rtu
from tests.doctor.test_pasted_logs import codes, doctor
from tests.support.logs import LogEntry, write

ASKED = rtu(26, read_request(3, 70, 5))
WHOLE = rtu(26, read_answer(3, [3, 0x1234, 700, 8, 0x55AA]))


def ascii_frame(unit: int, pdu: bytes, added: int = 0) -> str:
    """The LRC is the two's complement of the sum (serial line, 6.2.1)."""
    body = bytes([unit]) + pdu
    return f":{body.hex()}{(-sum(body) + added) & 0xFF:02x}".upper()


REQUEST = ascii_frame(26, read_request(3, 70, 2))


@pytest.mark.parametrize("end", ["", "<CR><LF>", "[CR][LF]"])
def test_a_wrong_lrc_is_named(end: str, tmp_path: Path) -> None:
    answer = ascii_frame(26, read_answer(3, [3, 9]), 4)
    found = doctor([f"TX> {REQUEST}{end}", f"RX> {answer}{end}"] * 2, tmp_path)
    assert "The checksum (LRC) of the answer of unit 26 is wrong" in found["sentence"]
    assert "No answer" not in found["sentence"]


def test_an_answer_that_stops_in_ascii_is_no_missing_one(tmp_path: Path) -> None:
    answer = ascii_frame(26, read_answer(3, [3, 9]))[:-5]
    found = doctor([f"TX> {REQUEST}<CR><LF>", f"RX> {answer}<CR><LF>"], tmp_path)
    assert "stops before its end" in found["sentence"]


def test_the_line_end_of_a_frame_that_is_printed_by_bytes_is_part_of_it(tmp_path: Path) -> None:
    answer = f"{ascii_frame(26, read_answer(3, [3, 9]))}\r\n"
    found = doctor(["what the port gives", *(f"0x{ord(c):02X}" for c in answer)], tmp_path)
    assert codes(found) == []
    assert "no frame" not in found["sentence"]


def test_a_buffer_that_fills_is_one_answer(tmp_path: Path) -> None:
    shown = [f"buffer: {WHOLE[:count].hex(' ')}" for count in (3, 4, 9, len(WHOLE))]
    log = tmp_path / "pasted.log"
    log.write_text("\n".join([f"TX: {ASKED.hex(' ')}", *shown, ""]), "utf-8")
    assert [frame.hex for frame in decode(log).frames] == [ASKED, WHOLE]


def test_a_buffer_that_fills_with_damage_is_judged_when_full(tmp_path: Path) -> None:
    damaged = WHOLE[:6] + b"\x77" + WHOLE[7:]
    shown = [f"buffer: {damaged[:count].hex(' ')}" for count in (5, 9, len(damaged))]
    sentence = doctor([f"TX: {ASKED.hex(' ')}", *shown], tmp_path)["sentence"]
    assert "in line 4 the bytes" in sentence
    assert "its checksum is wrong" in sentence


def test_a_cut_answer_before_a_whole_one_is_no_buffer_that_fills(tmp_path: Path) -> None:
    """The near miss: the request is sent again between the two."""
    lines = [f"TX: {ASKED.hex(' ')}", f"RX: {WHOLE[:6].hex(' ')}"]
    found = doctor([*lines, lines[0], f"RX: {WHOLE.hex(' ')}"], tmp_path)
    assert codes(found) == ["gaps_in_frames"]


def test_hex_that_is_not_read_is_not_called_right(tmp_path: Path) -> None:
    """An answer in ASCII whose colon is missing."""
    answer = ascii_frame(26, read_answer(3, [3, 9]))[1:]
    sentence = doctor([f"TX> {REQUEST}", f"RX> {answer}"], tmp_path)["sentence"]
    assert "Nothing is wrong in the frame that was read" in sentence
    assert "But line 2 holds hex that could not be read" in sentence


def test_an_answer_may_be_among_what_is_not_read(tmp_path: Path) -> None:
    answer = ascii_frame(26, read_answer(3, [3, 9]))[1:]
    sentence = doctor([f"TX> {REQUEST}", f"RX> {answer}"] * 2, tmp_path)["sentence"]
    assert "No answer of unit 26" in sentence
    assert "But 2 lines hold hex" in sentence


@pytest.mark.parametrize("form", ["{}", "Received: {}", "c = '{}'"])
def test_characters_of_a_line_each_are_a_frame(form: str, tmp_path: Path) -> None:
    answer = ascii_frame(26, read_answer(3, [3, 9]))
    log = tmp_path / "pasted.log"
    log.write_text("\n".join(["port opened", *map(form.format, answer), ""]), "utf-8")
    assert [frame.hex for frame in decode(log).frames] == [f"{answer}\r\n".encode()]


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        # 04 00 10 00 01 02 03 04 has the sum E2 to 0, and the last record is that of the format.
        ([":0400100001020304E2", ":00000001FF"], "looks like Intel HEX"),
        (["can0  123   [3]  01 03 00", "can0  123   [4]  01 83 02 C0"], "frames of a CAN bus"),
    ],
)
def test_hex_of_other_programs_is_named(lines: list[str], says: str, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=says):
        doctor(lines, tmp_path)


def test_packets_that_wireshark_prints_are_no_noise(tmp_path: Path) -> None:
    """The request of a client that sends RTU to the port of Modbus/TCP."""
    lines = write("wireshark", [LogEntry(0, True, ASKED)] * 2).splitlines()
    found = doctor(lines, tmp_path)
    assert codes(found) == ["dead_unit_cost"]
    assert "No answer of unit 26" in found["sentence"]


@pytest.mark.parametrize("form", ["[{number}] {hex}", "({number}) {hex}"])
def test_the_number_of_a_line_in_brackets_is_no_byte(form: str, tmp_path: Path) -> None:
    """The last answer is damaged, so that no checksum shows where it begins."""
    damaged = WHOLE[:6] + b"\x77" + WHOLE[7:]
    shown = [frame.hex(" ") for frame in (ASKED, WHOLE, ASKED, damaged)]
    found = doctor([form.format(number=at, hex=text) for at, text in enumerate(shown)], tmp_path)
    assert codes(found) == ["line_noise"]
    assert "begins right and its checksum is wrong" in found["sentence"]


def test_a_unit_in_brackets_is_a_byte(tmp_path: Path) -> None:
    """The near miss: with it the bytes are a frame."""
    lines = [f"[{frame[:1].hex()}] {frame[1:].hex(' ')}" for frame in (ASKED, WHOLE)]
    assert "1 request was answered: unit 26" in doctor(lines, tmp_path)["sentence"]


def test_the_log_of_a_unit_misses_no_answers_of_others(tmp_path: Path) -> None:
    """It receives requests to others, and does not print what those answer."""
    other = rtu(5, read_request(3, 0, 1)).hex(" ")
    own = [f"recv: {ASKED.hex(' ')}", f"send: {WHOLE.hex(' ')}"]
    sentence = doctor([f"recv: {other}", *own, f"recv: {other}", *own], tmp_path)["sentence"]
    assert "No answer of unit 5" not in sentence


def test_a_frame_of_ascii_by_bytes_with_a_wrong_lrc_is_no_other_protocol(tmp_path: Path) -> None:
    answer = ascii_frame(26, read_answer(3, [3, 9]), 1)
    asked = f"{REQUEST}\r\n".encode().hex(" ")
    lines = [f"0x{ord(c):02X}" for c in f"{answer}\r\n"]
    sentence = doctor([f"TX: {asked}", *lines], tmp_path)["sentence"]
    assert f"checksum (LRC) is wrong: {answer[-2:]} is there" in sentence
    assert "another protocol" not in sentence
