r"""Text from recordings, devices and file names as a terminal may get it.

Such texts are not trusted: a device name may hold an escape sequence that clears the screen. This
module alone decides which characters reach a terminal; the core's `view` has the same rule for the
tables that it draws. Files get every character as it is.

>>> visible("pump\x1b[2J")
'pump\\x1b[2J'
"""

from __future__ import annotations

import functools

__all__ = ["for_terminal", "spreadsheet_cell", "visible"]


@functools.cache
def _escapes() -> dict[int, str]:
    """Character -> how it is written instead. Two thousand, made when one is needed."""
    return {
        code: ascii(chr(code))[1:-1]
        for code in (
            *range(0x20),
            *range(0x7F, 0xA0),
            0xAD,  # a soft hyphen
            0x61C,  # invisible marks of direction
            0x180E,
            *range(0x200B, 0x2010),
            *range(0x2028, 0x202F),
            *range(0x2060, 0x2070),
            *range(0xD800, 0xE000),  # what file names hold that are no text
            0xFEFF,
            *range(0xE0000, 0xE0080),  # tags
        )
    }


@functools.cache
def _line_escapes() -> dict[int, str]:
    """The same without what ends lines and aligns them."""
    return {code: text for code, text in _escapes().items() if chr(code) not in "\t\n"}


def visible(text: str) -> str:
    """Escape everything in a text that could move the cursor or hide characters."""
    # What Python calls printable has no such character; the table of these takes milliseconds.
    return text if text.isprintable() else text.translate(_escapes())


def for_terminal(lines: str) -> str:
    r"""Escape as `visible` does, but keep tabs and the ends of lines (LF, and CR LF of CSV).

    >>> for_terminal("unit\tname\r\n1\tpump\r\x9b2J\n")
    'unit\tname\r\n1\tpump\\r\\x9b2J\n'
    """
    if lines.replace("\n", "").replace("\t", "").isprintable():
        return lines
    return "\r\n".join(part.translate(_line_escapes()) for part in lines.split("\r\n"))


def spreadsheet_cell(value: object) -> object:
    """Return a cell for CSV or Markdown that a spreadsheet does not take for a formula.

    >>> spreadsheet_cell("=1+1"), spreadsheet_cell([1, 2]), spreadsheet_cell(None)
    ("'=1+1", '1 2', '')
    """
    if isinstance(value, list):
        return " ".join(map(str, value))
    if isinstance(value, str):
        shown = visible(value)
        return f"'{shown}" if shown.startswith(("=", "+", "-", "@", "\t", "\r")) else shown
    return "" if value is None else value
