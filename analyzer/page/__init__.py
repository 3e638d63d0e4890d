"""The page that decodes recordings in a browser, with nothing installed and nothing uploaded.

`make page` compiles the core to WebAssembly and packs it; `modlens page` writes the page: one HTML
file that works from a disk. Its policy forbids every connection. `modlens tap --web` serves the
same page, which then shows the line while it is listened to.
"""

from __future__ import annotations

import base64
from functools import cache
from html import escape
from pathlib import Path

import _modlens
from analyzer.report.page import frame, html_head, sha256_source, styles_and_scripts
from dissectors.errors import SourceError

__all__ = ["CORE", "page"]

CORE = Path(__file__).with_name("modlens.wasm.gz")
"""The compiled core, as `make page` leaves it."""

_CONNECT = " connect-src 'self';"
_SCRIPTS = (
    "here.js",
    "core.js",
    "unpack.js",
    "grid.js",
    "filters.js",
    "bytes.js",
    "registers.js",
    "tables.js",
    "report_shown.js",
    "page.js",
    "live.js",
    "serial.js",
)


def page(*, live: bool = False) -> bytes:
    """The page as UTF-8; `SourceError` where the core has not been compiled.

    With `live` it shows what the server of a tap sends, the only one that it can connect to.
    """
    if not CORE.exists():
        raise SourceError(
            "this installation has no page in it; `make page` in the repository builds it"
        )
    # Those of a report stand alone: the page gives them to the reports that it saves.
    report_style, report_script = styles_and_scripts()
    style, script = _own("page.css"), "\n".join(map(_own, _SCRIPTS))
    scripts = f"'{sha256_source(report_script)}' '{sha256_source(script)}'"
    styles = f"'{sha256_source(report_style)}' '{sha256_source(style)}'"
    policy = (
        f"default-src 'none'; script-src {scripts} 'wasm-unsafe-eval';"
        f" worker-src blob:; style-src {styles}; img-src data: blob:;"
        f"{_CONNECT * live} base-uri 'none'; form-action 'none'"
    )
    layout = escape(_modlens.report_layout(), quote=False)
    core = base64.b64encode(CORE.read_bytes()).decode()
    return "".join(
        (
            html_head("modlens: what is wrong on this Modbus line", policy, report_style, style),
            f"<main>\n{_own('live.html' if live else 'page.html')}{_own('results.html')}</main>\n",
            '<footer><p id="said" role="status" aria-live="polite"></p>',
            '<p id="version"></p></footer>\n',
            f'<template id="layout">{layout}</template>\n',
            f'<template id="frame">{escape(frame(), quote=False)}</template>\n',
            f'<template id="worker">{escape(_own("worker.js"), quote=False)}</template>\n',
            f'<template id="wasm">{core}</template>\n',
            f"<script>{report_script}</script>\n<script>{script}</script>\n</body>\n</html>\n",
        )
    ).encode()


@cache
def _own(name: str) -> str:
    return Path(__file__).parent.joinpath("assets", name).read_text("utf-8")
