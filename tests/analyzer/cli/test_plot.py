"""`modlens plot`: values over time as dots and as a picture, and courses in `modlens stats`."""

from __future__ import annotations

import re
from pathlib import Path

from tests.conftest import CAPTURES, Modlens

PLANT = CAPTURES / "pymodbus_plant" / "recording.jsonl"
DISTURBED = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"


def write_series(path: Path) -> Path:
    """A register that is read as 0, 10, 20, 30, a second apart."""
    from _modlens import crc16  # noqa: PLC0415 - for the checksums only

    def framed(body: bytes) -> str:
        return (body + crc16(body).to_bytes(2, "little")).hex()

    lines = []
    for number in range(4):
        request = framed(bytes([1, 3, 0, 107, 0, 1]))
        answer = framed(bytes([1, 3, 2, 0, 10 * number]))
        lines.append(f'{{"t": {1_700_000_000 + number}, "hex": "{request}"}}')
        lines.append(f'{{"t": {1_700_000_000 + number}.1, "hex": "{answer}"}}')
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_rising_value_rises(modlens: Modlens, tmp_path: Path) -> None:
    """From the lower left to the upper right, with its extremes beside it."""
    path = write_series(tmp_path / "bus.jsonl")
    done = modlens("plot", path, "unit == 1 and address == 107", COLUMNS="40")
    assert done.status == 0, done.err
    head, *rows = done.out.splitlines()
    assert head == "unit 1 holding register 107"
    drawn = [row[13:] for row in rows[:12]]
    at = [max(i for i, one in enumerate(row) if one != "\u2800") for row in drawn]
    assert at == sorted(at, reverse=True)
    assert (rows[0].split()[0], rows[11].split()[0]) == ("30", "0")
    assert rows[-1].split() == ["0.1", "3.1", "s"]  # of the answers, which carry the values


def test_a_picture_has_a_line_for_each_value(modlens: Modlens, tmp_path: Path) -> None:
    """At the ends of the frame stand first and last value."""
    path = write_series(tmp_path / "bus.jsonl")
    target = tmp_path / "plot.svg"
    assert modlens("plot", path, "address == 107", "-o", target).status == 0
    (points,) = re.findall(r'points="([^"]*)"', target.read_text("utf-8"))
    pairs = [tuple(map(float, pair.split(","))) for pair in points.split()]
    assert len(pairs) == 4
    # 1000 by 360 with margins of 80, 20, 60 and 40: thirds of 860 and of 300.
    assert pairs[0] == (80.0, 320.0)
    assert pairs[3] == (940.0, 20.0)
    assert pairs[1][0] == 366.7


def test_what_cannot_be_drawn_is_told(modlens: Modlens, tmp_path: Path) -> None:
    """Nothing, too much, and a picture of another kind."""
    nothing = modlens("plot", PLANT, "voltage", "--line", "57600-8E1")
    assert (nothing.status, "no reading with a number" in nothing.err) == (2, True)
    many = modlens("plot", PLANT, "unit == 9", "--line", "57600-8E1")
    assert (many.status, "8 at most are drawn" in many.err) == (2, True)
    other = modlens("plot", PLANT, "unit == 9", "-o", tmp_path / "plot.gif")
    assert (other.status, "name it .svg" in other.err) == (2, True)


def test_statistics_show_the_course(modlens: Modlens) -> None:
    """Load and failures of the line, and how fast each unit answers, in a line each."""
    done = modlens("stats", DISTURBED, "--line", "19200-8E1")
    lines = [
        line for line in done.out.splitlines() if line.startswith(("load", "failed", "unit 1"))
    ]
    assert [line.split()[0] for line in lines] == ["load", "failed", "unit"]
    assert all(any(one in line for one in "▁▂▃▄▅▆▇█") for line in lines)
    assert lines[1].endswith("11")
