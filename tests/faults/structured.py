"""Changes that know the form of a file: lengths, types, counts, times, nesting, at their limits.

Chance alone mostly breaks the frame around a field. These keep it: a length of a packet, a size in
the directory of an archive, the number of probes of a session, a time or a type in a line of JSON
become 0, one more, one less, 2^31, 2^32, 2^64 and their neighbours; blocks, lines and members
come twice, in another order, a thousand times, or within each other.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator

__all__ = ["restructured"]

Field = tuple[int, str]
"""Where a number is, and its form as `struct` writes it."""

PCAP = {b"\xd4\xc3\xb2\xa1": "<", b"\xa1\xb2\xc3\xd4": ">", b"\x4d\x3c\xb2\xa1": "<"}
SECTION = b"\x0a\x0d\x0d\x0a"
GZIP = b"\x1f\x8b"
LOCAL, DIRECTORY, DIRECTORY_END = b"PK\x03\x04", b"PK\x01\x02", b"PK\x05\x06"
TAR_BLOCK, TAR_MAGIC_AT, TAR_SUM = 512, 257, slice(148, 156)

MOST_BYTES = 4 << 20
"""A case is no larger: what large files take is measured elsewhere (`make growth`)."""

MOST_PACKED = 50_000
UNREADABLE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, RuntimeError)

LIMITS = [0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 2**24, 2**31 - 1, 2**31, 2**32 - 1,
          2**32, 2**53, 2**63 - 1, 2**63, 2**64 - 1, 2**64]  # fmt: skip

JSON_VALUES: list[object] = [
    None, True, "", "0", "\0", [], {}, [[]], 0, -1, 0.5, -0.0, 1e308, -1e308, 2**31, 2**32, 2**53,
    2**63 - 1, 2**63, 2**64, -(2**63) - 1, 10**40, "1e400", "9999-12-31T23:59:60Z",
    "0001-01-01T00:00:00Z", "1969-12-31T23:59:59.999999999-23:59", "x" * 5000, list(range(2000)),
]  # fmt: skip
TIMES = ["0", "-1", "1e18", "1e400", "4294967296", "18446744073709551616", "9223372036854775807",
         "9999-12-31T23:59:60Z", "0000-00-00T00:00:00", "24:61:61.9999999999", "NaN"]  # fmt: skip
DEPTHS = [2, 50, 5000, 200_000]


def restructured(data: bytes, chance: random.Random) -> bytes:
    """The file with one or a few of its numbers or parts changed, and its form kept."""
    form = _form(data)
    for _ in range(chance.choice([1, 1, 2, 4])):
        changed = form(data, chance)
        data = changed if len(changed) <= MOST_BYTES else data
    return data


def _form(data: bytes) -> Callable[[bytes, random.Random], bytes]:
    if data[TAR_MAGIC_AT : TAR_MAGIC_AT + 5] == b"ustar":
        return _tar
    if data[:4] == LOCAL:
        return _session if b"metadata" in data and b"logic-1" in data else _zip
    heads = [
        *((head, _pcap) for head in PCAP),
        (SECTION, _pcapng),
        (GZIP, _gzip),
        (b"{", _json_lines),
    ]
    return next((form for head, form in heads if data.startswith(head)), _text)


def _limit(number: int, width: int, chance: random.Random) -> int:
    """A number near one that matters, that fits into so many bytes."""
    near = chance.choice([number, number, *LIMITS]) + chance.choice([-1, 0, 1])
    return near % (1 << 8 * width)


def _set(data: bytes, fields: list[Field], chance: random.Random) -> bytes:
    """One of these numbers at a limit."""
    if not fields:
        return data
    at, form = chance.choice(fields)
    width = struct.calcsize(form)
    if at + width > len(data):
        return data
    (number,) = struct.unpack_from(form, data, at)
    new = struct.pack(form, _limit(number, width, chance))
    return data[:at] + new + data[at + width :]


def _parts(parts: list[bytes], chance: random.Random) -> list[bytes]:
    """Parts twice, gone, in another order, or very many of them."""
    one, other = (chance.randrange(len(parts)) for _ in "ab")
    match chance.randrange(4):
        case 0:
            return [
                *parts[:one],
                *parts[one : one + 1] * chance.choice([2, 100, 2000]),
                *parts[one:],
            ]
        case 1:
            return parts[:one] + parts[one + 1 :]
        case 2:
            parts[one], parts[other] = parts[other], parts[one]
            return parts
        case _:
            return [*parts, *parts]


def _pcap(data: bytes, chance: random.Random) -> bytes:
    """Numbers of the header, of a record, of the packet in it."""
    end = PCAP.get(data[:4], "<")
    records, at = [], 24
    while at + 16 <= len(data):
        (length,) = struct.unpack_from(f"{end}I", data, at + 8)
        records.append(data[at : at + 16 + length])
        at += 16 + length
    if not records or chance.random() < 0.1:
        return _set(data, [(place, f"{end}I") for place in (0, 4, 8, 12, 16, 20)], chance)
    if chance.random() < 0.3:
        return data[:24] + b"".join(_parts(records, chance)) + data[at:]
    number = chance.randrange(len(records))
    head = [(place, f"{end}I") for place in (0, 4, 8, 12)]
    fields = head if chance.random() < 0.5 else _packet_fields(16)
    records[number] = _set(records[number], fields, chance)
    return data[:24] + b"".join(records) + data[at:]


def _packet_fields(at: int) -> list[Field]:
    """Ethernet's type, IPv4's lengths and fragments, TCP's numbers, the MBAP header, the PDU."""
    ip, tcp, mbap = at + 14, at + 34, at + 54
    return [
        (at + 12, ">H"), (ip, ">B"), (ip + 2, ">H"), (ip + 4, ">H"), (ip + 6, ">H"), (ip + 9, ">B"),
        (tcp, ">H"), (tcp + 2, ">H"), (tcp + 4, ">I"), (tcp + 8, ">I"), (tcp + 12, ">B"),
        (tcp + 13, ">B"), (mbap, ">H"), (mbap + 2, ">H"), (mbap + 4, ">H"), (mbap + 6, ">B"),
        (mbap + 7, ">B"), (mbap + 8, ">B"), (mbap + 8, ">H"), (mbap + 10, ">H"),
    ]  # fmt: skip


