"""The page: one HTML file without anything from elsewhere.

What is to be read is HTML. The document itself is in the page once, compressed, in a `<template>`,
which no policy takes for a script; the plots are drawn of it after the page is shown. The content
security policy names the hashes of the one style sheet and the one script, and forbids all else.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

from analyzer.report import model
from analyzer.visible import visible

__all__ = ["asset", "html_head", "page", "sha256_source", "viewer"]

_STYLES = ("uPlot.min.css", "report.css")
_SCRIPTS = (
    "uPlot.iife.min.js",
    "model.js",
    "render.js",
    "buckets.js",
    "charts.js",
    "strips.js",
    "sections.js",
    "report.js",
)
_ICON = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E"
    "%3Cpath d='M1 8h3l2-5 3 10 2-5h4' fill='none' stroke='%232a78c8' stroke-width='2'/%3E"
    "%3C/svg%3E"
)


def page(document: Mapping[str, Any]) -> bytes:
    """The report of a document (`document.complete`) as UTF-8."""
    name = model.summary(document)["name"]
    return _whole(f"{name}: Modbus report", "".join(_body(document)), document)


def viewer() -> bytes:
    """A page without data, on which documents are dropped."""
    text = "Drop the JSON of modlens stats --to json on this page, or choose it below."
    return _whole("Modbus report", f'<p class="empty">{text}</p>', None)


def _whole(title: str, body: str, document: Mapping[str, Any] | None) -> bytes:
    style, script = asset(_STYLES), asset(_SCRIPTS)
    policy = (
        f"default-src 'none'; script-src '{sha256_source(script)}';"
        f" style-src '{sha256_source(style)}';"
        " img-src data:; base-uri 'none'; form-action 'none'"
    )
    data = "" if document is None else _packed(document)
    layout = escape(json.dumps(model.layout(), separators=(",", ":")), quote=False)
    return "".join(
        (
            html_head(title, policy, style),
            '<a class="skip" href="#report">To the report</a>\n',
            f'<main id="report">\n{body}</main>\n',
            '<footer><p id="said" role="status" aria-live="polite"></p>',
            '<p class="script-only"><label>Show another document: ',
            '<input type="file" id="file" accept=".json,application/json"></label></p>',
            "<noscript><p>Plots and filters need JavaScript; everything else is above.</p>",
            "</noscript></footer>\n",
            f'<template id="layout">{layout}</template>\n',
            f'<template id="data">{data}</template>\n',
            f"<script>{script}</script>\n</body>\n</html>\n",
        )
    ).encode()


def html_head(title: str, policy: str, style: str) -> str:
    """The beginning of a page, up to its body; `policy` is its content security policy."""
    return "".join(
        (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n',
            f'<meta http-equiv="Content-Security-Policy" content="{escape(policy)}">\n',
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n',
            '<meta name="color-scheme" content="light dark">\n',
            f'<link rel="icon" href="{_ICON}">\n',
            f"<title>{_text(title)}</title>\n<style>{style}</style>\n</head>\n<body>\n",
        )
    )


def _packed(document: Mapping[str, Any]) -> str:
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":"))
    # Level 9 would take twice the time for 2 % less.
    packed = gzip.compress(text.encode("utf-8", "surrogatepass"), 6, mtime=0)
    return base64.b64encode(packed).decode()


@cache
def asset(names: Sequence[str]) -> str:
    """The text of these style sheets or scripts, one after the other."""
    folder = Path(__file__).with_name("assets")
    return "\n".join(folder.joinpath(name).read_text("utf-8") for name in names)


def sha256_source(text: str) -> str:
    """The hash by which a policy allows this style or script."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _text(text: Any) -> str:
    return escape(visible(str(text)))


def _body(document: Mapping[str, Any]) -> Iterator[str]:
    """The sections: name and verdict, the causes, those of the layout; then the appendix."""
    top, doctor = model.summary(document), document["doctor"]
    verdict = doctor["verdict"]
    yield f'<header><h1>{escape(top["name"])}</h1><p class="period">{escape(top["period"])}</p>'
    yield f'<p class="verdict {verdict}"><strong>{_text(model.VERDICTS[verdict])}</strong> '
    yield f"{_text(doctor['sentence'])}</p></header>\n"
    causes = list(model.diagnoses(document))
    more = causes[model.URGENT :]
    yield from _causes("diagnoses", "What to do first", causes[: model.URGENT], 1)
    if not causes:
        yield '<p class="empty">No cause of trouble was found.</p>'
    elif more:
        yield f'<p class="more"><a href="#more-causes">{len(more)} more in the appendix</a></p>'
    yield f'</section>\n<p class="basis">Based on {escape(top["sources"])}.</p>\n'
    for section in model.sections(document):
        if section.get("appendix"):
            yield '<h2 class="part">Appendix</h2>\n'
            if more:
                yield from _causes("more-causes", "More causes", more, model.URGENT + 1)
                yield "</section>\n"
        yield from _section(document, section)


