"""Every format of the registry can be read, from its own sample on, and every capture is one."""

from __future__ import annotations

from pathlib import Path

import pytest

from analyzer import decode
from analyzer.line import parse_line
from analyzer.sources import FORMATS
from tests.conftest import CAPTURES, ROOT, Modlens
from tests.support import captures, sigrok

REQUEST, RESPONSE = "0103006b00037417", "010306022b00000064057a"

LINE = parse_line("19200-8E1")

TEXTS = {
    "raw": bytes.fromhex(REQUEST + RESPONSE),
    "hex": f"{REQUEST}\n{RESPONSE}\n".encode(),
    "hexdump": b"00000000  01 03 00 6b 00 03 74 17  01 03 06 02 2b 00 00 00  |...k..t.....+...|\n"
    b"00000010  64 05 7a                                          |d.z|\n00000013\n",
    "xxd": b"00000000: 0103 006b 0003 7417 0103 0602 2b00 0000  ...k..t.....+...\n"
    b"00000010: 6405 7a                                  d.z\n",
    "pcap": captures.pcap(147, [bytes.fromhex(REQUEST), bytes.fromhex(RESPONSE)]),
    "pcapng": captures.pcapng(147, [bytes.fromhex(REQUEST), bytes.fromhex(RESPONSE)]),
    "sigrok": sigrok.session(
        sigrok.samples(
            LINE,
            [
                [
                    *sigrok.spaced(bytes.fromhex(REQUEST), 0.01, LINE),
                    *sigrok.spaced(bytes.fromhex(RESPONSE), 0.05, LINE),
                ]
            ],
        ),
        ["BUS"],
    ),
    "chunks": f'{{"t": 1.0, "hex": "{REQUEST}"}}\n{{"t": 1.02, "hex": "{RESPONSE}"}}\n'.encode(),
}


def test_each_format_is_tried_here() -> None:
    """A further format brings its text to this test."""
    assert set(TEXTS) == set(FORMATS)


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("name", FORMATS)
def test_a_format_gives_the_same_transaction(name: str, named: bool, tmp_path: Path) -> None:
    """Whether it is found or named."""
    path = tmp_path / "recording"
    path.write_bytes(TEXTS[name])
    (row,) = decode(path, read_as=name if named else None)
    assert (row.unit, row.address, row.data, row.status) == (1, 107, [555, 0, 100], "ok")


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_is_explained(name: str, modlens: Modlens) -> None:
    """`modlens formats` shows it, with its sample."""
    kind = FORMATS[name]
    assert kind.title
    assert kind.sample
    assert kind.title in modlens("formats").out


@pytest.mark.parametrize(
    "path", sorted(CAPTURES.glob("*/recording.*")), ids=lambda path: path.parent.name
)
def test_a_capture_is_decoded_whole(path: Path, modlens: Modlens) -> None:
    """As a user would: no error, a table, and every line understood."""
    done = modlens("decode", path.relative_to(ROOT))
    assert done.status == 0
    assert "not understood" not in done.err
    assert len(done.out.splitlines()) > 3
