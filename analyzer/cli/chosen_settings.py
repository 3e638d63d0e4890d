"""The settings that the options of a command choose (the options: `analyzer.cli.parser`)."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import _modlens
from analyzer.cli.selection import selected_rows
from analyzer.durations import parse_duration
from analyzer.line import EXAMPLE, Line, parse_line
from analyzer.settings import Settings
from analyzer.silence_limits import silence_limits
from analyzer.times import check_date, utc_offset_changes
from dissectors.errors import ProfileError, SourceError, UsageError

if TYPE_CHECKING:
    from analyzer.bus_file import Bus
    from analyzer.profiles import Binding

__all__ = ["load_dialects", "load_functions", "settings"]

_LAST_PORT = 0xFFFF
_MAX_TIMEOUT_S = 3600


def settings(options: argparse.Namespace) -> Settings:
    """The settings of line and decoding from the parsed options.

    `UsageError` or `ProfileError` for values that are not possible.
    """
    bus = None if options.bus is None else _bus(options.bus)
    profiles = _profiles(options.profiles)
    if bus is not None:
        profiles = (*bus.profiles, *profiles)
    line = _line(options) or (None if bus is None else bus.line)
    return Settings(
        line=line,
        mode=bus.mode if bus is not None and options.mode == "auto" else options.mode,
        timeout_ns=None
        if options.timeout is None
        else parse_duration(options.timeout, "--timeout", _MAX_TIMEOUT_S),
        functions=_functions(options.functions, profiles),
        profiles=profiles,
        silence_ns=silence_limits(
            options.segmentation, options.t35, options.t15, line, prefix="--"
        ),
        ports=_ports(options.tcp_ports),
        channels=tuple(options.channels.split(",")) if options.channels else None,
        dialects=load_dialects(getattr(options, "dialects", [])),
        zone=utc_offset_changes(getattr(options, "timezone", None)),
        date=check_date(getattr(options, "date", None)),
        select=selected_rows(options),
    )


def _bus(text: str) -> Bus:
    from analyzer.bus_file import choose_bus  # noqa: PLC0415 - where there is a bus file only

    return choose_bus(text)


def _profiles(words: list[str]) -> tuple[Binding, ...]:
    if not words:
        return ()
    from analyzer.profiles import parse_binding  # noqa: PLC0415 - where there is a profile only

    return tuple(parse_binding(word) for word in words)


def _functions(names: list[str], profiles: Sequence[Binding]) -> _modlens.Functions:
    functions = load_functions(names)
    if not profiles:
        return functions
    from analyzer.profiles import with_vendor_functions  # noqa: PLC0415 - as above

    return with_vendor_functions(functions, profiles)


def load_dialects(names: list[str]) -> _modlens.Dialects | None:
    """The table of text dialects with the rows of these files; None where no file is given."""
    if not names:
        return None
    dialects = _modlens.Dialects()
    for name in names:
        try:
            dialects.load(_text_of(name), name)
        except (OSError, UnicodeError) as error:
            raise SourceError(f"--dialects {name}: cannot be read: {_reason_of(error)}") from error
        except ValueError as error:
            raise ProfileError(str(error).removeprefix(f"{name}: "), path=name) from error
    return dialects


def load_functions(names: list[str]) -> _modlens.Functions:
    """The table of functions with the rows of these vendors (by name) and files (by path)."""
    functions = _modlens.Functions()
    for name in names:
        has_ending = bool(os.path.splitext(name)[1])
        try:
            if has_ending or os.path.basename(name) != name:
                functions.load(_text_of(name), name)
            else:
                functions.load_vendor(name)
        except (OSError, UnicodeError) as error:
            raise SourceError(f"--functions {name}: cannot be read: {_reason_of(error)}") from error
        except ValueError as error:
            if has_ending:
                raise ProfileError(str(error).removeprefix(f"{name}: "), path=name) from error
            raise UsageError(f"--functions {name}: {error}") from error
    return functions


def _text_of(path: str) -> str:
    with open(path, encoding="utf-8") as file:
        return file.read()


def _reason_of(error: OSError | UnicodeError) -> str:
    return (isinstance(error, OSError) and error.strerror) or str(error)


def _line(options: argparse.Namespace) -> Line | None:
    """The line settings of `--line`, or of its parts; None where neither is given.

    With `--mode ascii` a character has 7 data bits by default, otherwise 8; the specification's
    default parity is even (Modbus over Serial Line V1.02, section 2.5.1).
    """
    parts = (options.baud, options.bits, options.parity, options.stop)
    if options.line is not None:
        if any(part is not None for part in parts):
            raise UsageError(
                "--line gives all settings; leave out --baud, --bits, --parity and --stop"
            )
        return parse_line(options.line)
    if options.baud is None:
        if any(part is not None for part in parts):
            raise UsageError(f"--baud is missing; or give all settings as --line {EXAMPLE}")
        return None
    return Line(
        options.baud,
        options.bits or (7 if options.mode == "ascii" else 8),
        (options.parity or "E").upper()[:1],
        options.stop or 1,
    )


def _ports(words: list[str]) -> tuple[int, ...] | None:
    """The ports of `--port`; None where the option is not given, an empty tuple for `any`.

    >>> _ports(["502,1502", "503"]), _ports(["any"]), _ports([])
    ((502, 1502, 503), (), None)
    """
    ports = [word.strip() for text in words for word in text.split(",")]
    if "any" in ports:
        return ()
    for port in ports:
        if not (port.isdecimal() and 0 < int(port) <= _LAST_PORT):
            raise UsageError(f"--port {port}: use port numbers up to {_LAST_PORT}, or any")
    return tuple(map(int, ports)) or None