def _pcapng(data: bytes, chance: random.Random) -> bytes:
    """Numbers of a block, with its two lengths agreeing or not, and its options."""
    blocks, at = [], 0
    while at + 12 <= len(data):
        (length,) = struct.unpack_from("<I", data, at + 4)
        if length < 12 or at + length > len(data):
            break
        blocks.append(data[at : at + length])
        at += length
    if not blocks or chance.random() < 0.3:
        return b"".join(_parts(blocks, chance) if blocks else []) + data[at:]
    number = chance.randrange(len(blocks))
    one = blocks[number]
    words = [(place, "<I") for place in range(0, min(len(one), 32), 4)]
    options = [(place, "<H") for place in range(8, len(one) - 4, 2)]
    times = [(12, "<Q")] if len(one) > 28 else []
    blocks[number] = _set(one, chance.choice([words, options, times or words]), chance)
    if chance.random() < 0.1:
        blocks.insert(number, one[:8] + data[:4000] + one[-4:])
    return b"".join(blocks) + data[at:]


def _zip_fields(data: bytes) -> Iterator[Field]:
    """Flags, methods, times, sizes, counts and offsets of an archive."""
    forms = {
        LOCAL: ((4, "H"), (6, "H"), (8, "H"), (10, "I"), (14, "I"), (18, "I"), (22, "I"), (26, "H"),
                (28, "H")),
        DIRECTORY: ((8, "H"), (10, "H"), (12, "I"), (16, "I"), (20, "I"), (24, "I"), (28, "H"),
                    (30, "H"), (32, "H"), (34, "H"), (42, "I")),
        DIRECTORY_END: ((4, "H"), (8, "H"), (10, "H"), (12, "I"), (16, "I"), (20, "H")),
    }  # fmt: skip
    for found in re.finditer(rb"PK(?:\x01\x02|\x03\x04|\x05\x06)", data):
        yield from ((found.start() + at, f"<{form}") for at, form in forms[found[0]])


