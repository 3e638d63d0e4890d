"""Bytes beside frames, or twice in them, are named; numbers that a program prints are no bytes."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer import SourceError, decode
from tests.doctor.test_almost_frames import SEEDS, exchange
from tests.doctor.test_what_bytes_prove import pair, said


def twice(frame: bytes) -> bytes:
    return bytes(byte for byte in frame for _ in range(2))


@pytest.mark.parametrize("extra", [0x3C, 0xA7, 0xE1, 0x41])
@pytest.mark.parametrize("is_in_front", [True, False])
def test_a_byte_beside_a_frame_in_prose(extra: int, is_in_front: bool, tmp_path: Path) -> None:
    _, answer = exchange(extra)
    stray = bytes([extra])
    shown = (stray + answer if is_in_front else answer + stray).hex(" ")
    sentence = said(["what I get from it:", f"bytes: {shown}"], tmp_path)
    assert f"no frame, such as {extra:02X}, stand before or after" in sentence


@pytest.mark.parametrize("front", ["line 17:", "frame 17", "no. [17]", "bytes: {}"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_number_in_front_of_a_frame_is_no_byte(front: str, seed: int, tmp_path: Path) -> None:
    """The number of a line, or in the last place that of the bytes after it."""
    _, answer = exchange(seed)
    line = f"{front.format(f'{len(answer):02X}')} {answer.hex(' ')}"
    assert said([line], tmp_path).startswith("Nothing is wrong in this frame")


@pytest.mark.parametrize("seed", SEEDS)
def test_an_answer_with_each_byte_twice(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    sentence = said(pair(asked, twice(answer)), tmp_path)
    assert "each byte of the answer" in sentence.lower()
    assert "is there twice, and one of each two makes a whole answer" in sentence


@pytest.mark.parametrize("seed", SEEDS)
def test_all_frames_with_each_byte_twice(seed: int, tmp_path: Path) -> None:
    asked, answer = exchange(seed)
    log = tmp_path / "pasted.log"
    log.write_text("\n".join(pair(twice(asked), twice(answer))), "utf-8")
    with pytest.raises(SourceError, match="in line 1 each byte is there twice"):
        decode(log).doctor()


@pytest.mark.parametrize("extra", ["9d 21 e0", "c4 17 b2 90 0e", "f1 8a 03 d5 66 91 20 bc"])
@pytest.mark.parametrize("is_asked", [True, False])
def test_bytes_after_a_whole_answer(extra: str, is_asked: bool, tmp_path: Path) -> None:
    asked, answer = exchange(4)
    lines = pair(asked, answer + bytes.fromhex(extra))
    sentence = said(lines if is_asked else [lines[1], "CRC error"], tmp_path)
    count = len(bytes.fromhex(extra))
    assert f"{count} bytes follow that belong to no frame, {extra[:2].upper()} first" in sentence
