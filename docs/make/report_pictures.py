"""The pictures of a report in the documents: `python -m docs.make.report_pictures`.

Each holds the words of the page as its description: a test compares these exactly, and the pixels
roughly.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from tests.support.browser import running

ROOT = Path(__file__).parents[2]
RECORDING = "captures/pymodbus_disturbed/recording.jsonl"
LOOKS = ((1280, "light", ""), (1280, "dark", ""), (390, "light", ""), (703, "light", "print"))
HEIGHT = 1500
SECONDS_TO_DRAW = 0.5
DESCRIPTION = "Description"


def main() -> None:
    """Write a picture of each look."""
    draw(ROOT / "docs" / "pictures")


def draw(target: Path) -> None:
    """Write the pictures into this folder."""
    with tempfile.TemporaryDirectory() as folder, running(Path(folder)) as browser:
        page = Path(folder) / "report.html"
        words = [
            "report",
            RECORDING,
            "--line",
            "19200-8E1",
            "--title",
            "Pump station",
            "-o",
            str(page),
        ]
        subprocess.run([sys.executable, "-m", "analyzer", *words], cwd=ROOT, check=True)
        for width, scheme, media in LOOKS:
            browser.shape(width, HEIGHT, scheme=scheme, media=media)
            browser.open(page)
            time.sleep(SECONDS_TO_DRAW)
            path = target / name_of(width, scheme, media)
            browser.picture(path)
            describe(path, browser.run("return document.querySelector('main').innerText"))


def describe(path: Path, words: str) -> None:
    """Write words into a picture, beside its pixels."""
    description = PngInfo()
    description.add_itxt(DESCRIPTION, " ".join(words.split()), zip=True)
    with Image.open(path) as picture:
        picture.load()
        picture.save(path, pnginfo=description, optimize=True)


def description_of(path: Path) -> str:
    """The words in a picture."""
    with Image.open(path) as picture:
        picture.load()
        return str(picture.info[DESCRIPTION])


def name_of(width: int, scheme: str, media: str) -> str:
    """The name of the file of a look."""
    return f"report-{media}.png" if media else f"report-{width}-{scheme}.png"


if __name__ == "__main__":
    main()
