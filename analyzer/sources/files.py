r"""Recordings: files, and standard input as `-`, read in blocks so that memory stays flat.

The first bytes are used to detect the format (see detect.py) and are then delivered like all
others.

>>> import tempfile, pathlib
>>> path = pathlib.Path(tempfile.mkdtemp()) / "bus.hex"
>>> _ = path.write_text("01 03 00 6B 00 03 74 17\n")
>>> with Recording(str(path)) as recording:
...     recording.detection.format, b"".join(recording.blocks())
('hex', b'01 03 00 6B 00 03 74 17\n')
"""

from __future__ import annotations

import errno
import io
import os
import stat
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any, BinaryIO, Self

import _modlens
from analyzer.sources import encodings
from analyzer.sources.archives import looks_like_archive
from analyzer.sources.compression import damage_kinds, decompressor
from analyzer.sources.detect import SAMPLE_BYTES, Detection, detect_format
from analyzer.sources.encodings import Transcoder
from analyzer.sources.pipes import STDIN, WAIT_S, has_bytes, open_unbuffered
from analyzer.sources.unpack import Archives
from dissectors.errors import CaptureError, SourceError

__all__ = ["RAW", "Recording", "check_readable", "printable_name", "size_of"]

RAW = "raw"
"""The format whose bytes are those of the line, whatever they look like."""

BLOCK_BYTES = 256 * 1024
"""Bytes of one block; a pipe may give fewer. For each, Python and the sinks are called some times:
in blocks of 64 KiB that took a tenth of a whole export."""

_MAX_IN_MEMORY_BYTES = 128 << 20
"""A file inside an archive or a stream that has to be read here and there is not larger."""

_MAX_COMPRESSION_LAYERS = 3
"""How often a file may be compressed: a compressed file may have been compressed again."""


