"""`--where ... -o x.pcapng` on the command line: out of pcap, pcapng and compressed files."""

from __future__ import annotations

import gzip
import hashlib
import zipfile
from pathlib import Path

import pytest

from analyzer import decode
from tests.analyzer.exports.test_wireshark import export, recording, styled
from tests.conftest import Modlens
from tests.support.tshark import fields

WHERE = "function == 3 and response_time_us > 5000"

NAMES = ("frame.time_epoch", "mbtcp.trans_id", "modbus.func_code", "frame.len")


def source_file(kind: str, folder: Path) -> Path:
    """A capture of Modbus/TCP on Ethernet."""
    form, _, packed = kind.partition(".")
    path = export(recording("pymodbus_two_units"), folder / f"in.{form}", options=styled("tcp"))
    if packed:
        path = folder / f"in.{kind}"
        path.write_bytes(gzip.compress((folder / f"in.{form}").read_bytes()))
    return path


def wanted(path: Path, context: int) -> list[int]:
    """Packets of the frames that are asked for, and of their neighbours, as our records say."""
    found = decode(path)
    txns = {row.txn for row in found.transactions.where(WHERE)}
    frames = list(found.frames)
    near = {
        other
        for at, row in enumerate(frames)
        if row.txn in txns
        for other in range(max(at - context, 0), min(at + context + 1, len(frames)))
    }
    return [int(str(frames[at].source).rpartition("#")[2]) for at in sorted(near)]


@pytest.mark.parametrize("context", [0, 2])
@pytest.mark.parametrize("kind", ["pcap", "pcapng", "pcap.gz", "pcapng.gz"])
def test_packets_as_they_were(kind: str, context: int, tmp_path: Path, modlens: Modlens) -> None:
    """`--style original`: the packets' bytes and times, and the sum of the file that was read."""
    path, out = source_file(kind, tmp_path), tmp_path / "cut.pcapng"
    done = modlens(
        "export", str(path), "--where", WHERE, "--context", str(context), "--style", "original",
        "-o", str(out),
    )  # fmt: skip
    assert done.status == 0, done.err
    numbers = wanted(path, context)
    assert 3 < len(numbers) < 100
    every = fields(path, NAMES)
    assert fields(out, NAMES) == [every[number - 1] for number in numbers]
    assert hashlib.sha256(path.read_bytes()).hexdigest().encode() in out.read_bytes()


@pytest.mark.parametrize("context", [0, 2])
@pytest.mark.parametrize("kind", ["pcap", "pcapng", "pcapng.gz"])
def test_frames_for_wireshark(kind: str, context: int, tmp_path: Path, modlens: Modlens) -> None:
    """The default style writes the selected frames as new packets."""
    path, out = source_file(kind, tmp_path), tmp_path / "cut.pcapng"
    done = modlens(
        "export", str(path), "--where", WHERE, "--context", str(context), "-o", str(out)
    )  # fmt: skip
    assert done.status == 0, done.err
    places = [f"{path}#{number}" for number in wanted(path, context)]
    meant = [row.hex for row in decode(path).frames if row.source in places]
    assert [row.hex for row in decode(out).frames] == meant
    assert len(fields(out, NAMES)) == len(meant)


@pytest.mark.parametrize("member", ["in.pcap", "in.pcapng.gz"])
def test_packets_out_of_an_archive(member: str, tmp_path: Path, modlens: Modlens) -> None:
    """As out of the file itself; the sum is that of the member."""
    path, packed = source_file(member.partition(".")[2], tmp_path), tmp_path / "all.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(path, f"folder/{member}")
    cuts = []
    for name in (path, packed):
        out = tmp_path / f"{name.name}.pcapng"
        words = ("--where", WHERE, "--style", "original", "-o", str(out))
        done = modlens("export", str(name), *words)
        assert done.status == 0, done.err
        cuts.append(fields(out, NAMES))
        assert hashlib.sha256(path.read_bytes()).hexdigest().encode() in out.read_bytes()
    assert cuts[0] == cuts[1]
    assert len(cuts[0]) > 3


def test_standard_input_cannot_be_read_twice(tmp_path: Path, modlens: Modlens) -> None:
    """Packets are cut out when it is known which: in a second pass."""
    done = modlens("export", "-", "--style", "original", "-o", str(tmp_path / "cut.pcapng"))
    assert (done.status, "standard input cannot be read twice" in done.err) == (2, True)
    assert not list(tmp_path.iterdir())


def test_what_has_no_packets(tmp_path: Path, modlens: Modlens) -> None:
    """A text has none to cut out; nothing is left."""
    out = tmp_path / "cut.pcapng"
    path = tmp_path / "bus.hex"
    path.write_text("01 03 00 00 00 01 84 0a\n01 03 02 00 07 f9 86\n")
    done = modlens("export", str(path), "--style", "original", "-o", str(out))
    assert done.status == 3
    assert "must be a pcap or pcapng itself" in done.err
    assert not out.exists()
