"""Errors are one line, carry their exit status, and hang together."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissectors import errors
from dissectors.errors import (
    CaptureError,
    FilterError,
    ModlensError,
    PortError,
    ProfileError,
    SourceError,
    UsageError,
)


@pytest.mark.parametrize(
    ("error", "status", "text"),
    [
        (UsageError("no such option"), 2, "no such option"),
        (SourceError("x.log: no such file"), 3, "x.log: no such file"),
        (
            CaptureError("cut short", path=Path("x.pcapng"), offset=7),
            3,
            "x.pcapng: cut short at byte 7",
        ),
        (CaptureError("empty", path="x.pcapng"), 3, "x.pcapng: empty"),
        (ProfileError("no points", path="m.toml"), 2, "m.toml: no points"),
        (
            ProfileError("unknown type", path="m.toml", line=3, key="type"),
            2,
            "m.toml:3: type: unknown type",
        ),
        (FilterError("cut short", text="unit =="), 2, "cut short (in 'unit ==')"),
        (
            FilterError("unknown", text="untis", column=0, hint="units"),
            2,
            "unknown (column 1 of 'untis'); did you mean 'units'?",
        ),
        (PortError("in use", port="COM3"), 4, "COM3: in use"),
    ],
)
def test_messages_and_statuses(error: ModlensError, status: int, text: str) -> None:
    """What, where, what to do; and the exit status of the command line."""
    assert str(error) == error.message == text
    assert error.exit_status == status


def test_a_message_is_one_line() -> None:
    """Line ends of a wrapped error never reach the operator's terminal."""
    assert str(UsageError("one\n  two\r\nthree")) == "one two three"


def test_every_error_is_a_modlens_error() -> None:
    """One except clause catches them all; a damaged capture is a source error."""
    classes = [getattr(errors, name) for name in errors.__all__]
    raised = [cls for cls in classes if not issubclass(cls, Warning)]
    assert len(raised) > 3
    assert all(issubclass(cls, ModlensError) for cls in raised)
    assert issubclass(CaptureError, SourceError)
