"""The terminal: width, colour, and nothing from a recording that could move the cursor."""

from __future__ import annotations

import io
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from analyzer.views.screen import Screen, fit, visible, width_of
from analyzer.visible import for_terminal


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self) -> bool:
        """It is."""
        return True


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> tuple[Screen, Terminal]:
    """A screen on a terminal of 256 colours."""
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    stream = Terminal()
    return Screen(stream), stream


def test_colour_on_a_terminal(screen: tuple[Screen, Terminal]) -> None:
    """A terminal gets colour, and the text unchanged."""
    screen[0].line("ok", "good")
    assert screen[1].getvalue() == "\x1b[32mok\x1b[0m\n"


def test_no_colour_where_it_is_not_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    """With `NO_COLOR` there is no colour."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm-256color")
    stream = Terminal()
    Screen(stream).line("bad", "bad")
    assert "31" not in stream.getvalue()


def test_no_escape_into_a_file() -> None:
    """A stream that is no terminal gets text and nothing else, without spaces at the end."""
    stream = io.StringIO()
    Screen(stream).lines([[("bad   ", "bad")], [("[bold]", "head")]])
    assert stream.getvalue() == "bad\n[bold]\n"


def test_the_width_is_that_of_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a terminal the width is that of `COLUMNS`, or 80."""
    monkeypatch.delenv("COLUMNS", raising=False)
    assert Screen(io.StringIO()).width == 80
    monkeypatch.setenv("COLUMNS", "133")
    assert Screen(io.StringIO()).width == 133
    for nonsense in ("0", "²", "wide", ""):
        monkeypatch.setenv("COLUMNS", nonsense)
        assert Screen(io.StringIO()).width == 80


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("pump 1", "pump 1"),
        ("Zähler µ", "Zähler µ"),
        ("a\x1b[2Jb", r"a\x1b[2Jb"),
        ("a\r\nb\x00\x7f\x9b", r"a\r\nb\x00\x7f\x9b"),
        ("a\u202eb\u2028\ufeff", r"a\u202eb\u2028\ufeff"),
    ],
)
def test_control_characters_are_spelled_out(text: str, shown: str) -> None:
    """Nothing moves the cursor, hides letters or turns them round."""
    assert visible(text) == shown


@given(st.text())
def test_what_is_visible_is_printable(text: str) -> None:
    """No control character is left, whatever the recording held."""
    assert not set(visible(text)) & {chr(code) for code in (*range(32), *range(127, 160))}


def test_what_is_escaped_is_not_printable_to_python() -> None:
    """`visible` asks Python first, character by character the same as the table would say."""
    every = [chr(code) for code in range(sys.maxunicode + 1)]
    escaped = {one for one in every if visible(f"{one}\x1b") != f"{one}\\x1b"}
    assert {one for one in every if visible(one) != one} == escaped
    lines = {one for one in every if for_terminal(one) != one}
    assert lines == escaped - {"\t", "\n"}
    assert for_terminal("a\r\nb\n\tc\r") == "a\r\nb\n\tc\\r"


@given(st.text(), st.integers(1, 30))
def test_a_text_fits_exactly(text: str, width: int) -> None:
    """A text is cut or padded to the exact width, also with wide characters."""
    assert cell_len(fit(visible(text), width)) == width


def test_width_counts_columns() -> None:
    """East Asian characters take two columns."""
    assert (width_of("abc"), width_of("温度")) == (3, 4)
