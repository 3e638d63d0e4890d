"""The expected frames of a recording, from what its participants say they sent.

Independent of modlens on purpose: it looks at no byte of a frame but the unit and the function.

    frames = expected_frames(outcome.truth, outcome.traced, "rtu")
    frames[0]["direction"]    # 'request'
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from tests.support.ptybus import Sent

Frame = dict[str, str | int]
Mode = Literal["rtu", "ascii"]

EXCEPTION_BIT = 0x80


class DisagreementError(Exception):
    """The participants' own accounts do not add up to what the line carried."""


def expected_frames(
    truth: Sequence[Sent], traced: Mapping[str, list[bytes]], mode: Mode
) -> list[Frame]:
    """Return the frames of a recording in wire order.

    `traced` maps a participant to the frames it says it sent; the master is called "master", and
    who is not named there sends noise. Where the line changed a frame it is `bad_checksum`, or
    `incomplete` if bytes are missing. Raises DisagreementError, also where the system handed over a
    write in parts: record again then.
    """
    accounts = {sender: list(frames) for sender, frames in traced.items()}
    frames: list[Frame] = []
    for sent in truth:
        if sent.sender not in accounts:
            frames.append(_noise(sent.data))
            continue
        said = accounts[sent.sender].pop(0) if accounts[sent.sender] else b""
        if said != sent.written:
            raise DisagreementError(
                f"{sent.sender} wrote {sent.written.hex()} and says it sent {said.hex()}"
            )
        direction = "request" if sent.sender == "master" else "response"
        frames += _frames_of(sent, direction, mode)
    if left := {sender: rest for sender, rest in accounts.items() if rest}:
        raise DisagreementError(f"said to be sent, but not on the line: {left}")
    return frames


def _frames_of(sent: Sent, direction: str, mode: Mode) -> list[Frame]:
    """Return the frame and, if the line carried more than was written, the noise around it."""
    if not sent.data:
        return []
    before, frame, after = sent.data.partition(sent.written)
    if not frame:
        verdict = "incomplete" if len(sent.data) < len(sent.written) else "bad_checksum"
        return [_frame(sent.data, direction, mode, verdict)]
    around = [[_noise(data)] if data else [] for data in (before, after)]
    return [*around[0], _frame(frame, direction, mode, "ok"), *around[1]]


def _frame(data: bytes, direction: str, mode: Mode, verdict: str) -> Frame:
    adu = bytes.fromhex(data[1:-2].decode("ascii")) if mode == "ascii" else data
    frame: Frame = {"direction": direction, "unit": adu[0], "function": adu[1] & ~EXCEPTION_BIT}
    if adu[1] & EXCEPTION_BIT:
        frame["exception"] = adu[2]
    return {**frame, "verdict": verdict, "hex": data.hex()}


def _noise(data: bytes) -> Frame:
    return {"verdict": "noise", "hex": data.hex()}
