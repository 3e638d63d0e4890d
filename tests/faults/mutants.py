"""Damaged recordings: every file in `captures/`, packed and unpacked, changed by chance or form.

A case is known by its seed and number alone, so that one that fails can be made again.
"""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import random
import subprocess
import tarfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from analyzer.line import parse_line
from tests.conftest import CAPTURES, ROOT, command
from tests.faults.structured import restructured
from tests.support.sigrok import samples, session, spaced

__all__ = ["Case", "case"]

HEADS = [
    b"\xff\xfe", b"\xfe\xff", b"\xef\xbb\xbf", b"\x1f\x8b", b"\x1f\x8b\x08\x00", b"BZh9",
    b"PK\x03\x04", b"\x00" * 8, b"\x1a", b"\x07", b"\xd4\xc3\xb2\xa1\x02\x00\x04\x00",
    b"\x0a\x0d\x0d\x0a", b"\x28\xb5\x2f\xfd", b"From: a\nTo: b\nDate: c\n",
]  # fmt: skip
"""How other files begin, and what editors, terminals and lost power leave in a text."""

SESSIONS = ["session.sr", "session-of-three.sr"]
"""Samples of a line as sigrok keeps them, alone and beside others."""

NUMBERS = [b"0", b"-1", b"1e308", b"99999999999999999999", b"1e-320", b"NaN", b"0x", b"\xd9\xa3"]


@dataclass(frozen=True)
class Case:
    """A file, and how `modlens` is to read it.

    `is_raw` says that its bytes are those of a line, `is_reimported` that it was written from rows
    and gives them back: the offsets are then what the file says, right or damaged.
    """

    name: str
    data: bytes
    words: list[str]
    is_raw: bool = False
    is_reimported: bool = False


def case(seed: int, number: int) -> Case:
    """The case of this number."""
    chance = random.Random(f"{seed}/{number}")
    recordings = _recordings()
    # Lists of what a capture shows are files that people name by mistake: few of them are enough.
    name = chance.choice([name for name in recordings if not name.endswith(".toml")])
    name = chance.choice(list(recordings)) if chance.random() < 0.1 else name
    name = chance.choice(SESSIONS) if chance.random() < 0.05 else name
    change = _damaged if chance.random() < 0.5 else restructured
    data = change(recordings[name], chance)
    if chance.random() < 0.3:
        pack = chance.choice(list(_PACKERS))
        data, name = _PACKERS[pack](data, name), f"{name}.{pack}"
        data = change(data, chance) if chance.random() < 0.7 else data
    if chance.random() < 0.15:
        return Case(name, data, ["--from", "raw", *_mode(chance)], is_raw=True)
    is_reimported = ".pcap" in name and "recording" not in name
    return Case(name, data, _mode(chance), is_reimported=is_reimported)


@cache
def _recordings() -> dict[str, bytes]:
    """The files of the captures by name, and some of them as modlens and sigrok write them."""
    paths = sorted(path for path in CAPTURES.rglob("*") if path.is_file())
    found = {f"{path.parent.name}-{path.name}": path.read_bytes() for path in paths}
    for name in ("pymodbus_disturbed", "pymodbus_ascii", "pymodbus_tcp", "pymodbus_mixed_answers"):
        path = next(path for path in paths if path.parent.name == name and path.stem == "recording")
        for number, words in enumerate(_WRITTEN):
            found[f"{name}-{number}.{words[1]}"] = _exported(path, words)
    line = parse_line("9600-8N1")
    wire = spaced(bytes.fromhex("010300000001840a"), 0.0, line)
    wire += spaced(bytes.fromhex("0103020007f986"), 0.05, line)
    for channels in (["D0"], ["D0", "D1", "CLK"]):
        name = SESSIONS[len(channels) > 1]
        found[name] = session(samples(line, [wire] * len(channels)), channels)
    return found


_WRITTEN = [
    ["--to", "pcapng"], ["--to", "pcapng", "--style", "rtu"], ["--to", "pcap"], ["--to", "csv"],
    ["--to", "jsonl", "--table", "frames"],
]  # fmt: skip


def _exported(path: Path, words: list[str]) -> bytes:
    done = subprocess.run(
        command("export", path, *words), capture_output=True, check=True, cwd=ROOT
    )
    return done.stdout


def _mode(chance: random.Random) -> list[str]:
    if chance.random() < 0.7:
        return []
    words = [["--mode", chance.choice(["rtu", "ascii", "tcp"])], ["--line", "19200-8E1"]]
    return [*chance.choice(words)]


