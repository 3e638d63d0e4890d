"""The pictures of a report in the documents: `python -m docs.make.report_pictures`."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.support.browser import running

ROOT = Path(__file__).parents[2]
RECORDING = "captures/pymodbus_disturbed/recording.jsonl"
LOOKS = ((1280, "light", ""), (1280, "dark", ""), (390, "light", ""), (703, "light", "print"))
HEIGHT = 1500
SECONDS_TO_DRAW = 0.5


def main() -> None:
    """Write a picture of each look."""
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
            name = f"report-{media}.png" if media else f"report-{width}-{scheme}.png"
            browser.picture(ROOT / "docs" / "pictures" / name)


if __name__ == "__main__":
    main()
