"""Manual pages: `modlens(1)`, and `modlens-COMMAND(1)` for each command."""

from __future__ import annotations

from collections.abc import Iterator

from release.options import Command, Option

__all__ = ["overview", "page"]


def overview(commands: list[Command], version: str) -> str:
    """The page `modlens(1)`."""
    lines = [
        *_head("modlens", version),
        ".SH NAME",
        r"modlens \- a passive Modbus sniffer and protocol analyzer; it never transmits",
        ".SH SYNOPSIS",
        ".B modlens",
        r".I COMMAND\fR ...",
        ".br",
        ".B modlens",
        r".I FILE\fR|\fIPORT\fR ...",
        ".SH DESCRIPTION",
        "Decodes Modbus RTU, ASCII and TCP from serial lines that it listens to, and from",
        "recordings of any kind. A file in place of a command is decoded, a port is tapped.",
        ".SH COMMANDS",
    ]
    for one in commands:
        lines += [".TP", rf".BR modlens\-{_text(one.name)} (1)", _text(one.summary)]
    lines += [
        ".SH OPTIONS",
        ".TP",
        r".B \-\-no\-pager",
        "Never show output in a pager.",
        ".TP",
        r".B \-\-version",
        "Print the version.",
        ".SH EXIT STATUS",
        "0 done; 1 done, but --strict was given and something was damaged; 2 wrong use; 3 input",
        "unreadable or output not writable; 4 port trouble.",
        ".SH ENVIRONMENT",
        ".TP",
        ".BR MODLENS_PAGER ,\\  PAGER",
        "What shows output that is longer than the screen (less if neither is set).",
        ".TP",
        ".B NO_COLOR",
        "No colours.",
        ".SH SEE ALSO",
        *(rf".BR modlens\-{_text(one.name)} (1)" for one in commands),
    ]
    return "\n".join([*lines, ""])


def page(command: Command, version: str) -> str:
    """The page of a command."""
    name = f"modlens-{command.name}"
    lines = [
        *_head(name, version),
        ".SH NAME",
        rf"{_text(name)} \- {_text(command.summary)}",
        ".SH SYNOPSIS",
        rf"\fB{_text(command.usage.partition(' [')[0])}\fR [\fIOPTIONS\fR]"
        + "".join(rf" \fI{_text(one.value)}\fR" for one in command.options if not one.flags),
    ]
    for group in dict.fromkeys(one.group for one in command.options):
        lines.append(f".SH {_text(_TITLES.get(group, group)).upper()}")
        for one in command.options:
            if one.group == group:
                lines += _option(one)
    if command.epilog:
        lines += [".SH NOTES", ".nf", *map(_line, command.epilog.splitlines()), ".fi"]
    lines += [".SH SEE ALSO", ".BR modlens (1)"]
    return "\n".join([*lines, ""])


_TITLES = {"positional arguments": "arguments"}


def _head(name: str, version: str) -> list[str]:
    return [
        '.\\" Made of the parsers of modlens.',
        f'.TH "{_text(name).upper()}" 1 "" "modlens {version}" "modlens"',
    ]


def _option(option: Option) -> Iterator[str]:
    yield ".TP"
    value = rf" \fI{_text(option.value)}\fR" if option.value else ""
    if option.flags:
        yield ", ".join(rf"\fB{_text(flag)}\fR{value}" for flag in option.flags)
    else:
        yield value.strip()
    said = option.help.replace("%%", "%")
    if option.choices and option.choices[0] not in said:
        said = f"{said}: {', '.join(option.choices)}"
    yield _line(said)


def _line(text: str) -> str:
    """A line that troff does not take for a request."""
    said = _text(text)
    return rf"\&{said}" if said.startswith((".", "'")) else said


def _text(text: str) -> str:
    return text.replace("\\", r"\e").replace("-", r"\-")
