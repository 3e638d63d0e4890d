"""Every format of the registry can be read, from its own sample on, and every capture is one."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import pytest

import _modlens
from analyzer import decode
from analyzer.line import parse_line
from analyzer.sources import all_formats
from analyzer.sources.detect import detect_format
from tests.conftest import CAPTURES, ROOT, Modlens
from tests.support import captures, sigrok

REQUEST, RESPONSE = "050300100002c44a", "05030400fa012c9f8f"

LINE = parse_line("19200-8E1")
ROWS = {row["name"]: row for row in json.loads(_modlens.Dialects().rows())}
CHATTER = "2026-11-21 12:30:%02d INFO worker %d of pool: cache holds %d of 4096 entries\n"
EXCHANGE = [bytes.fromhex(REQUEST), bytes.fromhex(RESPONSE)]


def samples() -> bytes:
    """The exchange on one channel of a logic analyzer."""
    spaced = [sigrok.spaced(data, 0.01 + 0.04 * i, LINE) for i, data in enumerate(EXCHANGE)]
    return sigrok.session(sigrok.samples(LINE, [[byte for one in spaced for byte in one]]), ["BUS"])


LEVELS = "Time [s],BUS\n" + "".join(
    f"{time:.9f},{level}\n"
    for time, level in sigrok.changes(
        LINE,
        [
            one
            for i, data in enumerate(EXCHANGE)
            for one in sigrok.spaced(data, 0.01 + 0.04 * i, LINE)
        ],
    )
)

BINARY = {
    "raw": b"".join(EXCHANGE),
    "pcap": captures.pcap(147, EXCHANGE),
    "pcapng": captures.pcapng(147, EXCHANGE),
    "sigrok": samples(),
    "saleae-digital": LEVELS.encode(),
}


def text_of(name: str) -> bytes:
    """A recording of each format: its sample, or the bytes of an exchange."""
    return BINARY[name] if name in BINARY else str(ROWS[name]["sample"]).encode() + b"\n"


def test_each_format_is_tried_here() -> None:
    """All formats, binary ones and dialects, are tried in these tests."""
    assert set(all_formats()) == {*BINARY, *ROWS}


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("name", all_formats())
def test_a_format_gives_its_frames(name: str, named: bool, tmp_path: Path) -> None:
    """Those that its row names, whether it is found or named."""
    path = tmp_path / "recording"
    path.write_bytes(text_of(name))
    frames = list(decode(path, read_as=name if named else None).frames)
    wire = b"".join(frame.hex for frame in frames)
    expected = (
        [bytes.fromhex(text) for _, text in ROWS[name]["bytes"]] if name in ROWS else EXCHANGE
    )
    assert sorted(wire) == sorted(b"".join(expected))
    good = "ok" if name not in ROWS or ROWS[name]["checksum"] else "no_checksum"
    assert {frame.verdict for frame in frames} == {good}


@pytest.mark.parametrize("name", ROWS)
def test_a_dialect_is_found_among_other_lines(name: str) -> None:
    """Alone, and in the middle of 200 lines that are none."""
    before = "".join(CHATTER % (n % 60, n, 7 * n) for n in range(100)).encode()
    assert detect_format(text_of(name), "x.log").format == name
    assert detect_format(before + text_of(name) + before, "x.log").format == name


@functools.cache
def formats(modlens: Modlens) -> str:
    """What `modlens formats` prints; once for all of them."""
    return modlens("formats").out


@pytest.mark.parametrize("name", all_formats())
def test_a_format_is_explained(name: str, modlens: Modlens) -> None:
    """`modlens formats` shows it, with its sample."""
    kind = all_formats()[name]
    assert kind.title
    assert kind.sample
    assert kind.title in formats(modlens)


@pytest.mark.parametrize(
    "path", sorted(CAPTURES.glob("*/recording.*")), ids=lambda path: path.parent.name
)
def test_a_capture_is_decoded_whole(path: Path, modlens: Modlens) -> None:
    """As a user would: no error, a table, and every line understood."""
    done = modlens("decode", path.relative_to(ROOT))
    assert done.status == 0
    assert "not understood" not in done.err
    assert len(done.out.splitlines()) > 3
