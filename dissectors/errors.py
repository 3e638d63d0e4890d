"""The errors of modlens: trouble of the operator, never of the bus.

A passive analyzer cannot fail on bytes: damage on the line becomes verdicts and findings. What
raises is what the person at the keyboard can fix: a missing file, a wrong profile, a filter with a
typing error. Every message is one line that says what is wrong, where, and what to do; every class
carries the exit status of the command line.

>>> error = FilterError("unknown column 'untis'", text="untis == 3", column=0, hint="units")
>>> print(error)
unknown column 'untis' (column 1 of 'untis == 3'); did you mean 'units'?
>>> error.exit_status
2
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import ClassVar

__all__ = [
    "CaptureError",
    "FilterError",
    "ModlensError",
    "ModlensWarning",
    "PortError",
    "ProfileError",
    "SourceError",
    "UsageError",
]

Path = str | os.PathLike[str]


class ModlensError(Exception):
    r"""The root of all errors that modlens raises on purpose; `str()` is one line for the operator.

    >>> ModlensError("line one\nline two").message
    'line one line two'
    """

    exit_status: ClassVar[int] = 2
    """What the command line ends with: 2 wrong use, 3 input or output, 4 port."""

    def __init__(self, message: str) -> None:
        self.message = " ".join(message.split())
        super().__init__(self.message)


class ModlensWarning(UserWarning):
    """A recording or setting that can hardly be meant so; `warnings` filters it by this class."""


class UsageError(ModlensError):
    """A command or call that cannot be meant: wrong option, value out of range, unknown name.

    >>> UsageError("unknown unit 300; a unit is 0 to 255").exit_status
    2
    """


class SourceError(ModlensError):
    """An input cannot be read, or an output cannot be written.

    >>> SourceError("bus.log: no such file").exit_status
    3
    """

    exit_status = 3


class CaptureError(SourceError):
    """A recording is not what it claims to be; `offset` is the byte where reading stopped.

    >>> str(CaptureError("not a pcapng block", path="bus.pcapng", offset=24))
    'bus.pcapng: not a pcapng block at byte 24'
    """

    def __init__(self, message: str, *, path: Path, offset: int | None = None) -> None:
        self.path = os.fspath(path)
        self.offset = offset
        where = "" if offset is None else f" at byte {offset}"
        super().__init__(f"{self.path}: {message}{where}")


class ProfileError(ModlensError):
    """A profile, or a file of functions, says something that cannot be; `line` counts from 1.

    >>> str(ProfileError("unknown type 'u23'", path="meter.toml", line=7, key="type", hint="u32"))
    "meter.toml:7: type: unknown type 'u23'; did you mean 'u32'?"
    """

    def __init__(
        self,
        message: str,
        *,
        path: Path,
        line: int | None = None,
        key: str | None = None,
        hint: str | None = None,
    ) -> None:
        self.path = os.fspath(path)
        self.line = line
        self.key = key
        self.hint = hint
        self.mistakes: tuple[ProfileError, ...] = (self,)
        place = self.path if line is None else f"{self.path}:{line}"
        what = message if key is None else f"{key}: {message}"
        super().__init__(f"{place}: {what}{_question(hint)}")

    @classmethod
    def joined(cls, mistakes: Sequence[ProfileError]) -> ProfileError:
        """One error for all mistakes of a file, a line each; it has the first one's place."""
        first = mistakes[0]
        whole = cls("", path=first.path, line=first.line, key=first.key, hint=first.hint)
        whole.mistakes = tuple(mistakes)
        whole.message = "\n".join(one.message for one in mistakes)
        whole.args = (whole.message,)
        return whole


class FilterError(ModlensError):
    """A filter expression cannot be understood.

    `column` counts from 0, the message from 1, as editors do. `hint` is the nearest known name.
    """

    def __init__(
        self, message: str, *, text: str, column: int | None = None, hint: str | None = None
    ) -> None:
        self.text = text
        self.column = column
        self.hint = hint
        where = f"in {text!r}" if column is None else f"column {column + 1} of {text!r}"
        super().__init__(f"{message} ({where}){_question(hint)}")


class PortError(ModlensError):
    """A serial port or a connection fails: not there, in use, lost.

    >>> str(PortError("no such port; `modlens ports` lists them", port="/dev/ttyUSB9"))
    '/dev/ttyUSB9: no such port; `modlens ports` lists them'
    """

    exit_status = 4

    def __init__(self, message: str, *, port: str) -> None:
        self.port = port
        super().__init__(f"{port}: {message}")


def _question(hint: str | None) -> str:
    return "" if hint is None else f"; did you mean {hint!r}?"


for _error in (ModlensError, *ModlensError.__subclasses__()):
    # Tracebacks show the name that programs import.
    _error.__module__ = "modlens"
