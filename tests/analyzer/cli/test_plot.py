"""`modlens plot`: values over time as dots and as a picture, and time series in `modlens stats`."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy
import pytest

from tests.conftest import CAPTURES, Modlens, without

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
    # Times of the answers, which carry the values.
    assert rows[-1].split() == ["2023-11-14", "22:13:20.100", "22:13:23.100", "UTC"]


def test_a_picture_has_a_line_for_each_value(modlens: Modlens, tmp_path: Path) -> None:
    """At the ends of the frame are first and last value."""
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


def test_names_with_blanks_units_and_gaps(modlens: Modlens, tmp_path: Path) -> None:
    """A name with a blank is no condition; its unit is on the y axis, the clock on the x axis."""
    path = write_series(tmp_path / "bus.jsonl")
    lines = path.read_text("utf-8").splitlines()
    # The same again an hour later: in between nothing was heard.
    later = [line.replace("17000000", "17000036") for line in lines]
    path.write_text("\n".join((*lines, *later)) + "\n", encoding="utf-8")
    profile = tmp_path / "room.toml"
    register = 'at = "hr:107"\nname = "Room temperature"\nunit = "degC"\nscale = 0.1\n'
    profile.write_text(f"profile = 1\n[[registers]]\n{register}")
    words = ("plot", path, "Room temperature", "--profile", profile)
    assert modlens(*words).out.splitlines()[0] == "Room temperature (degC)"
    target = tmp_path / "plot.svg"
    done = modlens(*words, "-o", target)
    assert done.status == 0, done.err
    drawn = target.read_text("utf-8")
    assert len(re.findall(r"<polyline", drawn)) == 2
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", drawn)
    assert texts[:3] == ["3", "0", "degC"]
    assert "22:30" in texts
    assert "2023-11-14 UTC" in texts
    assert texts[-1] == "Room temperature (degC)"


def test_a_picture_as_pixels(modlens: Modlens, tmp_path: Path) -> None:
    """A PNG in which the line is where its values are; a name with dollars is no formula."""
    if importlib.util.find_spec("matplotlib") is None:
        without("matplotlib")
    from matplotlib import image  # noqa: PLC0415 - an extra

    path = write_series(tmp_path / "bus.jsonl")
    profile = tmp_path / "meter.toml"
    profile.write_text('profile = 1\n[[registers]]\nat = "hr:107"\nname = "$a_$"\n')
    target = tmp_path / "plot.png"
    done = modlens("plot", path, "address == 107", "--profile", profile, "-o", target)
    assert done.status == 0, done.err
    pixels = image.imread(target)
    # Twice 1000 by 380. A line of #2a78c8 from the lower left to the upper right of its frame.
    assert pixels.shape[:2] == (760, 2000)
    distance = numpy.abs(pixels[:640, :, :3] - [0x2A / 255, 0x78 / 255, 0xC8 / 255])
    blue = numpy.all(distance < 0.05, axis=2)
    middle = [blue[:, x].nonzero()[0].mean() for x in (400, 1000, 1600)]
    assert middle == sorted(middle, reverse=True)
    assert middle[1] == pytest.approx((20 + 320) / 2 * 2, abs=20)


def test_without_the_extra_it_is_told_how_to_get_it(modlens: Modlens, tmp_path: Path) -> None:
    """The package is named, and what works without it."""
    path = write_series(tmp_path / "bus.jsonl")
    hidden = tmp_path / "hidden" / "matplotlib"
    hidden.mkdir(parents=True)
    (hidden / "__init__.py").write_text("raise ImportError('not here')\n")
    target = tmp_path / "plot.png"
    done = modlens("plot", path, "address == 107", "-o", target, PYTHONPATH=str(hidden.parent))
    assert done.status == 2
    assert "needs a package" in done.err
    assert "matplotlib; SVG needs none" in done.err
    assert not target.exists()


def test_what_cannot_be_drawn_is_told(modlens: Modlens, tmp_path: Path) -> None:
    """Nothing, too much, and a picture of another kind."""
    nothing = modlens("plot", PLANT, "voltage", "--line", "57600-8E1")
    assert (nothing.status, "no reading with a number" in nothing.err) == (2, True)
    many = modlens("plot", PLANT, "unit == 9", "--line", "57600-8E1")
    assert (many.status, "8 at most are drawn" in many.err) == (2, True)
    other = modlens("plot", PLANT, "unit == 9", "-o", tmp_path / "plot.gif")
    assert (other.status, "name it .svg or .png" in other.err) == (2, True)


def test_statistics_show_the_course(modlens: Modlens) -> None:
    """Load and failures of the line, and how fast each unit answers, in a line each."""
    done = modlens("stats", DISTURBED, "--line", "19200-8E1")
    lines = [
        line for line in done.out.splitlines() if line.startswith(("load", "failed", "unit 1"))
    ]
    assert [line.split()[0] for line in lines] == ["load", "failed", "unit"]
    assert all(any(one in line for one in "▁▂▃▄▅▆▇█") for line in lines)
    assert lines[1].endswith("11")


def test_a_name_with_blanks_of_two_units_is_two_series(modlens: Modlens, tmp_path: Path) -> None:
    """Each unit has its own line, with its number in front of the name."""
    profile = tmp_path / "room.toml"
    profile.write_text(
        'profile = 1\n[device]\nid = "room"\n'
        '[[registers]]\nat = "hr:0"\nname = "Room temperature"\ntype = "u16"\n',
        encoding="utf-8",
    )
    recording = CAPTURES / "pymodbus_two_units" / "recording.jsonl"
    done = modlens("plot", recording, "Room temperature", "--profile", profile)
    assert done.status == 0, done.err
    heads = [line for line in done.out.splitlines() if "Room" in line]
    assert heads == ["unit 1 Room temperature", "unit 2 Room temperature"]
    one = modlens("plot", recording, "unit == 1 and address == 0", "--profile", profile)
    assert one.out.splitlines()[0] == "Room temperature"
