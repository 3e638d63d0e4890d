"""Logs in every dialect, written by a writer that shares nothing with the reader."""

from __future__ import annotations

import json
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import _modlens
from tests.support.logs import NOON, RESOLUTION, SINGLE_LINE, WRITERS, LogEntry, delivered, write

TABLE = _modlens.Dialects()
ROWS = {row["name"]: row for row in json.loads(TABLE.rows())}
STEP = 1_000_000_000
NO_SIDES = {name for name, row in ROWS.items() if all(side == "either" for side, _ in row["bytes"])}
"""Dialects that do not say who speaks."""

MASTER_ONLY = {
    name for name, row in ROWS.items() if {side for side, _ in row["bytes"]} == {"sent", "either"}
}
"""Dialects that say who speaks of what the master sends only."""

SHORTEST = 4
"""An RTU frame is not shorter; some rows take no fewer bytes for a record."""

records = st.lists(
    st.tuples(st.integers(0, 2 * STEP), st.booleans(), st.binary(min_size=SHORTEST, max_size=40)),
    min_size=1,
    max_size=5,
)


def said(drawn: list[tuple[int, bool, bytes]]) -> list[LogEntry]:
    """Records with rising times, at least one second apart."""
    moments, now = [], NOON
    for pause, sent, data in drawn:
        moments.append(LogEntry(now, sent, data))
        now += STEP + pause
    return moments


def runs(strings: list[tuple[str | None, bytes]]) -> list[tuple[str | None, bytes]]:
    """Neighbours of the same side joined."""
    joined: list[tuple[str | None, bytes]] = []
    for side, data in strings:
        if joined and joined[-1][0] == side:
            joined[-1] = (side, joined[-1][1] + data)
        else:
            joined.append((side, data))
    return joined


def side_of(name: str, one: LogEntry) -> str | None:
    """What the dialect reports about the sender."""
    if name in NO_SIDES or (name in MASTER_ONLY and not one.sent):
        return None
    return "sent" if one.sent else "received"


def test_every_dialect_has_a_writer() -> None:
    """Every dialect has a writer, without which it would not be tested."""
    assert set(WRITERS) == set(ROWS)


@pytest.mark.parametrize("name", WRITERS)
def test_any_bytes_come_back(name: str) -> None:
    """In order, with their sides, and nothing is left over."""

    @settings(max_examples=12, deadline=None)
    @given(records)
    def check(drawn: list[tuple[int, bool, bytes]]) -> None:
        moments = said(drawn)
        found, _, unparsed = TABLE.read(name, write(name, moments).encode())
        wanted = [(side_of(name, one), delivered(name, one.data)) for one in moments]
        assert runs([(side, data) for _, side, _, data in found]) == runs(wanted)
        assert unparsed == 0

    check()


@pytest.mark.parametrize("name", RESOLUTION)
def test_times_come_back(name: str) -> None:
    """As finely as the dialect prints them; a date and a zone are other tests' matter."""

    @settings(max_examples=6, deadline=None)
    @given(records.filter(lambda drawn: len(drawn) > 1))
    def check(drawn: list[tuple[int, bool, bytes]]) -> None:
        moments = said(drawn)
        found, _, _ = TABLE.read(name, write(name, moments).encode())
        times = sorted({time for _, _, time, _ in found if time is not None})
        floored = sorted({one.ns - one.ns % RESOLUTION[name] for one in moments})
        steps = [later - earlier for earlier, later in pairwise(times)]
        assert steps == [later - earlier for earlier, later in pairwise(floored)]

    check()


garbage = st.one_of(
    st.binary(max_size=40).map(lambda data: data.replace(b"\n", b" ")),
    st.text(max_size=30).map(lambda text: text.replace("\n", " ").encode("utf-8", "replace")),
    st.just(b"-- interrupted --"),
).filter(lambda line: not line.strip().isalpha())
"""A word above bytes may be a label that says who sent them, such as `receive`, and is read."""


@pytest.mark.parametrize("name", SINGLE_LINE)
def test_no_line_is_lost(name: str) -> None:
    """Lines cut short, doubled, or of other things: delivered, left out or counted."""

    @settings(max_examples=12, deadline=None)
    @given(records, st.data())
    def check(drawn: list[tuple[int, bool, bytes]], data: st.DataObject) -> None:
        lines: list[tuple[bytes, bytes | None]] = []
        for one in said(drawn):
            whole = write(name, [one]).encode().rstrip(b"\n")
            what = data.draw(st.sampled_from(["whole", "cut", "twice", "garbage"]))
            if what == "cut":
                lines.append((whole[: data.draw(st.integers(0, len(whole)))], None))
            elif what == "garbage":
                lines.append((data.draw(garbage), None))
            else:
                lines += [(whole, delivered(name, one.data))] * (2 if what == "twice" else 1)
        text = b"\n".join(line for line, _ in lines) + b"\n"
        found, left_out, unparsed = TABLE.read(name, text)
        for number, (_, wire) in enumerate(lines, 1):
            if wire is not None:
                got = b"".join(piece for line, _, _, piece in found if line == number)
                assert got == wire or any(line == number for line, _, _ in left_out)
        told = {line for line, _, _, _ in found} | {line for line, _, _ in left_out}
        countable = [number for number, (line, _) in enumerate(lines, 1) if is_countable(line)]
        silent = [number for number in countable if number not in told]
        assert len(silent) == unparsed

    check()


BLANKS = " \t\r\f\u00a0\u202f\u3000" + "".join(map(chr, range(0x2000, 0x200C)))
"""Typographers' ones among them, as pasted text has them."""


def is_countable(line: bytes) -> bool:
    """Neither blank nor a comment, as the README has them."""
    text = line.decode("utf-8", "surrogateescape").strip(BLANKS)
    ascii_form = "".join(chr(ord(c) - 0xFEE0) if 0xFF01 <= ord(c) <= 0xFF5E else c for c in text)
    return bool(text) and not ascii_form.startswith(("#", "//", ";", "```"))


@pytest.mark.parametrize("line", ["\u00a0", "\u3000 ", "\uff03 a comment", "\u2003// one more"])
def test_blanks_of_typographers_are_blank(line: str) -> None:
    """A line of them is none, and what follows them begins the line."""
    _, _, unparsed = TABLE.read("hex", f"{line}\n".encode())
    assert (unparsed, is_countable(line.encode())) == (0, False)


@pytest.mark.parametrize("name", WRITERS)
def test_damaged_files_do_not_crash(name: str) -> None:
    """Cut anywhere, a part twice, bytes between: what is read is still made of lines."""

    @settings(max_examples=6, deadline=None)
    @given(records, st.data())
    def check(drawn: list[tuple[int, bool, bytes]], data: st.DataObject) -> None:
        text = write(name, said(drawn)).encode()
        places = sorted(data.draw(st.integers(0, len(text))) for _ in range(3))
        a, b, c = places
        damaged = text[:b] + data.draw(garbage) + text[a:c] + data.draw(st.binary(max_size=20))
        found, left_out, unparsed = TABLE.read(name, damaged)
        lines = damaged.count(b"\n") + 1
        assert all(1 <= line <= lines for line, _, _, _ in found)
        assert all(1 <= line <= lines for line, _, _ in left_out)
        assert unparsed <= lines

    check()
