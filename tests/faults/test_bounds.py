"""Files that are made to be expensive cost little: flat memory, linear time.

Each was measured before: 5 GB for 30,000 sections of pcapng, 13 s for an archive of 5,000 small
files, five times its size for a mail, 11 GB for ten lines of YAML.
"""

from __future__ import annotations

import base64
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.faults.measured import measured

# The example of section 6.3 of the specification, with the checksums that go with unit 1.
WIRE = [bytes.fromhex("0103006b00037417"), bytes.fromhex("010306022b00000064057a")]
TEXT = "".join(f"{frame.hex()}\n" for frame in WIRE).encode()
MAX_S = 10
BASE_MIB = 120
"""What any run may take: Python, the core, and the tables of a block."""

RTAC = 250
"""LINKTYPE_RTAC_SERIAL of tcpdump.org: reads of a serial line, with a header of 12 bytes."""


def block(kind: int, content: bytes) -> bytes:
    """A block of pcapng (draft-ietf-opsawg-pcapng, 3.1)."""
    content += bytes(-len(content) % 4)
    length = struct.pack("<I", len(content) + 12)
    return struct.pack("<I", kind) + length + content + length


def section() -> bytes:
    """A Section Header Block (4.1) of unknown length."""
    return block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))


def interface(name: bytes) -> bytes:
    """An Interface Description Block (4.2) with its name (option 2)."""
    option = struct.pack("<HH", 2, len(name)) + name + bytes(-len(name) % 4)
    return block(1, struct.pack("<HHI", RTAC, 0, 65535) + option + bytes(4))


