r"""Compressed files: gzip, bzip2, xz, zstd.

The first bytes of a compressed file can be those of a recording: 1F 8B is unit 31 and an exception
of function 11. So a file counts as compressed only if its beginning can be decompressed without an
error, or if its name says so.

>>> import gzip
>>> kind(gzip.compress(b"01 03 00 6B"), "bus.log"), kind(bytes.fromhex("1f8b04c2f1"), "bus.bin")
('gzip', None)
"""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

from dissectors.errors import SourceError

__all__ = ["damage_kinds", "decompressor", "kind"]

_MAGIC = {
    b"\x1f\x8b": "gzip",
    b"BZh": "bz2",
    b"\xfd7zXZ\x00": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
}
_SUFFIXES = {
    ".gz": "gzip", ".tgz": "gzip", ".bz2": "bz2", ".tbz2": "bz2", ".xz": "xz", ".txz": "xz",
    ".zst": "zstd",
}  # fmt: skip

_WITH_GZIP_HEADER = 31
"""A window of 2**15 bytes, plus 16 for "with a gzip header" (zlib manual, inflateInit2)."""

_DAMAGE = {
    "zlib": "error", "lzma": "LZMAError", "zstandard": "ZstdError", "zipfile": "BadZipFile",
    "tarfile": "TarError",
}  # fmt: skip
"""The exception that each module raises for damaged data."""


def damage_kinds() -> tuple[type[Exception], ...]:
    """What the decompressors that have been loaded raise for damaged data."""
    loaded = {module: name for module, name in _DAMAGE.items() if module in sys.modules}
    return (
        EOFError,
        OSError,
        *(getattr(sys.modules[module], name) for module, name in loaded.items()),
    )


def kind(head: bytes, name: str) -> str | None:
    """How a file of this name that begins with `head` is compressed; None if it is not.

    Without a fitting suffix the head has to decompress to something, without an error.
    """
    found = next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), None)
    if found is None or _SUFFIXES.get(os.path.splitext(name)[1].lower()) == found:
        return found
    return found if found == "zstd" or _decompresses(head, found) else None


def _decompresses(head: bytes, found: str) -> bool:
    """Whether something comes out of these bytes, and no error."""
    if found == "gzip":
        machine: Any = importlib.import_module("zlib").decompressobj(_WITH_GZIP_HEADER)
    elif found == "bz2":
        machine = importlib.import_module("bz2").BZ2Decompressor()
        # A block of bzip2 is up to 900 kB: nothing may come out of the first bytes of a good file.
        return head[3:4].isdigit() and head[4:10] in (b"1AY&SY", b"\x17\x72\x45\x38\x50\x90")
    else:
        machine = importlib.import_module("lzma").LZMADecompressor()
    try:
        return bool(machine.decompress(head)) or machine.eof
    except damage_kinds():
        return False


def decompressor(file: Any, head: bytes, name: str = "") -> Any | None:
    """A file that reads what `file`, which begins with `head`, holds decompressed.

    None if it is not compressed. Closing it leaves `file` open.
    """
    found = kind(head, name)
    if found is None:
        return None
    if found == "gzip":
        return importlib.import_module("gzip").GzipFile(fileobj=file)
    if found == "bz2":
        return importlib.import_module("bz2").BZ2File(file)
    if found == "xz":
        return importlib.import_module("lzma").LZMAFile(file)
    try:
        zstandard = importlib.import_module("zstandard")
    except ImportError as error:
        from analyzer.installing import how_to_install  # noqa: PLC0415 - a message only

        raise SourceError(
            f"{name}: compressed by zstd, which needs a package: {how_to_install('zstandard')};"
            " or pipe it through zstdcat"
        ) from error
    return zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True)