class Recording:
    """An open recording; use it in `with`.

    `name` is its name in messages, `detection` its format. `read_as` forces a format, `dialects` is
    the table of text formats with those of the user. With `follow` the file may grow: its end is
    waited at. Compressed files and other encodings than UTF-8 are converted, except where `read_as`
    is `raw`. `archives` are those that stay open from one member to the next; `data` are the bytes
    where there is no file; `damage` says what was wrong with a compressed file, None if nothing
    was. `SourceError` if the recording cannot be read.
    """

    def __init__(  # noqa: PLR0913 - most by keyword
        self,
        name: str,
        *,
        read_as: str | None = None,
        dialects: _modlens.Dialects | None = None,
        follow: bool = False,
        archives: Archives | None = None,
        data: bytes | None = None,
    ) -> None:
        self.name = "stdin" if name == STDIN else printable_name(name)
        self._data = data
        self.damage: str | None = None
        self._path = name
        self._follow = follow
        self._transcode: Transcoder | None = None
        # Whether the file of this name holds exactly these bytes, so that it can be opened again by
        # name.
        self._is_plain_file = data is None and name != STDIN and os.path.isfile(name)
        # The files that `_file` is read from: archives, and compressed files below their
        # decompressors.
        self._enclosing_files = ExitStack()
        self._archives = archives or self._enclosing_files.enter_context(Archives())
        try:
            self._file = self._open(name)
            self._outermost = self._file
            self._may_block = os.name == "posix" and not self._is_regular()
            # The bytes of a line can begin like any other file: FF FE is a glitch, 1F 8B a refusal.
            self._sample = self._read_sample() if read_as == RAW else self._read_plain_sample()
            if not self._sample and self.damage is not None:
                raise CaptureError(self.damage, path=self.name)
            if not self._sample:
                raise SourceError(f"{self.name}: empty")
            self.detection: Detection = detect_format(self._sample, self.name, read_as, dialects)
        except BaseException:
            self.close()
            raise

    @property
    def sample(self) -> bytes:
        """The first bytes, by which the format was detected.

        Empty once they have been delivered.
        """
        return self._sample

    @property
    def position(self) -> int:
        """How far the file itself has been read, before it is decompressed; 0 for a pipe."""
        try:
            return int(self._outermost.tell())
        except (OSError, ValueError, AttributeError):
            return 0

    def blocks(self, together: int = 1) -> Iterator[bytes]:
        """All bytes of the recording, once; an empty block means that no data have arrived yet.

        A block has as many bytes as `together` blocks of `BLOCK_BYTES`.
        """
        sample, self._sample = self._sample, b""
        if sample:
            yield sample
        while (block := self._next_block(together * BLOCK_BYTES)) is not None:
            yield block

    def seekable(self) -> str | BinaryIO:
        """A file that can be read at any position: the file's name, or all bytes in memory."""
        if self._is_plain_file:
            return self._path
        whole = bytearray()
        for block in self.blocks():
            whole += block
            if len(whole) > _MAX_IN_MEMORY_BYTES:
                raise CaptureError("too large to be read in place; unpack it first", path=self.name)
        return io.BytesIO(whole)

    def close(self) -> None:
        """Close the file and the files that it is read from; standard input stays open."""
        with self._enclosing_files:
            if hasattr(self, "_file"):
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _open(self, name: str) -> Any:
        if self._data is not None:
            return io.BytesIO(self._data)
        try:
            if (member := self._archives.open(name)) is not None:
                return member
            check_readable(name)
            # Unbuffered, because the blocks are large and a read of a pipe must not wait until one
            # is full.
            return open_unbuffered(name)
        except OSError as error:
            raise _source_error(self.name, error) from error

    def _is_regular(self) -> bool:
        try:
            return stat.S_ISREG(os.fstat(self._file.fileno()).st_mode)
        # A member of an archive has no file descriptor; it never blocks.
        except (OSError, AttributeError):
            return True

    def _read_plain_sample(self) -> bytes:
        """Read the first bytes, decompressed, and converted to UTF-8 where they are text."""
        sample = self._read_sample()
        for _ in range(_MAX_COMPRESSION_LAYERS):
            plain = decompressor(_PrependedReader(sample, self._file), sample, self.name)
            if plain is None:
                break
            self._enclosing_files.enter_context(self._file)
            self._file, self._may_block, self._follow, self._is_plain_file = (
                plain,
                False,
                False,
                False,
            )
            sample = self._read_sample()
        if looks_like_archive(sample):
            message = "an archive inside a stream or too deep in others; unpack it first"
            raise CaptureError(message, path=self.name)
        if (encoding := encodings.detect_encoding(sample)) is not None:
            self._transcode = Transcoder(encoding)
            sample = self._transcode(sample)
        return sample

    def _read_sample(self) -> bytes:
        """Read the first `SAMPLE_BYTES` bytes; of a pipe what has arrived by now."""
        sample = b""
        while len(sample) < SAMPLE_BYTES:
            block = self._read(SAMPLE_BYTES - len(sample))
            if block is None or (not block and sample):
                break
            sample += block
        return sample

    def _next_block(self, size: int) -> bytes | None:
        block = self._read(size)
        if block is None and self._follow:
            time.sleep(WAIT_S)
            block = self._read_behind_end()
        if self._transcode is not None and block != b"":
            block = self._transcode(block or b"", final=block is None) or None
        return block

    def _read_behind_end(self) -> bytes:
        """What has been written since the end was seen; then the new file of this name, if any.

        A log is rotated while its writer goes on: until the new file has bytes, further ones may be
        written to the old file, and those written just before the rename have to be read first.
        """
        try:
            there, here = os.stat(self._path), os.fstat(self._file.fileno())
        except OSError:
            # There is no file of this name in the moment between the old log and the new one.
            return self._read(BLOCK_BYTES) or b""
        is_replaced = (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino)
        block = self._read(BLOCK_BYTES)
        if block is None and is_replaced and there.st_size:
            file = self._open(self._path)
            self._file.close()
            self._file = file
        elif block is None and not is_replaced and there.st_size < self._file.tell():
            self._file.seek(0)
        return block or b""

    def _read(self, size: int) -> bytes | None:
        """Read the next bytes: b"" if a pipe has none yet, None at the end."""
        try:
            if (
                self._may_block
                and not has_bytes(self._file)
                and os.get_blocking(self._file.fileno())
            ):
                return b""
            # `read1` of a decompressor returns the bytes before a damaged place; `read` would lose
            # them.
            read = getattr(self._file, "read1", self._file.read)
            block = read(size)
            # None: a FIFO has nothing yet. Only reading reports its end, not `select`, where
            # the writer had left before the FIFO was opened here.
            return b"" if block is None else bytes(block) or None
        except OSError as error:
            if isinstance(error, _gzip_error()):
                self._record_damage(error)
                return None
            raise _source_error(self.name, error) from error
        except Exception as error:
            if not isinstance(error, damage_kinds()):
                raise
            self._record_damage(error)
            return None

    def _record_damage(self, error: Exception) -> None:
        """Remember that a compressed file is damaged; the bytes before that place are decoded."""
        self.damage = f"damaged or truncated after what was decoded ({error})"


