"""What tests do on the page that decodes in a browser."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import modlens as api
from tests.conftest import CAPTURES
from tests.support.browser import Browser

RECORDINGS = sorted(CAPTURES.glob("*/recording.*"))
TABLES = ("transactions", "frames", "findings", "connections", "diagnoses")
STATE = "document.documentElement.dataset.state"
TROUBLE = "return document.getElementById('trouble').textContent"
SAVED = (
    "Page.request('save', { question: { table: arguments[0], where: null, format: 'csv' } })"
    ".then((it) => it.text())"
)

TYPED = CAPTURES / "pymodbus_types" / "recording.jsonl"
SPELLINGS = {
    "toml": """\
profile = 1
[device]
id = "typed"
[[registers]]
at = "hr:0"
name = "level"
type = "f32"
unit = "°C"
[[registers]]
at = "hr:4"
name = "flow"
type = "s16"
scale = 0.1
offset = -4
nan = [0x7FFF, 0x8000]
[[registers]]
at = "hr:47"
name = "mode"
enum = {0 = "off", 18 = "on"}
[[registers]]
at = "hr:48.0-3"
name = "NO"
""",
    "yaml": """\
# the same, in what YAML has: quotation marks or none, lists on a line or on many
---
profile: 1
device: {id: typed}
registers:
  - {at: hr:0, name: "level", type: f32, unit: °C}
  - at: 'hr:4'
    name: flow
    type: s16
    scale: 0.1
    offset: -4
    nan:
      - 0x7FFF
      - 0x8000
  - at: hr:47
    name: mode
    enum:
      0: off
      18: on
  -
    at: hr:48.0-3
    name: NO
""",
}
"""A profile for `TYPED`, whose unit 5 has 66 registers, in two notations."""


def show(browser: Browser, path: Path, state: str = "shown") -> None:
    """Choose a file on the page, and wait until it is shown, or refused."""
    browser.run(f"{STATE} = 'waiting'")
    browser.send_file("#file", path)
    browser.wait(f"['shown', 'refused'].includes({STATE})", 60)
    assert browser.run(f"return {STATE}") == state, browser.run(TROUBLE)
    browser.wait("document.documentElement.dataset.report !== 'waiting'")


def saved(browser: Browser, table: str) -> str:
    """The rows of a table as the page saves them."""
    return str(browser.ask(SAVED, table))


def of_command(path: Path, tables: Sequence[str], tmp_path: Path) -> dict[str, str]:
    """The rows of tables as the library writes them; the recording is named without a folder."""
    before = Path.cwd()
    os.chdir(path.parent)
    try:
        decoded = api.decode(path.name)
        for table in tables:
            getattr(decoded, table).write(tmp_path / f"{table}.csv")
    finally:
        os.chdir(before)
    return {table: (tmp_path / f"{table}.csv").read_bytes().decode() for table in tables}
