r"""Recordings: files, and standard input as `-`, passed on in blocks so that memory stays flat.

The first bytes are looked at to find the format (see detect.py) and are then delivered like all
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
import select
import stat
from collections.abc import Iterator
from types import TracebackType
from typing import BinaryIO, Self

from analyzer.sources.detect import SAMPLE, Detection, choose
from dissectors.errors import SourceError

__all__ = ["STDIN", "Recording", "check"]

STDIN = "-"
"""The name that means standard input."""

BLOCK = 256 * 1024
"""Bytes of one block; a pipe gives less."""

PATIENCE = 0.1
"""Seconds to wait for a pipe before an empty block says that nothing has come."""


class Recording:
    """An open recording: `name` as given, `detection` of what it holds.

    `SourceError` if it cannot be read.

    `read_as` overrides the detection. Use it in `with`.
    """

    def __init__(self, name: str, *, read_as: str | None = None) -> None:
        self.name = "stdin" if name == STDIN else name
        self._path = name
        check(name)
        try:
            # unbuffered: the blocks are large, and a pipe must not wait for a full one
            self._file = open(
                0 if name == STDIN else name, "rb", buffering=0, closefd=name != STDIN
            )
        except OSError as error:
            raise _trouble(self.name, error) from error
        try:
            self._waits = os.name == "posix" and not stat.S_ISREG(
                os.fstat(self._file.fileno()).st_mode
            )
            self._sample = self._read_sample()
            if not self._sample:
                raise SourceError(f"{self.name}: empty; there is nothing to decode")
            self.detection: Detection = choose(self._sample, self.name, read_as)
        except BaseException:
            self.close()
            raise

    def blocks(self) -> Iterator[bytes]:
        """All bytes, from the first on, once; an empty block means that a pipe has nothing yet."""
        sample, self._sample = self._sample, b""
        if sample:
            yield sample
        while (block := self._read(BLOCK)) is not None:
            yield block

    def seekable(self) -> str | BinaryIO:
        """What a reader that must go back and forth can open: the file's name, or all bytes."""
        return io.BytesIO(b"".join(self.blocks())) if self._waits else self._path

    def close(self) -> None:
        """Close the file; standard input stays open."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _read_sample(self) -> bytes:
        """The first `SAMPLE` bytes.

        Of a pipe what comes first, as far as that can be told apart.
        """
        sample = b""
        while len(sample) < SAMPLE:
            block = self._read(SAMPLE - len(sample))
            if block is None or (not block and sample):
                break
            sample += block
        return sample

    def _read(self, size: int) -> bytes | None:
        """The next bytes, b"" if a pipe has none yet, None at the end."""
        try:
            if self._waits and not select.select([self._file], [], [], PATIENCE)[0]:
                return b""
            return self._file.read(size) or None
        except OSError as error:
            raise _trouble(self.name, error) from error


def check(name: str) -> None:
    """`SourceError` if a file of this name can certainly not be read; standard input always can."""
    if name == STDIN:
        return
    try:
        mode = os.stat(name).st_mode
    except OSError as error:
        raise _trouble(name, error) from error
    except ValueError as error:  # a null character
        raise SourceError(f"{name!r}: {error}") from error
    if stat.S_ISDIR(mode):
        raise SourceError(f"{name}: a directory; name the files in it, as {name.rstrip('/')}/*")
    if not os.access(name, os.R_OK):
        raise _trouble(name, PermissionError(errno.EACCES, "permission denied"))
    if stat.S_ISCHR(mode) and "tty" in name:
        raise SourceError(f"{name}: a serial port, not a recording; listen to it by `modlens tap`")


def _trouble(name: str, error: OSError) -> SourceError:
    advice = {
        errno.ENOENT: "no such file; check the path",
        errno.ENOTDIR: "no such file; check the path",
        errno.EACCES: "no permission to read it",
        errno.EISDIR: "a directory; name the files in it",
    }
    reason = advice.get(error.errno or 0) or f"cannot be read: {error.strerror or error}"
    return SourceError(f"{name}: {reason}")