class _PrependedReader:
    """Bytes that have been read already, followed by the rest of the file that they come from."""

    def __init__(self, head: bytes, file: Any) -> None:
        self._head = head
        self._file = file

    def read(self, size: int = -1) -> bytes:
        """Read `size` bytes, fewer only at the end; all for -1."""
        if size < 0:
            head, self._head = self._head, b""
            return head + bytes(self._file.read())
        head, self._head = self._head[:size], self._head[size:]
        while len(head) < size and (block := self._file.read(size - len(head))):
            head += block
        return head

    def readable(self) -> bool:
        """True; `lzma` requires the method."""
        return True

    def seekable(self) -> bool:
        """False: the bytes that were read already cannot be read again."""
        return False


def _gzip_error() -> type[Exception]:
    """The exception that gzip raises for damaged data.

    It is an `OSError`, although nothing is wrong with the file system. If gzip is not loaded, any
    exception type that `_read` handles in the same way will do.
    """
    module = sys.modules.get("gzip")
    return getattr(module, "BadGzipFile", EOFError)


def printable_name(name: str) -> str:
    r"""The name of a file as text; bytes that are not UTF-8 are shown as `\xe9`.

    >>> printable_name("caf\udce9.log")
    'caf\\xe9.log'
    """
    if name.isascii():
        return name
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def size_of(name: str) -> int | None:
    """The bytes of a file; None where nobody knows them before they have been read."""
    try:
        there = os.stat(name)
    except (OSError, ValueError):
        return None
    return there.st_size if stat.S_ISREG(there.st_mode) else None


def check_readable(name: str) -> None:
    """Raise `SourceError` if a file of this name cannot be read; standard input always can."""
    if name == STDIN:
        return
    try:
        mode = os.stat(name).st_mode
    except OSError as error:
        raise _source_error(name, error) from error
    # A file name with a null character raises `ValueError`.
    except ValueError as error:
        raise SourceError(f"{name!r}: {error}") from error
    if stat.S_ISDIR(mode):
        raise SourceError(f"{name}: a directory; name the files in it, as {name.rstrip('/')}/*")
    if not os.access(name, os.R_OK):
        raise _source_error(name, PermissionError(errno.EACCES, "permission denied"))
    if stat.S_ISCHR(mode) and "tty" in name:
        raise SourceError(f"{name}: a serial port, not a recording; listen to it by `modlens tap`")


def _source_error(name: str, error: OSError) -> SourceError:
    advice = {
        errno.ENOENT: "no such file",
        errno.ENOTDIR: "no such file",
        errno.EACCES: "no permission to read it",
        errno.EISDIR: "a directory; name the files in it",
    }
    reason = advice.get(error.errno or 0) or f"cannot be read: {error.strerror or error}"
    return SourceError(f"{name}: {reason}")
