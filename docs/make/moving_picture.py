"""Draws the moving picture of the README from the real program: `make pictures`.

Three commands run one after the other: a tap that finds the line settings of a simulated line, the
doctor, and a report. The result is one SVG with CSS animation, without script and without fonts
from elsewhere. Where animation is unwanted (`prefers-reduced-motion`), it shows the doctor.
"""

from __future__ import annotations

import html
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.style import Style
from rich.terminal_theme import DIMMED_MONOKAI
from rich.text import Text

from docs.make.simulated_port import SimulatedPort

__all__ = ["PICTURE", "Scene", "drawn", "scenes", "words_in"]

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs" / "pictures" / "first-minute.svg"
COLUMNS, LINES = 88, 22
TAP_ROWS = 8

CAPTURE = ROOT / "captures" / "pymodbus_dead_unit" / "recording.jsonl"
PORT = "/dev/ttyUSB0"

COMMAND_S, LINE_S, END_S = 1.2, 0.12, 3.5
"""Seconds for a command to be read, for each line to appear, and until the next scene."""

CHAR_W, LINE_H, FONT = 8.43, 19, 14
_LETTERS = re.compile(r"[A-Za-z_]{2,}")


@dataclass(frozen=True, slots=True)
class Scene:
    """Holds a command as people type it, and what the program printed (with colours)."""

    command: str
    output: str

    def lines(self) -> list[Text]:
        """Returns the lines of the screen: the prompt, the output, and what is left out."""
        text = Text.from_ansi(self.output.rstrip())
        wrapped = text.wrap(Console(file=io.StringIO(), width=COLUMNS), COLUMNS)
        prompt = Text.assemble(("$ ", "bold green"), (self.command, "bold"))
        lines = [prompt, *wrapped]
        return lines if len(lines) <= LINES else [*lines[: LINES - 1], Text("...")]