def _zip(data: bytes, chance: random.Random) -> bytes:
    if chance.random() < 0.8:
        return _set(data, list(_zip_fields(data)), chance)
    for _ in range(chance.choice([1, 3, 30])):
        outer = io.BytesIO()
        with zipfile.ZipFile(outer, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("bus.zip", data)
        data = outer.getvalue()
    return data


def _session(data: bytes, chance: random.Random) -> bytes:
    """A session of sigrok with other numbers in its metadata, or other members."""
    if chance.random() < 0.2:
        return _zip(data, chance)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except UNREADABLE:
        return _zip(data, chance)
    name = chance.choice(list(members))
    match chance.randrange(4):
        case 0 | 1:
            members["metadata"] = _number_of_text(members.get("metadata", b""), chance)
        case 2:
            members[f"logic-1-{chance.choice([0, 2, 3, 2**32, 10**30])}"] = members[name]
        case _:
            half = len(members[name]) // 2
            members[name] = chance.choice([b"", members[name][:half], members[name] * 40])
    outer = io.BytesIO()
    with zipfile.ZipFile(outer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return outer.getvalue()


def _tar(data: bytes, chance: random.Random) -> bytes:
    """A size (octal, or binary as GNU writes it), a type or a time, with the checksum fixed."""
    head = bytearray(data[:TAR_BLOCK])
    number = _limit(len(data), 8, chance)
    size = chance.choice([b"%011o\0" % (number % 8**11), b"\x80" + bytes(3) + number.to_bytes(8)])
    match chance.randrange(4):
        case 0 | 1:
            head[124:136] = size
        case 2:
            head[136:148] = size
        case _:
            head[156] = chance.choice(b"01234567LKxgSVN\x00")
    head[TAR_SUM] = b" " * 8
    head[TAR_SUM] = b"%06o\0 " % sum(head)
    data = bytes(head) + data[TAR_BLOCK:]
    return bytes(head) * chance.choice([1, 2, 500]) + data if chance.random() < 0.2 else data


def _gzip(data: bytes, chance: random.Random) -> bytes:
    """Method, flags, time, extra length and the size at the end."""
    fields = [
        (2, "<B"),
        (3, "<B"),
        (4, "<I"),
        (10, "<H"),
        (len(data) - 4, "<I"),
        (len(data) - 8, "<I"),
    ]
    changed = _set(data, fields, chance)
    # Each member unpacks to many times its size.
    return changed * min(chance.choice([1, 1, 2, 300]), max(1, MOST_PACKED // len(changed)))


def _json_lines(data: bytes, chance: random.Random) -> bytes:
    """A cell of another type, at a limit, nested, twice, or gone."""
    lines = data.split(b"\n")
    if chance.random() < 0.2:
        return b"\n".join(_parts(lines, chance))
    at = chance.randrange(len(lines))
    try:
        row = json.loads(lines[at])
    except (ValueError, RecursionError):
        return _text(data, chance)
    if not isinstance(row, dict) or not row:
        return _text(data, chance)
    key = chance.choice(list(row))
    match chance.randrange(5):
        case 0 | 1:
            row[key] = chance.choice(JSON_VALUES)
        case 2:
            del row[key]
        case 3:
            row[key + chance.choice(["", "\u202e", " "])] = row.pop(key)
        case _:
            depth = chance.choice(DEPTHS)
            nested = (b"[" * depth + b"]" * depth, b'{"a":' * depth + b"1" + b"}" * depth)
            lines[at] = lines[at][:-1] + b', "n": ' + chance.choice(nested) + b"}"
            return b"\n".join(lines)
    text = json.dumps(row).encode()
    if chance.random() < 0.1:
        text = text[:-1] + b", " + text[1:]
    lines[at] = text
    return b"\n".join(lines)


def _number_of_text(data: bytes, chance: random.Random) -> bytes:
    """A number of a text at a limit; a time becomes one that no clock shows."""
    found = list(re.finditer(rb"\d[\d.:T-]*", data))
    if not found:
        return data
    one = chance.choice(found)
    digits = re.sub(rb"\D.*", b"", one[0])[:18] or b"0"
    numbers = [b"%d" % (chance.choice([int(digits), *LIMITS]) + chance.choice([-1, 0, 1]))]
    new = chance.choice([*numbers, chance.choice(TIMES).encode()])
    return data[: one.start()] + new + data[one.end() :]


def _text(data: bytes, chance: random.Random) -> bytes:
    """A number or time of a text, its lines, or the cells of one."""
    if chance.random() < 0.5:
        return _number_of_text(data, chance)
    lines = data.split(b"\n")
    if chance.random() < 0.4:
        return b"\n".join(_parts(lines, chance))
    at = chance.randrange(len(lines))
    mark = chance.choice([b",", b" ", b";", b"\t", b'"'])
    lines[at] = mark.join(_parts(lines[at].split(mark), chance))
    return b"\n".join(lines)
