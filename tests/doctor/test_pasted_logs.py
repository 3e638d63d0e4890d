"""Logs as people paste them into a question: a few lines, bytes that a client has cut."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import pytest

from analyzer import SourceError, decode
from tests.doctor.frames import read_request, rtu

REQUEST = rtu(7, read_request(3, 24, 4))
ANSWER = rtu(7, bytes([3, 8, 0, 0, 1, 44, 0, 20, 83, 240]))


def doctor(lines: list[str], folder: Path) -> dict[str, Any]:
    log = folder / "pasted.log"
    log.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    return decode(log).doctor()


def codes(found: dict[str, Any]) -> list[str]:
    return [row["code"] for row in found["diagnoses"]]


def cut_answers(stray: bytes) -> list[str]:
    """A client reads as many bytes as it expects: one in front, and the last is missing."""
    return [f"TX: {REQUEST.hex(' ')}", f"RX: {(stray + ANSWER)[: len(ANSWER)].hex(' ')}"] * 12


def test_a_stray_byte_that_pushes_the_last_one_out_is_no_wrong_rate(tmp_path: Path) -> None:
    found = doctor(cut_answers(b"\x00"), tmp_path)
    assert codes(found) == ["no_bias"], found["sentence"]


def test_bytes_without_unit_and_function_may_be_of_another_rate(tmp_path: Path) -> None:
    """The near miss: as many bytes, none of which looks like an answer."""
    rng = Random(5)
    garbled = [bytes(rng.choice(range(0x20, 0xE0)) for _ in ANSWER) for _ in range(12)]
    lines = [line for bad in garbled for line in (f"TX: {REQUEST.hex(' ')}", f"RX: {bad.hex(' ')}")]
    assert "wrong_line_settings" in codes(doctor(lines, tmp_path))


def overheard() -> list[str]:
    """A client asks unit 1, which is not there, and hears what unit 2 answers to another master."""
    rng = Random(3)
    asked, lines = rtu(1, read_request(3, 0, 10)), []
    for number in range(20):
        lines.append(f"10:{number:02}:00.100 Tx: {asked.hex(' ')}")
        if number % 2 == 0:
            other = rtu(2, bytes([3, 40, *rng.randbytes(40)]))
            lines.append(f"10:{number:02}:00.300 Rx: {other.hex(' ')}")
    return lines


def test_answers_to_another_master_are_not_those_of_a_bystander(tmp_path: Path) -> None:
    assert "bystander" not in codes(doctor(overheard(), tmp_path))


def test_answers_of_the_length_asked_for_are_those_of_a_bystander(tmp_path: Path) -> None:
    asked = rtu(2, bytes([3, 20, *range(20)])).hex(" ")
    lines = [line if "Tx" in line else f"{line[:12]} Rx: {asked}" for line in overheard()]
    assert "bystander" in codes(doctor(lines, tmp_path))


def esphome(second: int, request: bytes, answer: bytes | None) -> list[str]:
    """What ESPHome prints with `debug:` of its uart and VERBOSE: each request twice."""
    at = f"[12:30:{second:02}]"
    lines = [
        f"{at}[V][modbus:222]: Modbus write: {request.hex('.').upper()} ({len(request)})",
        f"{at}[D][uart_debug:114]: >>> {request.hex(':').upper()}",
    ]
    return (
        lines
        if answer is None
        else [*lines, f"{at}[D][uart_debug:114]: <<< {answer.hex(':').upper()}"]
    )


def test_what_two_parts_of_a_program_print_of_one_request_is_one_request(tmp_path: Path) -> None:
    """Also where it is sent again without an answer between."""
    log = tmp_path / "esphome.log"
    lines = [
        line
        for second in range(0, 24, 2)
        for line in esphome(second, REQUEST, None if second % 6 else ANSWER)
    ]
    log.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    order = [REQUEST, ANSWER, REQUEST, REQUEST] * 4
    assert [frame.hex for frame in decode(log).frames] == order


def test_damaged_answers_that_one_part_of_a_program_prints_are_read(tmp_path: Path) -> None:
    """The request is printed twice and counted once; what came as its answer is printed once."""
    log = tmp_path / "esphome.log"
    lines = [
        line
        for second in range(12)
        for line in esphome(second, REQUEST, bytes.fromhex("F5F3D39AFEF9B9A5"))
    ]
    log.write_text("".join(f"{line}\n" for line in lines), "utf-8")
    frames = list(decode(log).frames)
    assert sum(frame.hex == REQUEST for frame in frames) == 12
    assert sum(frame.byte_length for frame in frames if frame.hex != REQUEST) == 12 * 8


@pytest.mark.parametrize(
    ("answers", "says"),
    [
        ([ANSWER], "Nothing is wrong in these frames: 1 request was answered"),
        ([ANSWER[:-1] + b"\x5a"] * 2, "Suspected: The answer lacks its last byte"),
        ([rtu(7, b"\x83\x02"), ANSWER], "Suspected: Unit 7 does not have the address"),
    ],
)
def test_a_few_requests_are_no_ground_for_a_verdict_but_were_read(
    answers: list[bytes], says: str, tmp_path: Path
) -> None:
    lines = [
        line for answer in answers for line in (f"TX: {REQUEST.hex(' ')}", f"RX: {answer.hex(' ')}")
    ]
    assert str(doctor(lines, tmp_path)["sentence"]).startswith(says)


def test_a_floating_line_is_not_the_cause_of_exceptions(tmp_path: Path) -> None:
    refused = rtu(7, b"\x83\x02")
    found = doctor([f"TX: {REQUEST.hex(' ')}", f"RX: 00 {refused.hex(' ')} 00"] * 12, tmp_path)
    assert "no_bias" in codes(found)
    assert "The cause: The line floats" not in str(found["sentence"])


def first_sight(lines: list[str], folder: Path) -> tuple[str, str]:
    """The code of the only row and its certainty; the verdict says the same in words."""
    found = doctor(lines, folder)
    rows = found["diagnoses"]
    assert isinstance(rows, list)
    assert len(rows) == 1, found["sentence"]
    assert found["verdict"] == "unknown"
    assert rows[0]["sentence"] in str(found["sentence"])
    assert "{" not in rows[0]["sentence"] + rows[0]["advice"] + rows[0]["proof"]
    return rows[0]["code"], rows[0]["certainty"]


FEW = {
    # The adapter hears its own transmission, and the client reads as many bytes as it expects.
    "own_echo": [f"TX: {REQUEST.hex(' ')}", f"RX: {REQUEST[:7].hex(' ')}"],
    # One stray byte before a whole answer.
    "no_bias": [f"TX: {REQUEST.hex(' ')}", f"RX: 00 {ANSWER.hex(' ')}"],
    # The first byte is not that of the unit, and with it the checksum fits.
    "driver_enable": [f"TX: {REQUEST.hex(' ')}", f"RX: c5 {ANSWER[1:].hex(' ')}"],
    # The unit is busy.
    "device_busy": [f"TX: {REQUEST.hex(' ')}", f"RX: {rtu(7, bytes([0x83, 6])).hex(' ')}"],
    # Another protocol answers.
    "foreign_protocol": [f"TX: {REQUEST.hex(' ')}", f"RX: {b'~20004642E00200FD37'.hex(' ')}"],
}


@pytest.mark.parametrize("code", FEW)
def test_one_example_is_a_suspicion(code: str, tmp_path: Path) -> None:
    assert first_sight(FEW[code], tmp_path) == (code, "suspected")


def test_several_examples_are_likely(tmp_path: Path) -> None:
    assert first_sight(FEW["device_busy"] * 3, tmp_path) == ("device_busy", "likely")


def test_requests_without_answers_are_named_and_not_judged(tmp_path: Path) -> None:
    """The unit does not answer, or the log holds one side only."""
    found = doctor([f"TX: {REQUEST.hex(' ')}"] * 3, tmp_path)
    assert [(one["code"], one["certainty"]) for one in found["diagnoses"]] == [
        ("dead_unit_cost", "suspected")
    ]
    assert "no answer of unit 7 is in the recording" in found["sentence"].lower()
    assert "one direction only" in found["diagnoses"][0]["advice"]


def framed(body: bytes) -> bytes:
    """An answer of unit 7 to function 3 with this body; its checksum is right."""
    return rtu(7, bytes([3]) + body)


DATA = ANSWER[3:-2]
BUILT_WRONGLY = {
    "lacks the byte count": framed(DATA),
    "two bytes as its byte count": framed(bytes([0, len(DATA)]) + DATA),
    "not that of the bytes after it": framed(bytes([len(DATA) // 2]) + DATA),
    "lacks its exception code": rtu(7, b"\x83"),
    "its two bytes are swapped": ANSWER[:-2] + ANSWER[:-3:-1],
    "a frame in hex digits": ANSWER.hex().upper().encode(),
}


@pytest.mark.parametrize("says", BUILT_WRONGLY)
def test_a_frame_that_is_built_wrongly_is_no_trouble_of_the_line(says: str, tmp_path: Path) -> None:
    found = doctor(exchange(BUILT_WRONGLY[says], 1), tmp_path)
    assert codes(found) == ["wrong_layout"], found["sentence"]
    assert says in str(found["sentence"])


def test_a_request_with_a_wrong_byte_count_is_named_although_refused(tmp_path: Path) -> None:
    """Two registers are written with two bytes of data (application protocol, 6.12: four)."""
    asked = rtu(7, bytes([16, 0, 0, 0, 2, 2, 0, 0]))
    lines = [f"TX: {asked.hex(' ')}", f"RX: {rtu(7, bytes([0x90, 3])).hex(' ')}"]
    assert codes(doctor(lines, tmp_path)) == ["wrong_layout"]


def test_a_stray_byte_that_pushes_the_last_one_out_is_what_is_named_first(tmp_path: Path) -> None:
    found = doctor(cut_answers(b"\x00")[:2], tmp_path)
    assert codes(found)[0] == "no_bias", found["sentence"]


def test_a_header_that_counts_wrong_is_named(tmp_path: Path) -> None:
    """Messaging on TCP/IP, 3.1.3: the length counts the unit and the PDU, 9 bytes; 6 is said."""
    answer = bytes([0, 1, 0, 0, 0, 6, 1, 3, 6, 1, 0, 0, 0, 0, 0x34]).hex(" ")
    found = doctor([f"TX: {tcp(1, read_request(3, 0, 3))}", f"RX: {answer}"], tmp_path)
    assert codes(found) == ["wrong_layout"], found["sentence"]
    assert "length field" in found["sentence"]


@pytest.mark.parametrize(
    "quoted",
    [
        ["The Rx should be this, I think", f"RX: {ANSWER.hex(' ')}"],
        [f"RX: {ANSWER.hex(' ')} <- should have been"],
        ["True:", f"TX: {REQUEST.hex(' ')}", f"RX: {ANSWER.hex(' ')}"],
    ],
)
def test_what_only_should_have_come_did_not_come(quoted: list[str], tmp_path: Path) -> None:
    came = exchange(rtu(7, b"\x83\x02"), 1)
    found = doctor([*came, *quoted], tmp_path)
    assert codes(found) == ["register_hole"], found["sentence"]
    assert codes(doctor([*came, "But I get this:", *quoted[-1:]], tmp_path)) != []


def test_a_refusal_without_its_request_is_read(tmp_path: Path) -> None:
    found = doctor([f"RX: {rtu(7, bytes([0x84, 2])).hex(' ')}"], tmp_path)
    assert codes(found) == ["register_hole"], found["sentence"]
    assert "unit 7 does not have the address" in found["sentence"].lower()


def test_a_reader_one_byte_out_of_step_is_no_late_driver(tmp_path: Path) -> None:
    """Each read begins with the second byte of an answer and ends with the first of the next."""
    found = doctor(exchange(ANSWER[1:] + ANSWER[:1], 1), tmp_path)
    assert codes(found)[0] == "lockstep", found["sentence"]
    assert "one byte out of step" in found["sentence"]


def test_an_answer_that_is_cut_off_is_not_called_damaged(tmp_path: Path) -> None:
    found = doctor(exchange(ANSWER[:8], 1), tmp_path)
    assert codes(found) == ["gaps_in_frames"], found["sentence"]


def test_a_single_register_has_no_halves(tmp_path: Path) -> None:
    asked, refused = rtu(7, read_request(3, 200, 1)), rtu(7, b"\x83\x02")
    found = doctor([f"TX: {asked.hex(' ')}", f"RX: {refused.hex(' ')}"] * 12, tmp_path)
    assert codes(found) == ["register_hole"], found["sentence"]
    assert "address 200 does not exist in unit 7" in found["diagnoses"][0]["sentence"].lower()
    assert "halves" not in found["diagnoses"][0]["proof"]


def test_bytes_that_prove_nothing_are_named_by_what_is_odd(tmp_path: Path) -> None:
    log = tmp_path / "pasted.txt"
    log.write_text(f"I only get this:\nReadFrame: 00 {ANSWER[:-1].hex(' ')}\n", "utf-8")
    with pytest.raises(SourceError, match="a stray byte is in front of the frame"):
        decode(log).doctor()


@pytest.mark.parametrize(
    ("line", "says"),
    [
        # A microcontroller prints no leading zeros, and its library the response without its unit.
        ("83 3 60 F2", "unit 15 refuses function 3 with exception 3 (illegal data value)"),
        ("buffer: C5 30 00 01 48 F3", "the bytes c5 30 00 01 48 f3 are no frame"),
        ("[W][modbus:125]: Modbus CRC Check failed! 9021!=02", "a line reports a wrong checksum"),
    ],
)
def test_lines_that_nothing_reads_are_suspected_where_the_rest_says_nothing(
    line: str, says: str, tmp_path: Path
) -> None:
    lines = ["Tx: 0F 03 07 04 00 01 C5 91", "Rx: 0F 03 02 03 CD 10 E0", "and here:", line]
    sentence = doctor(lines, tmp_path)["sentence"]
    assert sentence.startswith("Suspected: ")
    assert says in sentence


@pytest.mark.parametrize("times", [4, 30])
def test_whole_answers_of_another_length_are_not_of_two_devices(times: int, tmp_path: Path) -> None:
    """A device that answers a request for one register with two, each time."""
    asked, answer = rtu(1, read_request(4, 22, 1)), rtu(1, bytes([4, 4, 0, 78, 62, 37]))
    found = doctor([f"TX: {asked.hex(' ')}", f"RX: {answer.hex(' ')}"] * times, tmp_path)
    assert codes(found) == ["wrong_layout"]
    assert "its length is not that of what was asked for" in found["sentence"]


def test_an_address_of_memory_is_no_damaged_frame(tmp_path: Path) -> None:
    lines = [
        "Tx: 0F 03 07 04 00 01 C5 91",
        "Rx: 0F 03 02 03 CD 10 E0",
        "[V] Response: @3FFD7468/13:",
    ]
    assert doctor(lines, tmp_path)["sentence"].startswith("Nothing is wrong")


def test_a_request_at_the_end_has_no_outcome(tmp_path: Path) -> None:
    assert codes(doctor([f"TX: {REQUEST.hex(' ')}"], tmp_path)) == []


def tcp(number: int, pdu: bytes) -> str:
    return (number.to_bytes(2) + bytes([0, 0, 0, len(pdu) + 1, 1]) + pdu).hex(" ")


def polled(in_step: int, behind: int) -> list[str]:
    """A client whose answers, from one moment on, come after the next request."""
    lines: list[str] = []
    for number in range(in_step + behind):
        lines.append(
            f"10:{number // 60:02}:{number % 60:02} send: {tcp(number, read_request(3, 0, 1))}"
        )
        answered = number if number < in_step else number - 1
        if number != in_step:
            lines.append(f"{lines[-1][:8]} recv: {tcp(answered, bytes([3, 2, 0, answered]))}")
    return lines


def test_a_log_that_falls_one_step_behind_is_in_lockstep(tmp_path: Path) -> None:
    assert codes(doctor(polled(10, 30), tmp_path)) == ["lockstep"]


def test_a_client_that_asks_ahead_from_the_beginning_is_not(tmp_path: Path) -> None:
    assert "lockstep" not in codes(doctor(polled(0, 40), tmp_path))


def test_a_single_refusal_beside_its_answered_neighbour_is_off_by_one(tmp_path: Path) -> None:
    refused = rtu(7, bytes([0x83, 2]))
    shifted = rtu(7, read_request(3, 25, 4))
    lines = [f"TX: {REQUEST.hex(' ')}", f"RX: {refused.hex(' ')}"]
    lines += [f"TX: {shifted.hex(' ')}", f"RX: {ANSWER.hex(' ')}"]
    assert first_sight(lines, tmp_path) == ("address_off_by_one", "suspected")


def inverted(frame: bytes) -> bytes:
    """What a receiver with swapped wires makes of a frame: mostly ones, ended by a 00."""
    return bytes(255 - byte for byte in frame) + b"\x00"


def test_a_log_of_mostly_ones_is_swapped_wires(tmp_path: Path) -> None:
    answers = [rtu(7, bytes([3, 8, 0, number, 1, 44, 0, 20, 83, 240])) for number in range(30)]
    lines = [
        line
        for answer in answers
        for line in (f"TX: {REQUEST.hex(' ')}", f"RX: {inverted(answer).hex(' ')}")
    ]
    assert codes(doctor(lines, tmp_path))[:1] == ["swapped_wires"]


def exchange(answer: bytes, times: int) -> list[str]:
    return [f"TX: {REQUEST.hex(' ')}", f"RX: {answer.hex(' ')}"] * times


def test_an_answer_in_another_framing_is_named(tmp_path: Path) -> None:
    """Not `gateway_mixup`, although there is no identifier to compare with."""
    by_network = bytes([0, 1, 0, 0, 0, 11, *ANSWER[:-2]]).hex(" ")
    for answer in (by_network, b":0703080000012C001453F06A\r\n".hex(" ")):
        lines = [f"TX: {REQUEST.hex(' ')}", f"RX: {answer}"]
        found = doctor(lines, tmp_path)
        assert codes(found) == ["framing_mismatch"], found["sentence"]


def test_bytes_that_are_no_answer_suggest_other_settings(tmp_path: Path) -> None:
    found = doctor(exchange(bytes([0x9A, 0x3C, 0xE1, 0x55, 0x47, 0xB2]), 2), tmp_path)
    assert codes(found) == ["wrong_line_settings"]
    assert found["diagnoses"][0]["certainty"] == "suspected"


def test_the_same_bytes_where_other_answers_are_valid_do_not(tmp_path: Path) -> None:
    lines = exchange(ANSWER, 2) + exchange(bytes([0x9A, 0x3C, 0xE1, 0x55, 0x47, 0xB2]), 1)
    assert "wrong_line_settings" not in codes(doctor(lines, tmp_path))


def test_exception_4_is_a_failure_of_the_device_or_behind_a_gateway(tmp_path: Path) -> None:
    for times in (1, 3):
        assert codes(doctor(exchange(rtu(7, b"\x83\x04"), times), tmp_path)) == ["device_busy"]


def test_an_exception_by_the_gateway_itself_makes_it_no_bystander(tmp_path: Path) -> None:
    """A gateway refuses as unit 255 what was asked of unit 1."""
    lines = []
    for number in range(1, 7):
        lines.append(f"10:00:{number:02}.100 Tx: {tcp(number, read_request(3, 0, 10))}")
        refusal = number.to_bytes(2) + bytes([0, 0, 0, 3, 0xFF, 0x83, 6])
        lines.append(f"10:00:{number:02}.150 Rx: {refusal.hex(' ')}")
    assert codes(doctor(lines, tmp_path)) == ["device_busy"]


def test_a_stray_byte_before_an_answer_without_checksum_is_no_other_unit(tmp_path: Path) -> None:
    answer = b"\x00" + ANSWER
    found = doctor(exchange(answer, 1), tmp_path)
    assert codes(found) == ["no_bias"], found["sentence"]


def test_a_refused_value_says_nothing_about_addresses(tmp_path: Path) -> None:
    assert codes(doctor(exchange(rtu(7, b"\x83\x03"), 2), tmp_path)) == ["block_too_long"]


def numbered(answered_as: int) -> list[str]:
    """A log of Modbus/TCP in which the identifier of each answer is so much higher."""
    lines = []
    for number in range(1, 21):
        asked = mbap(number, 1, read_request(3, 100, 2))
        answer = mbap(number + answered_as, 1, bytes([3, 4, 0, number, 0, 9]))
        lines += [f"10:00:{number:02}.100 Tx: {asked.hex(' ')}"]
        lines += [f"10:00:{number:02}.110 Rx: {answer.hex(' ')}"]
    return lines


def mbap(identifier: int, unit: int, pdu: bytes) -> bytes:
    """Messaging on TCP/IP, 3.1.3."""
    head = identifier.to_bytes(2, "big") + b"\0\0" + (len(pdu) + 1).to_bytes(2, "big")
    return head + bytes([unit]) + pdu


def test_answers_with_other_identifiers_are_a_mix_up_in_a_log_too(tmp_path: Path) -> None:
    """A client that compares identifiers drops each of them, whatever the values are."""
    found = doctor(numbered(1000), tmp_path)
    assert codes(found)[0] == "gateway_mixup", found["sentence"]
    assert "transaction identifier" in found["diagnoses"][0]["sentence"]


def test_answers_with_the_identifiers_of_their_requests_are_none(tmp_path: Path) -> None:
    assert codes(doctor(numbered(0), tmp_path)) == []
