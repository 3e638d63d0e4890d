"""The score of labelled attacks, on a folder like that of the dataset."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

from tests.analyzer.test_baseline import ORDINARY, STRANGER, day
from tests.corpus.score_attacks import score


def label(capture: Path) -> None:
    """Write the labels of a capture: 1 for the packets that the stranger sent."""
    data, at = capture.read_bytes(), 24
    rows: list[str] = []
    address = bytes(map(int, STRANGER.split(".")))
    while at < len(data):
        (size,) = struct.unpack_from("<I", data, at + 8)
        # Ethernet has 14 bytes, and the source address is 12 bytes into IPv4.
        source = data[at + 16 + 26 : at + 16 + 30]
        rows.append(f"{len(rows) + 1};{int(source == address)}")
        at += 16 + size
    capture.with_name(f"{capture.stem}_labeled.csv").write_text("\n".join(rows) + "\n")


def test_an_attack_is_separated_from_polling(tmp_path: Path) -> None:
    plants = {"calm": ORDINARY, "quiet": ORDINARY, "bad": replace(ORDINARY, stranger_reads=True)}
    for seed, (name, plant) in enumerate(plants.items()):
        day(tmp_path / f"{name}.pcap", plant, seed)
        label(tmp_path / f"{name}.pcap")
    found = {one.name: one for one in score(tmp_path)}
    assert [(one.attack, one.reported) for one in (found["calm"], found["quiet"])] == [(0, 0)] * 2
    assert (found["bad"].attack, found["bad"].reported, found["bad"].right) == (1, 1, 1)
    assert found["bad"].codes == ["new_client"]
