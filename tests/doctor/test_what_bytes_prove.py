"""The first sentence claims what the bytes prove; words of a text never outrank a frame."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer import SourceError, decode
from tests.doctor.frames import crc, read_answer, read_request, rtu
from tests.doctor.test_pasted_logs import doctor, mbap

ASK = rtu(4, read_request(3, 16, 2))
ANSWER = rtu(4, read_answer(3, [7, 9]))


def said(lines: list[str], folder: Path) -> str:
    sentence = doctor(lines, folder)["sentence"]
    assert isinstance(sentence, str)
    return sentence


def pair(asked: bytes, answer: bytes) -> list[str]:
    return [f"TX: {asked.hex(' ')}", f"RX: {answer.hex(' ')}"]


def test_words_of_a_wrong_checksum_give_way_to_a_right_one(tmp_path: Path) -> None:
    lines = [f"RX: {ANSWER.hex(' ')}", "Error: CRC mismatch"]
    assert "the answers that are printed here have right ones" in said(lines, tmp_path)


def test_words_of_a_wrong_checksum_count_where_nothing_contradicts_them(tmp_path: Path) -> None:
    lines = [f"TX: {ASK.hex(' ')}", "Error: CRC mismatch"]
    assert "bits changed on the line" in said(lines, tmp_path)


def test_a_request_among_the_received_bytes_is_that_of_another_master(tmp_path: Path) -> None:
    """Unit 9 is asked by somebody else while this program asks unit 4."""
    other = rtu(9, read_request(3, 100, 1)) + rtu(9, read_answer(3, [5]))
    sentence = said(pair(ASK, other), tmp_path)
    assert "A whole request to unit 9 is among the received bytes" in sentence
    assert "another master" in sentence


def test_a_unit_receives_requests_to_others(tmp_path: Path) -> None:
    """In the log of a unit, what it sends are answers, and requests to others are usual."""
    lines = [
        f"RX: {ASK.hex(' ')}",
        f"TX: {ANSWER.hex(' ')}",
        f"RX: {rtu(9, read_request(3, 100, 1)).hex(' ')}",
        f"RX: {ASK.hex(' ')}",
        f"TX: {ANSWER.hex(' ')}",
    ]
    assert "another master" not in said(lines, tmp_path)


def test_a_received_request_alone_has_two_readings(tmp_path: Path) -> None:
    sentence = said([f"The response is: {ASK.hex(' ')}"], tmp_path)
    assert sentence.startswith("What was received is a request to unit 4, not an answer")
    assert "right in the log of a unit" in sentence
    assert "another master" in sentence


def test_another_unit_that_answers_is_named_with_both_readings(tmp_path: Path) -> None:
    sentence = said(pair(ASK, rtu(5, read_answer(3, [7, 9]))), tmp_path)
    assert "Unit 5 answers, and unit 4 was asked" in sentence
    assert "another master" in sentence


def test_requests_that_were_all_received_are_no_echo(tmp_path: Path) -> None:
    """A unit hears a master that asks a unit that is not there."""
    absent = rtu(63, read_request(4, 0, 14)).hex(" ")
    lines = [f"<<< {absent}"] * 4 + [f"<<< {ASK.hex(' ')}", f">>> {ANSWER.hex(' ')}"]
    assert "own transmission" not in said(lines, tmp_path)


def test_what_one_side_received_distorted_is_first_a_matter_of_settings(tmp_path: Path) -> None:
    lines = [f"I send {ASK.hex(' ')}", f"and receive {(ASK[:-2] + bytes([0x04, 0x0A])).hex(' ')}"]
    sentence = said(lines, tmp_path)
    assert "in 2 of its 8 bytes: what receives it has other data bits, parity" in sentence


def test_refusals_without_a_checksum_are_named(tmp_path: Path) -> None:
    bare = bytes([4, 0x83, 2])
    lines = [f"TX: {ASK.hex(' ')}", f"RX buffer: {(bare * 3).hex(' ')}", f"TX: {ASK.hex(' ')}"]
    assert "Unit 4 refuses without a checksum" in said(lines, tmp_path)


def test_a_byte_count_over_tcp_is_not_the_length_field(tmp_path: Path) -> None:
    """Four bytes of data, a count of 5, and a header that counts right."""
    answer = mbap(1, 1, bytes([3, 5, 0, 1, 0, 2]))
    sentence = said(pair(mbap(1, 1, read_request(3, 0, 2)), answer), tmp_path)
    assert "byte count" in sentence
    assert "it says 5, and 4 follow" in sentence
    assert "length field" not in sentence


def test_a_length_field_is_named_with_its_numbers(tmp_path: Path) -> None:
    """The header counts its own six bytes, too: 13 for 7."""
    whole = mbap(1, 1, bytes([3, 4, 0, 1, 0, 2]))
    answer = whole[:4] + bytes([0, 13]) + whole[6:]
    sentence = said(pair(mbap(1, 1, read_request(3, 0, 2)), answer), tmp_path)
    assert "it announces 13 bytes, and 7 follow" in sentence


def test_the_log_of_a_gateway_has_both_framings(tmp_path: Path) -> None:
    """It received 12 of 15 bytes of an answer, without its function and its count."""
    asked = rtu(2, read_request(3, 0, 5))
    torso = bytes([2, 0, 1, 0, 2, 0, 3, 0, 4, 0x11, 0x22, 0x33])
    lines = [
        f"RTU send: {asked.hex(' ')}",
        f"RTU recv: {torso.hex(' ')}",
        f"TCP response: {(bytes([0, 1, 0, 0, 0, 10]) + torso[:-2]).hex(' ')}",
    ]
    sentence = said(lines, tmp_path)
    assert "two framings" not in sentence
    assert "12 came, and 15 are due" in sentence


def test_what_follows_a_cut_answer_is_its_rest(tmp_path: Path) -> None:
    asked = rtu(4, read_request(3, 0, 20))
    whole = rtu(4, read_answer(3, [0x1100 + 37 * one for one in range(20)]))
    lines = [*pair(asked, whole), *pair(asked, whole[:19]), *pair(asked, whole[19:41])]
    assert "the answer comes in parts" in said(lines, tmp_path)


def test_the_right_checksum_of_a_lone_frame_is_named(tmp_path: Path) -> None:
    log = tmp_path / "pasted.log"
    body = ASK[:-2]
    numbers = ", ".join(f"0x{byte:02x}" for byte in body + bytes([0x83, 0x01]))
    log.write_text(f"byte[] request = {{{numbers}}};\n", "utf-8")
    right = crc(body).to_bytes(2, "little").hex(" ")
    with pytest.raises(SourceError, match=f"(?i)83 01 is there, and {right} belongs there"):
        decode(log).doctor()


def test_numbers_that_are_counted_are_joined(tmp_path: Path) -> None:
    """A program prints what each read returned, in decimal with the count in front."""
    whole = rtu(13, read_answer(3, list(range(7000, 7030))))
    asked = rtu(13, read_request(3, 0, 30))
    lines = [f"TX Buffer(8) {list(asked)}"]
    for at in range(0, len(whole), 24):
        part = whole[at : at + 24]
        lines.append(f"RX  Buffer({len(part)}) {list(part)}")
    assert said(lines, tmp_path).startswith(
        "Nothing is wrong in these frames: 1 request was answered"
    )


@pytest.mark.parametrize(
    ("code", "says"),
    [(10, "no path to unit 1 (exception 10)"), (11, "no answer of unit 1 (exception 11)")],
)
def test_the_exceptions_of_a_gateway_are_told_apart(code: int, says: str, tmp_path: Path) -> None:
    lines = pair(mbap(1, 1, read_request(3, 0, 2)), mbap(1, 1, bytes([0x83, code])))
    assert says in said(lines, tmp_path)


@pytest.mark.parametrize(("function", "number"), [(2, 10001), (4, 30012), (3, 40101)])
def test_a_number_of_a_manual_is_named_beside_its_address(
    function: int, number: int, tmp_path: Path
) -> None:
    first = {2: 10001, 4: 30001, 3: 40001}[function]
    refused = rtu(1, bytes([function | 0x80, 2]))
    sentence = said(pair(rtu(1, read_request(function, number, 1)), refused), tmp_path)
    assert f"does not have the address {number} (exception 2)" in sentence
    assert f"it is address {number - first} on the wire" in sentence


def test_zeros_in_front_of_a_request_do_not_prove_swapped_wires(tmp_path: Path) -> None:
    lines = [ASK.hex(" ")] * 3 + [f"{bytes(8).hex(' ')} {ASK.hex(' ')}"]
    assert "nobody drives the line until it begins" in said(lines, tmp_path)


def test_a_write_that_php_lists_is_sent_and_received(tmp_path: Path) -> None:
    frame = rtu(1, bytes([6, 0, 13, 0, 1])).hex()
    lines = [
        '10:12:55.880604: [debug] msg: "Data sent", data: array (',
        f"  1 => '{frame}',",
        ")",
        '10:12:55.917287: [debug] msg: "Stream 37 @ index: 0 received data: ", data: array (',
        f"  1 => '{frame}',",
        ")",
        "packet length more bytes than expected",
    ]
    assert said(lines, tmp_path).startswith("Nothing is wrong in these frames: 1 request")


def test_letters_of_latin_1_in_a_string_of_python_are_bytes(tmp_path: Path) -> None:
    """A master whose adapter hears itself reads seven of the eight bytes of its request."""
    log = tmp_path / "pasted.log"
    asked = rtu(1, read_request(3, 40001, 1))
    text = repr(asked[:-1].decode("latin-1"))
    log.write_text(f"Checksum error in rtu mode. The response is: {text}\n", "utf-8")
    with pytest.raises(SourceError, match="the adapter hears its own transmission"):
        decode(log).doctor()


def test_frames_of_an_unknown_function_are_not_called_answers(tmp_path: Path) -> None:
    lines = [f"<<< {rtu(unit, bytes([0x45, 0, 0, 0, 0x54, 0, 0])).hex(' ')}" for unit in (9, 10)]
    assert "answers" not in said(lines, tmp_path)


def test_a_header_alone_is_no_echo(tmp_path: Path) -> None:
    """The header counts one byte too many; it equals that of the request, which has six."""
    asked = mbap(1, 1, read_request(3, 16, 1))
    answer = asked[:6] + bytes([1, 3, 2, 0x39, 2])
    sentence = said(pair(asked, answer), tmp_path)
    assert "own transmission" not in sentence
    assert "it announces 6 bytes, and 5 follow" in sentence


def test_a_confirmation_of_a_write_has_no_byte_count(tmp_path: Path) -> None:
    sentence = said(pair(rtu(1, bytes([6, 0, 100, 0, 5])), rtu(1, bytes([6, 0, 5]))), tmp_path)
    assert "byte count" not in sentence


def test_a_refusal_over_tcp_without_its_code_has_a_right_length_field(tmp_path: Path) -> None:
    sentence = said(pair(mbap(1, 1, read_request(1, 1, 2)), mbap(1, 1, b"\x81")), tmp_path)
    assert "lacks its exception code" in sentence


def test_who_is_polled_has_sent_nothing(tmp_path: Path) -> None:
    """What mbpoll prints: its request in brackets, and that nothing came."""
    asked = "".join(f"[{byte:02X}]" for byte in rtu(1, read_request(3, 0, 1)))
    lines = ["-- Polling slave 1...", asked, "Waiting for a confirmation..."]
    assert "What was received" not in said(lines, tmp_path)
    assert "no answer came in time" in said(
        [*lines, "ERROR Connection timed out: select"], tmp_path
    )


def test_a_damaged_frame_that_was_received_is_no_whole_answer(tmp_path: Path) -> None:
    lines = [*pair(ASK, ANSWER), "RX: 11 03 00 E0 9E 00 1E 7E", "ERROR CRC mismatch"]
    assert "have right ones" not in said(lines, tmp_path)


def test_a_refusal_is_named_before_a_silence(tmp_path: Path) -> None:
    asked = rtu(1, read_request(3, 0, 10)).hex(" ")
    busy = rtu(1, bytes([0x83, 6])).hex(" ")
    times = ["08:44:13.640 TX: ", "08:44:18.641 TX: ", "08:44:18.656 RX: ", "08:44:23.635 TX: "]
    lines = [time + text for time, text in zip(times, [asked, asked, busy, asked], strict=True)]
    assert "it is busy (exception 6)" in said(lines, tmp_path)


def test_the_byte_count_of_a_report_of_the_unit_is_checked(tmp_path: Path) -> None:
    """Application protocol, 6.13: the count is that of the bytes after it, here six."""
    lines = pair(rtu(32, b"\x11"), rtu(32, bytes([0x11, 9, 0xFF, *b"v1.02"])))
    assert "it says 9, and 6 follow" in said(lines, tmp_path)


def test_one_refusal_without_a_checksum_holds_the_unit_and_the_function(tmp_path: Path) -> None:
    sentence = said(pair(ASK, bytes([4, 0x83, 2])), tmp_path)
    assert "Unit 4 refuses without a checksum (exception 2, " in sentence


def test_another_value_that_is_confirmed_is_named(tmp_path: Path) -> None:
    """Application protocol, 6.6: the answer is an echo of the request."""
    written, confirmed = (rtu(1, bytes([6, 0, 1, 0, value])) for value in (5, 0))
    assert "confirms another address or value" in said(pair(written, confirmed), tmp_path)


def test_a_value_that_a_coil_does_not_have_is_no_quantity(tmp_path: Path) -> None:
    """Application protocol, 6.5: FF00 or 0000."""
    written = rtu(1, bytes([5, 0, 1, 0, 1]))
    assert "quantity" not in said(pair(written, rtu(1, bytes([0x85, 3]))), tmp_path)


def test_a_checksum_after_a_frame_over_tcp_is_named(tmp_path: Path) -> None:
    asked = mbap(5, 1, read_request(3, 0, 1))
    answer = mbap(5, 1, read_answer(3, [7])) + rtu(1, read_answer(3, [7]))[-2:]
    assert "or something was added, such as the checksum of RTU" in said(
        pair(asked, answer), tmp_path
    )


def test_a_server_with_another_unit_number_is_no_second_master(tmp_path: Path) -> None:
    lines = pair(mbap(5, 1, read_request(3, 0, 1)), mbap(5, 0, read_answer(3, [7])))
    sentence = said(lines, tmp_path)
    assert "unit 0 in place of 1" in sentence
    assert "another master" not in sentence


def test_an_answer_that_fits_the_request_before_is_that(tmp_path: Path) -> None:
    later = rtu(4, read_request(3, 100, 40))
    lines = [f"TX: {ASK.hex(' ')}", "Timeout", *pair(later, ANSWER)]
    assert "The answer belongs to the request before" in said(lines, tmp_path)


def test_a_request_that_a_text_shows_without_its_checksum(tmp_path: Path) -> None:
    assert "has no checksum" in said(pair(ASK[:-2], ANSWER), tmp_path)


def test_an_exception_in_words_gives_way_to_a_whole_answer(tmp_path: Path) -> None:
    """A library reports its own error beside the answer that the device has sent."""
    sentence = said([f"Response: {ANSWER.hex(' ')}", "Error: IllegalDataValue"], tmp_path)
    assert "no answer that is printed here is one" in sentence


def test_a_request_that_comes_back_altered_and_cut_is_no_answer(tmp_path: Path) -> None:
    """The first byte is another one, and the last one is missing."""
    back = bytes([ASK[0] ^ 0xB1]) + ASK[1:-1]
    assert said(pair(ASK, back), tmp_path).startswith(
        "Suspected: What came is the request itself with some bits changed"
    )


def test_a_part_of_a_frame_that_is_printed_again_is_not_damaged(tmp_path: Path) -> None:
    lines = [
        "received <Buffer " + ANSWER.hex(" ") + ">",
        "payload <Buffer " + ANSWER[1:].hex(" ") + ">",
    ]
    assert "are no frame" not in said(lines, tmp_path)


def test_requests_to_read_from_all_units_are_valid_requests(tmp_path: Path) -> None:
    lines = [f"TX: {rtu(0, read_request(3, 16, 2)).hex(' ')}" for _ in range(12)]
    assert "No valid request" not in said(lines, tmp_path)