def _damaged(data: bytes, chance: random.Random) -> bytes:
    """One to six changes; one in forty stays as it is."""
    if chance.random() < 0.025:
        return data
    for _ in range(chance.choice([1, 1, 1, 2, 3, 6])):
        data = chance.choice(_CHANGES)(data, chance)
    return data


def _place(data: bytes, chance: random.Random) -> int:
    """A place in a file; headers are hit more often than chance would."""
    most = min(len(data), 64) if chance.random() < 0.25 else len(data)
    return chance.randrange(most + 1)


def _flip(data: bytes, chance: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(min(len(data), chance.choice([1, 1, 4, 40]))):
        changed[min(_place(data, chance), len(data) - 1)] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _overwrite(data: bytes, chance: random.Random) -> bytes:
    at = _place(data, chance)
    filling = chance.choice([b"\x00", b"\xff", b"\x7f\xff\xff\xff", chance.randbytes(4)])
    new = (filling * 64)[: chance.choice([1, 2, 4, 64])]
    return data[:at] + new + data[at + len(new) :]


def _insert(data: bytes, chance: random.Random) -> bytes:
    at = _place(data, chance)
    new = chance.choice([chance.randbytes(chance.randrange(1, 40)), *HEADS, *NUMBERS])
    return data[:at] + new + data[at:]


def _head(data: bytes, chance: random.Random) -> bytes:
    return chance.choice(HEADS) + data


def _cut(data: bytes, chance: random.Random) -> bytes:
    at = _place(data, chance)
    return data[:at] + data[at + chance.choice([1, 2, 16, 500, len(data)]) :]


def _repeat(data: bytes, chance: random.Random) -> bytes:
    at, length = _place(data, chance), chance.choice([1, 8, 100, 2000])
    return data[:at] + data[at : at + length] * chance.choice([2, 3, 50]) + data[at:]


def _zeros(data: bytes, chance: random.Random) -> bytes:
    return data + bytes(chance.choice([1, 100, 20_000]))


def _splice(data: bytes, chance: random.Random) -> bytes:
    other = chance.choice(list(_recordings().values()))
    at, start = _place(data, chance), _place(other, chance)
    rest = data[at:] if chance.random() < 0.5 else b""
    return data[:at] + other[start : start + 3000] + rest


def _digits(data: bytes, chance: random.Random) -> bytes:
    """A number of a text is replaced by one that nobody expects."""
    places = [at for at in range(len(data)) if data[at : at + 1].isdigit()]
    if not places:
        return _insert(data, chance)
    at = chance.choice(places)
    return data[:at] + chance.choice(NUMBERS) + data[at + 1 :]


def _lines(data: bytes, chance: random.Random) -> bytes:
    """Lines change places, lose their ends, or get those of other systems."""
    lines = data.split(b"\n")
    one, other = (chance.randrange(len(lines)) for _ in "ab")
    lines[one], lines[other] = lines[other], lines[one]
    return chance.choice([b"\n", b"\r\n", b"\r", b" ", b""]).join(lines)


def _unicode(data: bytes, chance: random.Random) -> bytes:
    text = data.decode("latin-1")
    return text.encode(chance.choice(["utf-16", "utf-16-le", "utf-16-be", "utf-8", "utf-32"]))


_CHANGES: list[Callable[[bytes, random.Random], bytes]] = [
    _flip, _flip, _flip, _overwrite, _overwrite, _insert, _insert, _head, _cut, _cut, _repeat,
    _zeros, _splice, _digits, _lines, _unicode,
]  # fmt: skip


def _zip(data: bytes, name: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, data)
        archive.writestr("again.hex", "010300000001840a\n0103020007f986\n")
    return packed.getvalue()


def _tar(data: bytes, name: str) -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as archive:
        entry = tarfile.TarInfo(name)
        entry.size = len(data)
        archive.addfile(entry, io.BytesIO(data))
    return packed.getvalue()


def _mail(data: bytes, name: str) -> bytes:
    from email.message import EmailMessage  # noqa: PLC0415

    mail = EmailMessage()
    mail["From"], mail["To"], mail["Subject"] = "a@example.org", "b@example.org", "the bus"
    mail.set_content("as attached")
    mail.add_attachment(data, maintype="application", subtype="octet-stream", filename=name)
    return bytes(mail)


_PACKERS: dict[str, Callable[[bytes, str], bytes]] = {
    "zip": _zip,
    "tar": _tar,
    "eml": _mail,
    "gz": lambda data, _: gzip.compress(data, mtime=0),
    "bz2": lambda data, _: bz2.compress(data),
    "xz": lambda data, _: lzma.compress(data),
    "tar.gz": lambda data, name: gzip.compress(_tar(data, name), mtime=0),
}