def packet(number: int, of: int = 0) -> bytes:
    """An Enhanced Packet Block (4.3) with a read of the line, every millisecond."""
    at = 1_700_000_000_000_000 + 1000 * number
    data = struct.pack(">IIBBH", at // 1_000_000, at % 1_000_000, 0, 1, 0) + WIRE[number % 2]
    head = struct.pack("<IIIII", of, at >> 32, at & 0xFFFFFFFF, len(data), len(data))
    return block(6, head + data)


def test_thousands_of_sections_of_one_line_are_one_bus(tmp_path: Path) -> None:
    """`cat` of many files: each section describes the same interface again."""
    path = tmp_path / "sections.pcapng"
    one = section() + interface(b"ttyS0")
    path.write_bytes(b"".join(one + packet(2 * n) + packet(2 * n + 1) for n in range(4_000)))
    done = measured("export", path, "--to", "csv", "--columns", "bus,status")
    assert done.status == 0
    assert done.peak_mib < BASE_MIB
    assert set(done.out.split()[1:]) == {b"ttyS0,ok"}


def test_thousands_of_sections_of_different_lines(tmp_path: Path) -> None:
    """A line that no section describes again gives back what its framer took."""
    path = tmp_path / "sections.pcapng"
    path.write_bytes(
        b"".join(section() + interface(b"tty%d" % n) + packet(n) for n in range(5_000))
    )
    done = measured("export", path, "--to", "csv", "--table", "frames", "--columns", "bus,hex")
    assert (done.status, done.out.count(b"\n")) == (0, 5_001)
    assert done.peak_mib < 2 * BASE_MIB


def test_interfaces_without_end(tmp_path: Path) -> None:
    """A section with more serial interfaces than any machine has: the rest is counted."""
    path = tmp_path / "interfaces.pcapng"
    lines = b"".join(interface(b"tty%d" % number) for number in range(3_000))
    path.write_bytes(section() + lines + b"".join(packet(2 * n, n) for n in range(3_000)))
    done = measured("decode", path, "--to", "csv", "--table", "frames", "--columns", "bus,hex")
    assert (done.status, done.out.count(b"\n")) == (0, 1_001)
    assert "2,000 skipped: packets of serial interfaces beyond the 1000 that are read" in done.err
    assert done.peak_mib < 3 * BASE_MIB


def archive(path: Path, members: int) -> Path:
    """A zip of small recordings."""
    with zipfile.ZipFile(path, "w") as packed:
        for number in range(members):
            packed.writestr(f"day/{number:05}.hex", TEXT)
    return path


def test_archives_of_thousands_take_linear_time_and_little_memory(tmp_path: Path) -> None:
    """Of four times the members not more than six times as long: start-up is in both."""
    few = measured("export", archive(tmp_path / "few.zip", 800), "--to", "csv")
    many = measured("export", archive(tmp_path / "many.zip", 3_200), "--to", "csv")
    assert (few.status, many.status) == (0, 0)
    assert (few.out.count(b",ok,"), many.out.count(b",ok,")) == (800, 3_200)
    assert many.cpu_s < 6 * few.cpu_s
    assert many.peak_mib < BASE_MIB


def test_a_mail_of_the_largest_size_keeps_to_the_bound(tmp_path: Path) -> None:
    """An attachment of 14 MB with its line ends, of which the parser holds several copies."""
    path = tmp_path / "bus.eml"
    data = TEXT * 250_000
    path.write_bytes(
        b"From: a@b\nTo: c@d\nSubject: x\nMIME-Version: 1.0\nContent-Type: multipart/mixed; "
        b"boundary=BB\n\n--BB\nContent-Type: text/plain\n\nas attached\n--BB\n"
        b"Content-Type: application/octet-stream\nContent-Transfer-Encoding: base64\n"
        b"Content-Disposition: attachment; filename=bus.hex\n\n"
        + base64.encodebytes(data)
        + b"\n--BB--\n"
    )
    done = measured("export", path, "--to", "csv", "--columns", "status")
    assert (done.status, done.out.count(b"ok\r\n")) == (0, 250_000)
    assert done.peak_mib < 256


@pytest.mark.parametrize("space", [b" ", b""], ids=["with spaces", "without"])
def test_a_dump_without_line_ends(space: bytes, tmp_path: Path) -> None:
    """Cut into blocks between bytes: no frame is lost or invented where two blocks meet."""
    path = tmp_path / "bus.hex"
    one = space.join(b"%02x" % byte for byte in b"".join(WIRE)) + space
    path.write_bytes(one * 60_000)
    done = measured("export", path, "--to", "csv", "--table", "frames", "--columns", "verdict,hex")
    rows = done.out.split()[1:]
    assert done.status == 0
    assert len(rows) == 120_000
    assert set(rows) == {b"ok," + frame.hex().encode() for frame in WIRE}
    assert done.peak_mib < 2 * BASE_MIB


def test_a_long_line_of_something_else(tmp_path: Path) -> None:
    """20 MB that are no recording between lines that are: one line is not understood."""
    path = tmp_path / "bus.log"
    path.write_bytes(TEXT * 20 + b"x" * 20_000_000 + b"\n" + TEXT)
    done = measured(
        "export", path, "--to", "csv", "--table", "frames", "--columns", "source,verdict"
    )
    rows = done.out.decode().split()[1:]
    assert [row.split(",")[1] for row in rows] == ["ok"] * 42
    assert rows[-1].startswith(f"{path}:43")
    assert done.peak_mib < BASE_MIB


@pytest.mark.parametrize("filling", ["[", "<", "[~", "0 "])
def test_lines_of_brackets_and_gaps(filling: str, tmp_path: Path) -> None:
    """8 MB in lines of 400 kB, which rows of dialects could begin to read at every character."""
    read = '{"t": 1795259576.692151, "hex": "6e"}\n' * 50
    long = '{"t": 1795259576.692151, "n": ' + (filling * 400_000)[:400_000] + "}\n"
    path = tmp_path / "recording.jsonl"
    path.write_text((read + long) * 20, encoding="ascii")
    run = measured("export", path, "-o", tmp_path / "frames.jsonl")
    assert run.status in {0, 3}, run.err
    assert run.cpu_s < MAX_S
    assert run.peak_mib < BASE_MIB


def multiplied() -> str:
    """Ten lines of YAML that stand for ten billion values."""
    lines = [f"x{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 11)]
    return "\n".join(["a: &a0 [1]", *lines])


def doubled() -> str:
    """The same with tables: each is there twice in the next."""
    lines = [f"a{n}: &a{n} {{l: *a{n - 1}, r: *a{n - 1}}}" for n in range(1, 40)]
    return "\n".join(["a0: &a0 {x: 1}", *lines])


def test_yaml_that_multiplies_itself(tmp_path: Path) -> None:
    for text in (multiplied(), doubled(), "[" * 150 + "]" * 150):
        path = tmp_path / "meter.yaml"
        path.write_text(text)
        done = measured("profiles", "check", path)
        assert done.status == 2
        assert "aliases" in done.err or "nested too deeply" in done.err
        assert done.peak_mib < BASE_MIB
    assert measured("import", "esphome", path).status == 2


def test_aliases_as_people_use_them(tmp_path: Path) -> None:
    """A few values written once and named often are no attack."""
    path = tmp_path / "meter.yaml"
    registers = "".join(f"  - {{<<: *common, at: 'hr:{n}', name: r{n}}}\n" for n in range(300))
    path.write_text(
        "x: &common {scale: 0.1, unit: bar}\nmodbus:\n  - name: a\n    type: tcp\n    host: b\n"
        "    sensors:\n"
        + "".join(f"      - {{name: r{n}, address: {n}, slave: 1}}\n" for n in range(300))
        + f"more:\n{registers}"
    )
    done = measured("import", "homeassistant", path)
    assert done.status == 0, done.err
    assert b"r299" in done.out


@pytest.mark.parametrize(
    "text",
    ["a = " + "[" * 50_000, ".".join("a" * 50_000) + " = 1", "[" + ".".join("a" * 50_000) + "]"],
)
def test_bus_files_that_go_deep(text: str, tmp_path: Path) -> None:
    path, recording = tmp_path / "bus.toml", tmp_path / "bus.hex"
    path.write_text(f"plant = 1\n{text}\n")
    recording.write_bytes(TEXT)
    done = measured("decode", recording, "--bus", path)
    assert (done.status, "nested too deeply" in done.err) == (2, True)
    assert done.peak_mib < BASE_MIB


DEEP: list[Callable[[int], str]] = [
    lambda n: "(" * n + "unit" + ")" * n,
    lambda n: "not " * n + "unit",
    lambda n: "unit == " + "-" * n + "1",
    lambda n: "unit == " + "+".join("1" * n),
    lambda n: "unit == 1" + " and unit == 1" * n,
    lambda n: "unit" + " == unit" * n,
    lambda n: "unit in " + "[" * n + "1" + "]" * n,
]


def test_filters_that_go_deep(tmp_path: Path) -> None:
    """One line each, at whatever depth."""
    recording = tmp_path / "bus.hex"
    recording.write_bytes(TEXT)
    for deep in DEEP:
        done = measured("export", recording, "--to", "csv", "--where", deep(900))
        assert done.status in (0, 2)
        assert len(done.err.splitlines()) <= 3
