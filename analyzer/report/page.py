"""The page: one HTML file without anything from elsewhere.

What is to be read is HTML, which the core writes. The document itself is in the page once,
compressed, in a `<template>`, which no policy takes for a script; the plots are drawn of it after
the page is shown. The content security policy names the hashes of the style sheet and of the two
scripts, and forbids all else.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import re
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

import _modlens
from analyzer.report.document import core_text

__all__ = [
    "frame",
    "html_head",
    "page",
    "sha256_source",
    "styles_and_scripts",
]

_STYLES = ("uPlot.min.css", "report.css")
_SCRIPTS = (
    "uPlot.iife.min.js",
    "show.js",
    "buckets.js",
    "charts.js",
    "strips.js",
    "sections.js",
    "row_filter.js",
)
_ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E"
    "%3Cpath d='M1 8h3l2-5 3 10 2-5h4' fill='none' stroke='%232a78c8' stroke-width='2'/%3E"
    "%3C/svg%3E"
)


def page(document: Mapping[str, Any]) -> bytes:
    """The report of a document (`document.complete`) as UTF-8."""
    text = core_text(document)
    title, body = _modlens.report_html(text)
    style, script = styles_and_scripts()
    # Level 9 would take twice the time for 2 % less.
    packed = gzip.compress(text.encode(), 6, mtime=0)
    parts = {
        "title": title,
        "style": style,
        "body": body,
        "data": base64.b64encode(packed).decode(),
        "script": script,
    }
    return re.sub(r"@@(\w+)@@", lambda mark: parts[mark[1]], frame()).encode()


def frame() -> str:
    """A report without what differs from one to another, and without what other pages have as well.

    Marks stand for these parts: title, style, body, data, script.
    """
    style, script = styles_and_scripts()
    own = _asset(("report.js",))
    policy = (
        f"default-src 'none'; script-src '{sha256_source(script)}' '{sha256_source(own)}';"
        f" style-src '{sha256_source(style)}';"
        " img-src data:; base-uri 'none'; form-action 'none'"
    )
    return "".join(
        (
            html_head("@@title@@", policy, "@@style@@"),
            '<a class="skip" href="#report">To the report</a>\n',
            '<main id="report">\n@@body@@</main>\n',
            '<footer><p id="said" role="status" aria-live="polite"></p>',
            "<noscript><p>Plots and filters need JavaScript; everything else is above.</p>",
            "</noscript></footer>\n",
            f'<template id="layout">{escape(_modlens.report_layout(), quote=False)}</template>\n',
            '<template id="data">@@data@@</template>\n',
            f"<script>@@script@@</script>\n<script>{own}</script>\n</body>\n</html>\n",
        )
    )


def styles_and_scripts() -> tuple[str, str]:
    """The style sheet of a report, and the scripts that draw in it."""
    return _asset(_STYLES), _asset(_SCRIPTS)


def html_head(title: str, policy: str, *styles: str) -> str:
    """The beginning of a page, up to its body; `policy` is its content security policy."""
    return "".join(
        (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n',
            f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">\n',
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n',
            '<meta name="color-scheme" content="light dark">\n',
            f'<link rel="icon" href="{_ICON}">\n',
            f"<title>{escape(title)}</title>\n",
            *(f"<style>{style}</style>\n" for style in styles),
            "</head>\n<body>\n",
        )
    )


@cache
def _asset(names: Sequence[str]) -> str:
    """The text of these style sheets or scripts, one after the other."""
    folder = Path(__file__).with_name("assets")
    return "\n".join(folder.joinpath(name).read_text("utf-8") for name in names)


def sha256_source(text: str) -> str:
    """The hash by which a policy allows this style or script."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
