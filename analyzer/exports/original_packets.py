"""Extracts packets from a capture, byte for byte, for use as evidence.

The section header names the file and its SHA-256, so that everybody who has the whole capture can
verify the extract. A pcapng keeps its blocks (interfaces, names, options of the packets); the
packets of a classic pcap are put into pcapng blocks, their bytes unchanged.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Container, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO

import _modlens
from analyzer.sources.compression import decompressor
from analyzer.sources.unpack import Archives
from dissectors.errors import SourceError

__all__ = ["extract_packets"]

SECTION, INTERFACE = 0x0A0D0D0A, 1
PACKET_BLOCKS = (2, 3, 6)
"""Types of blocks with a packet: obsolete, simple, and enhanced packet blocks."""

COMMENT, END_OF_OPTIONS = 1, 0
BYTE_ORDER = b"\x1a\x2b\x3c\x4d"
HEADER_BYTES = 24
"""Bytes of a section header before its options; a classic file's header has as many."""

CLASSIC_MAGIC = {
    b"\xa1\xb2\xc3\xd4": (">", 6), b"\xd4\xc3\xb2\xa1": ("<", 6),
    b"\xa1\xb2\x3c\x4d": (">", 9), b"\x4d\x3c\xb2\xa1": ("<", 9),
}  # fmt: skip
"""Magic number of a classic pcap -> byte order, decimal digits of a second."""

_SAMPLE_BYTES = 4096
"""Bytes that show whether a file is compressed."""

MAX_BLOCK_BYTES = 1 << 26
"""A block that claims to be longer is damaged."""


def extract_packets(name: str, wanted: Container[int]) -> Iterator[bytes]:
    """Extract the packets with these numbers (from 1) as blocks of a pcapng section.

    A compressed file is decompressed; the SHA-256 is that of the file as it is stored, or in its
    archive. `SourceError` if the file cannot be read, or is not a capture.
    """
    try:
        with ExitStack() as opened:
            archives = opened.enter_context(Archives())
            stored = archives.open(name) or opened.enter_context(Path(name).open("rb"))
            digest = _sha256(stored)
            head = stored.read(_SAMPLE_BYTES)
            stored.seek(0)
            content = decompressor(stored, head, name)
            file = stored if content is None else opened.enter_context(content)
            comment = (
                f"packets cut out of {name} by modlens {_modlens.__version__}, byte for byte;"
                f" SHA-256 of the whole file: {digest}"
            )
            magic = file.read(4)
            file.seek(0)
            if magic in CLASSIC_MAGIC:
                yield from _classic(file, wanted, comment)
            elif magic == SECTION.to_bytes(4):
                yield from _blocks(file, wanted, comment)
            else:
                raise SourceError(
                    f"{name}: --style original copies the packets of the recording, which must be"
                    f" a pcap or pcapng itself; leave --style away"
                )
    except OSError as error:
        raise SourceError(f"{name}: cannot be read: {error.strerror}") from error


def _sha256(file: IO[bytes]) -> str:
    """The SHA-256 of a whole file; the file is rewound afterwards."""
    digest = hashlib.sha256()
    while block := file.read(1 << 20):
        digest.update(block)
    file.seek(0)
    return digest.hexdigest()


def _blocks(file: IO[bytes], wanted: Container[int], comment: str) -> Iterator[bytes]:
    """The blocks of a pcapng: section headers with our comment, wanted packets, the rest."""
    order, number = "<", 0
    while len(head := file.read(8)) == 8:  # noqa: PLR2004 - type and length
        kind = int.from_bytes(head[:4], "little")
        if kind == SECTION:
            order = ">" if (magic := file.read(4)) == BYTE_ORDER else "<"
            head += magic
        kind, length = struct.unpack(order + "II", head[:8])
        if not len(head) + 4 <= length <= MAX_BLOCK_BYTES:
            return
        block = head + file.read(length - len(head))
        if len(block) < length:
            return
        if kind == SECTION:
            yield _with_comment(block, order, comment)
        elif kind in PACKET_BLOCKS:
            number += 1
            if number in wanted:
                yield block
        else:
            yield block


def _with_comment(block: bytes, order: str, comment: str) -> bytes:
    """A section header with a comment added; the section's length is set to unknown (-1)."""
    text = comment.encode()
    option = struct.pack(order + "HH", COMMENT, len(text)) + text + bytes(-len(text) % 4)
    options = block[HEADER_BYTES:-4] or bytes(4)
    content = block[8:16] + b"\xff" * 8 + option + options
    length = struct.pack(order + "I", len(content) + 12)
    return block[:4] + length + content + length


def _classic(file: IO[bytes], wanted: Container[int], comment: str) -> Iterator[bytes]:
    """The wanted packets of a classic pcap, each in an enhanced packet block."""
    head = file.read(HEADER_BYTES)
    order, digits = CLASSIC_MAGIC[head[:4]]
    snap, link = struct.unpack(order + "II", head[16:24])
    section = struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)
    yield _with_comment(_block(SECTION, section), "<", comment)
    resolution = struct.pack("<HHB3xI", 9, 1, digits, END_OF_OPTIONS)
    yield _block(INTERFACE, struct.pack("<HHI", link & 0xFFFF, 0, snap) + resolution)
    number = 0
    while len(record := file.read(16)) == 16:  # noqa: PLR2004 - the header of a record
        number += 1
        seconds, rest, captured_bytes, length = struct.unpack(order + "IIII", record)
        if (
            captured_bytes > MAX_BLOCK_BYTES
            or len(data := file.read(captured_bytes)) < captured_bytes
        ):
            return
        if number in wanted:
            moment = seconds * 10**digits + rest
            packet = struct.pack(
                "<IIIII", 0, moment >> 32, moment & 0xFFFFFFFF, captured_bytes, length
            )
            yield _block(6, packet + data + bytes(-captured_bytes % 4))


def _block(kind: int, content: bytes) -> bytes:
    length = struct.pack("<I", len(content) + 12)
    return struct.pack("<I", kind) + length + content + length