def scenes() -> list[Scene]:
    """Runs the three commands."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(CAPTURE, folder / "bus.jsonl")
        doctor = "modlens doctor bus.jsonl --line 57600-8E1"
        report = "modlens report bus.jsonl --line 57600-8E1 -o report.html"
        return [
            _tap(),
            *(Scene(one, _run(one.split()[1:], folder)) for one in (doctor, report)),
        ]


def _tap() -> Scene:
    """Taps the simulated line until some rows are printed, then presses Ctrl-C."""
    with SimulatedPort(CAPTURE.with_name("frames.jsonl"), "57600-8E1") as port:
        shown = _run(["tap", port.name], ROOT, stop_after=TAP_ROWS)
    # Columns stay aligned: the name shown may be longer than that of the pty.
    longer = " " * (len(PORT) - len(port.name))
    shown = shown.replace(port.name + longer + " ", PORT + " ").replace(port.name, PORT)
    return Scene(f"modlens tap {PORT}", shown)


def _run(words: Sequence[str], folder: Path, stop_after: int = 0) -> str:
    """Returns what a command prints on a terminal; sends Ctrl-C after so many rows."""
    from tests.support.printed import printed  # noqa: PLC0415 - the tests are beside the tree

    env = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "COLUMNS")}
    env |= {"TERM": "xterm-256color", "TZ": "UTC", "PYTHONIOENCODING": "utf-8"}
    env |= {"MODLENS_PAGER": "", "PYTHONPATH": str(ROOT)}
    interrupted = False

    def watch(shown: bytes, running: subprocess.Popen[bytes]) -> None:
        nonlocal interrupted
        if (
            stop_after
            and not interrupted
            and len(_rows(shown.decode("utf-8", "replace"))) >= stop_after
        ):
            interrupted = True
            running.send_signal(signal.SIGINT)

    command = [sys.executable, "-m", "analyzer", *words]
    return printed(command, env, cwd=folder, lines=LINES, columns=COLUMNS, watch=watch)[0]


def _rows(text: str) -> list[str]:
    return re.findall(r"^ *\d+ .*\d\d:\d\d:\d\d", text, re.MULTILINE)


def drawn(shown: Sequence[Scene]) -> str:
    """Draws the scenes as one animated SVG."""
    total = sum(_seconds(scene) for scene in shown)
    width, height = round(COLUMNS * CHAR_W + 32), LINES * LINE_H + 52
    groups, rules, start = [], [], 0.0
    for number, scene in enumerate(shown):
        end = start + _seconds(scene)
        groups.append(f'<g class="s{number}">')
        for place, line in enumerate(scene.lines()):
            seen = start + (COMMAND_S + place * LINE_S if place else 0)
            name = f"l{number}-{place}"
            rules.append(_rule(name, seen / total, end / total, total))
            groups.append(f'<text class="{name}" y="{52 + place * LINE_H}">{_spans(line)}</text>')
        groups.append("</g>")
        start = end
    return _DOCUMENT.format(
        width=width,
        height=height,
        font=FONT,
        rules="\n".join(rules),
        body="\n".join(groups),
        described=html.escape("; ".join(scene.command for scene in shown)),
    )


def _seconds(scene: Scene) -> float:
    return COMMAND_S + len(scene.lines()) * LINE_S + END_S


def _rule(name: str, start: float, end: float, total: float) -> str:
    """Returns the animation of a line: hidden, shown from `start` to `end`, hidden."""
    first, last = f"{100 * start:.2f}%", f"{100 * end:.2f}%"
    before = "" if start == 0 else f"0%{{opacity:0}}{first}{{opacity:0}}"
    after = "" if last == "100.00%" else f"{last}{{opacity:0}}"
    frames = f"@keyframes {name}{{{before}{100 * start + 0.01:.2f}%{{opacity:1}}"
    frames += f"{100 * end - 0.01:.2f}%{{opacity:1}}{after}100%{{opacity:0}}}}"
    return f"{frames}\n.{name}{{opacity:0;animation:{name} {total:.1f}s step-end infinite}}"


def _spans(line: Text) -> str:
    console = Console(file=io.StringIO(), width=COLUMNS, color_system="truecolor")
    spans, column = [], 0
    for segment in line.render(console):
        text = segment.text.rstrip("\n")
        if text.strip():
            left = len(text) - len(text.lstrip())
            place = 16 + (column + left) * CHAR_W
            shown = html.escape(text.strip()).replace("  ", "\u00a0\u00a0")
            width = len(text.strip()) * CHAR_W
            attributes = f'x="{place:.1f}" textLength="{width:.1f}"{_style(segment.style)}'
            spans.append(f"<tspan {attributes}>{shown}</tspan>")
        column += len(text)
    return "".join(spans)


def _style(style: Style | None) -> str:
    if style is None:
        return ""
    attributes = ' font-weight="bold"' if style.bold else ""
    if style.color is not None:
        attributes += f' fill="{style.color.get_truecolor(DIMMED_MONOKAI).hex}"'
    elif style.dim:
        attributes += ' fill="#8f8f8f"'
    return attributes


def words_in(svg: str) -> list[set[str]]:
    """Returns the words of each scene, without numbers: times differ from run to run."""
    groups = re.findall(r'<g class="s\d+">(.*?)</g>', svg, re.DOTALL)
    texts = (html.unescape(re.sub(r"<[^>]+>", " ", group)) for group in groups)
    return [set(_LETTERS.findall(text)) for text in texts]


_DOCUMENT = """\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}"
 role="img" aria-label="{described}">
<style>
text{{font:{font}px "DejaVu Sans Mono",Menlo,Consolas,monospace;fill:#d9d9d9;white-space:pre}}
{rules}
@media (prefers-reduced-motion:reduce){{text{{animation:none!important}}.s1 text{{opacity:1}}}}
</style>
<rect width="{width}" height="{height}" rx="8" fill="#191919"/>
<circle cx="20" cy="18" r="6" fill="#ff5f57"/><circle cx="40" cy="18" r="6" fill="#febc2e"/>
<circle cx="60" cy="18" r="6" fill="#28c840"/>
{body}
</svg>
"""


if __name__ == "__main__":
    PICTURE.write_text(drawn(scenes()), encoding="utf-8")
