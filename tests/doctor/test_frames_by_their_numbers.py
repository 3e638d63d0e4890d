"""What a short paste shows is named with its numbers; of what it does not show, nothing is said."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.doctor.frames import rtu
from tests.doctor.test_pasted_logs import doctor, mbap


@pytest.mark.parametrize(("count", "data"), [(4, bytes(6)), (2, bytes([0xAA, 0xBB, 0xCC, 0xDD]))])
def test_a_request_with_more_data_than_it_counts(count: int, data: bytes, tmp_path: Path) -> None:
    """The byte count of function 16 is that of its data (application protocol, 6.12)."""
    pdu = bytes([16, 0, 1, 0, count // 2, count]) + data
    sentence = doctor([mbap(3, 9, pdu).hex(" ")], tmp_path)["sentence"]
    assert f"the count says {count}, and {len(data)} bytes follow it" in sentence


def test_an_answer_with_more_data_than_it_counts(tmp_path: Path) -> None:
    """One byte more than the byte count of function 3 (application protocol, 6.3)."""
    asked, answer = bytes([3, 0x11, 0x22, 0, 2]), bytes([3, 4, 0x41, 0x99, 0x12, 0x34, 0x5E])
    lines = [f"Tx: {mbap(8, 7, asked).hex(' ')}", f"Rx: {mbap(8, 7, answer).hex(' ')}"]
    assert "it says 4, and 5 follow" in doctor(lines, tmp_path)["sentence"]


@pytest.mark.parametrize("swapped", [0x0600, 0x1700])
def test_a_length_field_that_no_message_has_is_found_beside_whole_ones(
    swapped: int, tmp_path: Path
) -> None:
    """After a length field come 254 bytes at most (messaging on TCP/IP, 3.1.3)."""
    wrong = bytes([0, 9, 0, 0, *swapped.to_bytes(2, "big"), 0xFF, 3, 0, 0, 0, 10])
    asked, answer = bytes([6, 0, 1, 0, 3]), bytes([6, 0, 1, 0, 3])
    lines = [
        wrong.hex(" "),
        "",
        mbap(10, 0xFF, asked).hex(" "),
        "",
        mbap(10, 0xFF, answer).hex(" "),
    ]
    sentence = doctor(lines, tmp_path)["sentence"]
    assert f"{swapped} bytes" in sentence
    assert "what was asked was answered" not in sentence


def test_a_line_that_is_logged_twice_is_no_second_answer(tmp_path: Path) -> None:
    asked, answer = mbap(5, 2, bytes([3, 0, 16, 0, 1])), mbap(5, 2, bytes([3, 2, 0, 77]))
    lines = [
        f"2026-01-02 10:00:01.100 Tx: {asked.hex(' ')}",
        f"2026-01-02 10:00:01.150 Rx: {answer.hex(' ')}",
        f"2026-01-02 10:00:01.151 Rx: {answer.hex(' ')}",
    ]
    assert "Nothing is wrong in these frames" in doctor(lines, tmp_path)["sentence"]


def test_requests_that_are_quoted_accuse_no_unit(tmp_path: Path) -> None:
    quoted = [f"frame {rtu(3, bytes([2, 0, 0, 0, count])).hex(' ')}" for count in (1, 8, 2, 16)]
    found = doctor(quoted, tmp_path)
    assert found["diagnoses"] == []
    assert "Nothing is wrong in these frames" in found["sentence"]
    # The same one again and again is asked for want of an answer.
    again = [f"frame {rtu(3, bytes([2, 0, 0, 0, 1])).hex(' ')}"] * 4
    assert "No answer of unit 3" in doctor(again, tmp_path)["sentence"]
