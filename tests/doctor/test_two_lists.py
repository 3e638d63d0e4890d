"""Two lists one after the other, of what was sent and of what came, are no conversation."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.doctor.frames import read_request, rtu
from tests.doctor.test_pasted_logs import codes, doctor

REQUESTS = [rtu(5, read_request(4, address, 2)) for address in (0, 10, 20)]
ANSWERS = [rtu(5, bytes([4, 4, 0, value, 1, value])) for value in (17, 34, 51)]


def listed(frames: list[bytes], times: list[str] | None = None) -> list[str]:
    lines = [frame.hex(" ") for frame in frames]
    return (
        lines if times is None else [f"{at} {line}" for at, line in zip(times, lines, strict=True)]
    )


def test_requests_and_then_answers_are_no_silence(tmp_path: Path) -> None:
    found = doctor(["I sent:", *listed(REQUESTS), "I got:", *listed(ANSWERS)], tmp_path)
    assert (found["verdict"], codes(found)) == ("unknown", [])
    said = "3 requests come before 3 answers, as in two lists"
    assert said in found["sentence"]
    assert "in their order, each answer fits its request" in found["sentence"]


def test_answers_and_then_requests_are_no_strange_answers(tmp_path: Path) -> None:
    found = doctor([*listed(ANSWERS), "Requests were:", *listed(REQUESTS[:2])], tmp_path)
    assert "3 answers come before 2 requests" in found["sentence"]
    assert "fits" not in found["sentence"]


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (b"\x84\x02", "Unit 5 does not have the address"),
        # Two registers were asked for (application protocol, 6.4).
        (bytes([4, 2, 0, 7]), "its length is not that of what was asked for"),
    ],
)
def test_what_a_frame_of_a_list_shows_by_itself_is_said(
    answer: bytes, says: str, tmp_path: Path
) -> None:
    found = doctor([*listed(REQUESTS), "and back:", *listed([rtu(5, answer)] * 3)], tmp_path)
    assert says in found["sentence"], found["sentence"]


def times(start: int, count: int) -> list[str]:
    return [f"14:03:{start + number:02}.100" for number in range(count)]


def test_times_that_begin_again_are_another_log(tmp_path: Path) -> None:
    exchange = [REQUESTS[0], ANSWERS[0]]
    lines = [
        *listed(REQUESTS, times(40, 3)),
        "What the other side logged:",
        *listed(exchange * 2, times(11, 4)),
    ]
    found = doctor(lines, tmp_path)
    assert (found["verdict"], codes(found)) == ("unknown", [])
    assert "these are two logs one after the other" in found["sentence"]


def test_requests_that_were_not_answered_are_not_two_lists(tmp_path: Path) -> None:
    """The near misses: one answer only; and times, which show what came when."""
    found = doctor([*listed(REQUESTS), *listed(ANSWERS[:1])], tmp_path)
    assert "lists" not in found["sentence"]
    at = ["14:03:01.100", "14:03:01.110", "14:03:01.140", "14:03:01.160"]
    other = [rtu(9, read_request(4, 0, 2)), ANSWERS[0], rtu(9, bytes([4, 4, 0, 1, 0, 2]))]
    found = doctor(listed([REQUESTS[0], *other], at), tmp_path)
    assert codes(found) == ["two_masters"], found["sentence"]
