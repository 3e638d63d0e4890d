"""The page that decodes recordings in a browser, with nothing installed and nothing uploaded.

`make page` compiles the core to WebAssembly and packs it; `modlens page` writes the page: one HTML
file that works from a disk. Its policy forbids every connection. `modlens tap --web` serves the
same page, which then shows the line while it is listened to.
"""

from __future__ import annotations

import base64
import json
from functools import cache
from html import escape
from pathlib import Path

from analyzer.report import model
from analyzer.report.page import asset, html_head, sha256_source
from dissectors.errors import SourceError

__all__ = ["CORE", "page"]

CORE = Path(__file__).with_name("modlens.wasm.gz")
"""The compiled core, as `make page` leaves it."""

_REPORT_STYLES = ("uPlot.min.css", "report.css")
_REPORT_SCRIPTS = (
    "uPlot.iife.min.js",
    "model.js",
    "render.js",
    "buckets.js",
    "charts.js",
    "strips.js",
    "sections.js",
)
_CONNECT = " connect-src 'self';"
_SCRIPTS = ("unpack.js", "grid.js", "filters.js", "page.js", "live.js", "serial.js")


def page(*, live: bool = False) -> bytes:
    """The page as UTF-8; `SourceError` where the core has not been compiled.

    With `live` it shows what the server of a tap sends, the only one that it can connect to.
    """
    if not CORE.exists():
        raise SourceError(
            "this installation has no page in it; `make page` in the repository builds it"
        )
    style = "\n".join((asset(_REPORT_STYLES), _own("page.css")))
    script = "\n".join((asset(_REPORT_SCRIPTS), *map(_own, _SCRIPTS)))
    policy = (
        f"default-src 'none'; script-src '{sha256_source(script)}' 'wasm-unsafe-eval';"
        f" worker-src blob:; style-src '{sha256_source(style)}'; img-src data: blob:;"
        f"{_CONNECT * live} base-uri 'none'; form-action 'none'"
    )
    layout = escape(json.dumps(model.layout(), separators=(",", ":")), quote=False)
    core = base64.b64encode(CORE.read_bytes()).decode()
    return "".join(
        (
            html_head("modlens: what is wrong on this Modbus line", policy, style),
            f"<main>\n{_own('live.html' if live else 'page.html')}{_own('results.html')}</main>\n",
            '<footer><p id="said" role="status" aria-live="polite"></p>',
            '<p id="version"></p></footer>\n',
            f'<template id="layout">{layout}</template>\n',
            f'<template id="worker">{escape(_own("worker.js"), quote=False)}</template>\n',
            f'<template id="wasm">{core}</template>\n',
            f"<script>{script}</script>\n</body>\n</html>\n",
        )
    ).encode()


@cache
def _own(name: str) -> str:
    return Path(__file__).parent.joinpath("assets", name).read_text("utf-8")
