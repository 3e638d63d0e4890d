"""The pictures of reports in the documents show what the program makes now.

The words of a page are compared exactly. Of its pixels, since each machine has its own fonts, the
mean colours of squares are compared, of which a share may differ.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from docs.make.report_pictures import LOOKS, ROOT, description_of, draw, name_of

SQUARE = 20
"""Pixels of the side of a square: about a line of text."""

DIFFERENT = 24
"""Levels of 255 by which the mean colours of two squares differ visibly."""

MOST_DIFFERENT = 0.02
"""The share of squares that may differ. None do on the same machine; another verdict, plot or
layout changes more than a tenth of them."""

KEPT = ROOT / "docs" / "pictures"
NAMES = [name_of(*look) for look in LOOKS]


def squares(path: Path) -> NDArray[np.float64]:
    """The mean colour of each square of a picture."""
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB"), dtype=np.float64)
    height, width = (length - length % SQUARE for length in pixels.shape[:2])
    cut = pixels[:height, :width].reshape(height // SQUARE, SQUARE, width // SQUARE, SQUARE, 3)
    return np.asarray(cut.mean(axis=(1, 3)), dtype=np.float64)


def difference(one: Path, other: Path) -> float:
    """The share of squares that look different; 1 where the pictures are of different sizes."""
    first, second = squares(one), squares(other)
    if first.shape != second.shape:
        return 1.0
    return float((np.abs(first - second).max(axis=2) > DIFFERENT).mean())


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of pictures drawn now."""
    folder = tmp_path_factory.mktemp("pictures")
    draw(folder)
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_a_picture_is_what_the_report_looks_like(name: str, drawn: Path) -> None:
    """`make pictures` draws it again, for a person to look at."""
    assert description_of(KEPT / name) == description_of(drawn / name)
    assert difference(KEPT / name, drawn / name) <= MOST_DIFFERENT


def test_pictures_that_differ_are_told_apart(drawn: Path) -> None:
    """Light from dark, a screen from a telephone, and a picture of which a tenth is gone."""
    light, dark, narrow, _ = (drawn / name for name in NAMES)
    assert difference(light, dark) > 0.5
    assert difference(light, narrow) == 1.0
    with Image.open(light) as picture:
        height = picture.height // 10
        picture.paste("black", (0, 0, picture.width, height))
        picture.save(drawn / "changed.png")
    assert difference(light, drawn / "changed.png") > 0.05