def _section(document: Mapping[str, Any], section: Mapping[str, Any]) -> Iterator[str]:
    has_rows = bool(model.rows_at(document, section["rows"]))
    yield f'<section id="{section["id"]}"><h2>{section["title"]}</h2>'
    if has_rows and "text" in section:
        yield f"<p>{_text(section['text'])}</p>"
    if has_rows and "hint" in section:
        yield f'<p class="hint script-only">{_text(section["hint"])}</p>'
    if "draw" in section or "plots" in section:
        yield f'<div class="plot script-only" data-plot="{section["id"]}"></div>'
    if has_rows and "legend" in section:
        marks = (
            f'<span><i class="swatch {colour}"></i>{_text(meaning)}</span>'
            for colour, meaning in section["legend"]
        )
        yield f'<p class="legend script-only">{"".join(marks)}</p>'
    if has_rows:
        yield from _content(document, section)
    else:
        yield f'<p class="empty">{section["empty"]}</p>'
    yield "</section>\n"


def _causes(name: str, title: str, cards: Sequence[Mapping[str, Any]], first: int) -> Iterator[str]:
    yield f'<section id="{name}"><h2>{title}</h2>'
    for number, card in enumerate(cards, first):
        level = card["level"]
        yield f'<article class="card {level}"><h3><span class="level">{level}</span> '
        yield f"{number}. {escape(card['title'])} <code>{escape(card['code'])}</code></h3>"
        for head, text in card["texts"]:
            mark = f"<strong>{head}:</strong> " if head else ""
            yield f"<p>{mark}{escape(text)}</p>"
        facts = "".join(
            f"<div><dt>{fact}</dt><dd>{escape(to)}</dd></div>" for fact, to in card["facts"]
        )
        links = ", ".join(f'<a href="#txn-{txn}">{txn}</a>' for txn in card["examples"])
        if links:
            facts += f"<div><dt>example transactions</dt><dd>{links}</dd></div>"
        yield f"<dl>{facts}</dl></article>"


def _content(document: Mapping[str, Any], section: Mapping[str, Any]) -> Iterator[str]:
    if section.get("examples"):
        yield from _examples(document)
        return
    if "matrix" in section:
        yield from _table(section["title"], **model.matrix(document, section))
        return
    found = model.table(document, section)
    yield from _table(section["title"], **found)
    more = len(model.rows_at(document, section["rows"])) - len(found["rows"])
    if more > 0:
        yield f'<p class="more">{more:,} more are in the document.</p>'


def _table(
    title: str, *, head: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool]
) -> Iterator[str]:
    yield f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(title)}">'
    yield "<table><thead><tr>"
    for name in head:
        yield f'<th scope="col">{escape(name)}</th>'
    yield "</tr></thead><tbody>"
    for row in rows:
        yield "<tr>"
        for text, number in zip(row, right, strict=True):
            yield f'<td class="n">{escape(text)}</td>' if number else f"<td>{escape(text)}</td>"
        yield "</tr>"
    yield "</tbody></table></div>"


def _examples(document: Mapping[str, Any]) -> Iterator[str]:
    for one in model.examples(document):
        kind = "example named" if one["named"] else "example"
        yield f'<details class="{kind}" id="txn-{one["txn"]}">'
        yield f"<summary>{escape(one['title'])}</summary>"
        if one["findings"]:
            yield f"<p>{escape(one['findings'])}</p>"
        for frame in one["frames"]:
            yield '<div class="scroll"><table class="bytes">'
            yield f"<caption>{escape(frame['title'])}</caption><thead><tr>"
            yield "".join(f'<th scope="col">{name}</th>' for name in _PIECES)
            yield "</tr></thead><tbody>"
            for row in frame["rows"]:
                yield '<tr class="wrong">' if row["wrong"] else "<tr>"
                yield "".join(f"<td>{escape(text)}</td>" for text in row["cells"])
                yield "</tr>"
            yield "</tbody></table></div>"
        yield "</details>"


_PIECES = ("offset", "bytes", "field", "value", "meaning")
