"""Expected frames come from the senders' own accounts, checked against the line."""

from __future__ import annotations

import pytest

from tests.support.expected import DisagreementError, expected_frames
from tests.support.ptybus import Sent

REQUEST = bytes.fromhex("010300000001840a")
RESPONSE = bytes.fromhex("010302002bf85b")


def sent(sender: str, written: bytes, data: bytes | None = None) -> Sent:
    """Return a write; `data` is what the line carried, if that is something else."""
    return Sent(0, 0, sender, written if data is None else data, written)


def frames_of(*truth: Sent) -> list[dict[str, str | int]]:
    """Return the frames of writes whose senders say that they wrote just that."""
    traced: dict[str, list[bytes]] = {"master": [], "unit1": []}
    for one in truth:
        if one.sender in traced:
            traced[one.sender].append(one.written)
    return expected_frames(truth, traced, "rtu")


def test_the_master_asks_and_a_unit_answers() -> None:
    """A frame's direction follows from its sender."""
    request, response = frames_of(sent("master", REQUEST), sent("unit1", RESPONSE))
    assert request == {
        "direction": "request",
        "unit": 1,
        "function": 3,
        "verdict": "ok",
        "hex": REQUEST.hex(),
    }
    assert (response["direction"], response["hex"]) == ("response", RESPONSE.hex())


def test_an_exception_has_its_function_and_its_code() -> None:
    """The exception bit is not part of the function."""
    (frame,) = frames_of(sent("unit1", bytes.fromhex("018302c0f1")))
    assert (frame["function"], frame["exception"]) == (3, 2)


def test_ascii_is_decoded_for_unit_and_function_only() -> None:
    """ASCII is decoded for unit and function only; the hex stays that of the characters."""
    wire = b":0A8302" + b"71\r\n"
    (frame,) = expected_frames([sent("unit1", wire)], {"unit1": [wire]}, "ascii")
    assert (frame["unit"], frame["function"], frame["exception"]) == (10, 3, 2)
    assert frame["hex"] == wire.hex()


@pytest.mark.parametrize(
    ("data", "verdicts"),
    [
        (b"", []),
        (RESPONSE[:-2], ["incomplete"]),
        (b"\x00" + RESPONSE[1:], ["bad_checksum"]),
        (b"\x00" + RESPONSE, ["noise", "ok"]),
        (b"\xff\xff" + RESPONSE + b"\x00", ["noise", "ok", "noise"]),
    ],
)
def test_what_the_line_did_to_a_frame_is_its_verdict(data: bytes, verdicts: list[str]) -> None:
    """Lost, cut short, damaged, or with glitches around it; the bytes always tile."""
    frames = frames_of(sent("unit1", RESPONSE, data))
    assert [frame["verdict"] for frame in frames] == verdicts
    assert "".join(str(frame["hex"]) for frame in frames) == data.hex()


def test_noise_has_neither_direction_nor_unit() -> None:
    """Noise has no sender, so it has neither direction nor unit."""
    assert frames_of(sent("noise", b"\xff")) == [{"verdict": "noise", "hex": "ff"}]


def test_accounts_that_do_not_add_up_are_refused() -> None:
    """A frame written in parts, one without trace, and one that was never written."""
    truth = [sent("unit1", RESPONSE)]
    for account in ([RESPONSE[:3], RESPONSE[3:]], [], [RESPONSE, RESPONSE]):
        with pytest.raises(DisagreementError):
            expected_frames(truth, {"unit1": account}, "rtu")
