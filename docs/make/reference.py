"""The pages of the reference, made from the tables that the program itself reads.

`PAGES` names them in the order of the menu; each is a function without arguments that gives the
text. Nothing here is written again: a column, a finding or an option that is added appears.
"""

from __future__ import annotations

import argparse
import importlib
import json
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import _modlens
from analyzer import bus_file, filters
from analyzer.cli import COMMANDS, module_of
from analyzer.cli.parser import Parser
from analyzer.columns import TABLES, columns
from analyzer.exports import ENDINGS, load
from analyzer.exports import FORMATS as WRITTEN
from analyzer.profiles import available_profiles
from analyzer.profiles import load as load_profile
from analyzer.sources import all_formats
from analyzer.sources.schemes import SCHEMES
from analyzer.views import health as views_health
from analyzer.views import stats as views_stats
from dissectors import importers, vocabulary
from dissectors.explain import Explanation, explain
from dissectors.table import functions

__all__ = ["PAGES"]

ROOT = Path(__file__).parents[2]

TYPES = {
    "int": "whole number",
    "us": "microseconds, float64",
    "time": "timestamp in ns, UTC",
    "float": "float64",
    "bool": "true or false",
    "text": "text",
    "hex": "bytes as lower-case hex",
    "ints": "list of whole numbers",
    "texts": "list of texts",
    "map": "JSON text",
}


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    titles = list(head)
    lines = [titles, ["---"] * len(titles), *(map(_cell, row) for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _cell(text: str) -> str:
    """A text in a cell: on one line, and nothing in it is markup but code between backticks."""
    parts = text.replace("|", "\\|").replace("\n", " ").split("`")
    for number in range(0, len(parts), 2):
        for mark in "[*_":
            parts[number] = parts[number].replace(mark, f"\\{mark}")
        # A backslash before it would be shown.
        parts[number] = parts[number].replace("<", "&lt;")
    return "`".join(parts)


def _code(text: object) -> str:
    return f"`{text}`"


def _fence(language: str, text: str) -> str:
    return f"```{language}\n{text.rstrip()}\n```\n"


def commands() -> str:
    """Every command with its options, from its own parser."""
    rows = ([f"[`modlens {name}`](#{name})", summary] for name, summary in COMMANDS.items())
    listed = "".join(f"| {name} | {summary} |\n" for name, summary in rows)
    parts = [
        "# Commands\n",
        "The same texts as `modlens COMMAND --help`.\n",
        f"| command | what it does |\n| --- | --- |\n{listed}",
        *(_command(name) for name in COMMANDS),
        "## Exit status\n",
        "0 done; 1 done, but `--strict` was given and something was damaged; 2 wrong use; 3 input "
        "unreadable or output not writable; 4 port trouble.\n",
    ]
    return "\n".join(parts)


def _command(name: str) -> str:
    parser = Parser(prog=f"modlens {name}", description=COMMANDS[name])
    importlib.import_module(module_of(name)).add_arguments(parser)
    parts = [f"## {name}\n", f"`modlens {name}`: {COMMANDS[name]}.\n"]
    for group in parser._action_groups:
        rows = [_option(action, parser) for action in _shown(group)]
        if rows:
            parts += [f"**{group.title}**\n", table(("option", "meaning"), rows)]
    if parser.epilog:
        parts.append(_fence("text", parser.epilog))
    return "\n".join(parts)


def _shown(group: argparse._ArgumentGroup) -> Iterator[argparse.Action]:
    for action in group._group_actions:
        if action.help != argparse.SUPPRESS and "--help" not in action.option_strings:
            yield action


def _option(action: argparse.Action, parser: Parser) -> tuple[str, str]:
    """How an option is written, and what it means."""
    formatter = parser._get_formatter()
    written = formatter._format_action_invocation(action)
    return _code(written), formatter._expand_help(action) if action.help else ""


def column_tables() -> str:
    """Every column of every table."""
    parts = [
        "# Columns\n",
        "The columns of each table, in the order of every output. The names are the same in "
        "exports, in `--where`, in `--columns` and in Python. What the values mean is explained in "
        "[Records](../records.md). A column marked with * has a value in every row.\n",
        table(("type", "what it is"), ((_code(word), text) for word, text in TYPES.items())),
    ]
    for name in TABLES:
        rows = (
            (_code(one.key) + ("*" if one.always else ""), _code(one.type), one.help)
            for one in columns(name)
        )
        parts += [f"## {name}\n", table(("column", "type", "meaning"), rows)]
    return "\n".join(parts)


def findings() -> str:
    """Every finding with title, reason and advice."""
    parts = [
        "# Findings\n",
        "What modlens calls odd on a frame or a transaction. They are in the column `findings`, in "
        "the table `findings`, and in `modlens explain NAME`; a filter asks for one by its name "
        "alone: `--where retry`.\n",
    ]
    for one in vocabulary.findings():
        parts.append(_explanation(one.code, explain(one.code)))
    return "\n".join(parts)


def _explanation(title: str, found: Explanation) -> str:
    """An explanation as a section: its paragraphs, and its example as it is printed."""
    parts = [f"## {title}\n", f"*{_cell(found.title)}.* {_cell(found.section)}\n"]
    parts += [f"{_cell(paragraph)}\n" for paragraph in found.text]
    if found.example:
        parts.append(_fence("text", "\n".join(found.example)))
    return "\n".join(parts)


def diagnoses() -> str:
    """Every diagnosis of the doctor."""
    parts = [
        "# Diagnoses\n",
        "The causes that `modlens doctor` names. Words in braces are filled in by what it found.\n",
    ]
    rows = tomllib.loads((ROOT / "dissectors" / "diagnoses.toml").read_text("utf-8"))["diagnosis"]
    sentences = {row["code"]: row["sentence"] for row in rows}
    for one in vocabulary.diagnoses():
        page = f"doctor/{one.code}.md"
        more = f" [What it is, and how to fix it](../{page})."
        parts += [
            f"## {one.code}\n",
            f"**{_cell(one.title)}** (severity up to {one.severity})."
            + (more if (ROOT / "docs" / page).exists() else "")
            + "\n",
            f"> {_cell(sentences[one.code])}\n",
            f"- Shown by: {_cell(one.contrast)}",
            f"- Absent: {_cell(one.absent)}",
            *(f"- Not [{code}](#{code}): {_cell(text)}." for code, text in one.confusions),
            f"- To check: {_cell(one.advice)}",
            f"- Proof: {_cell(one.proof)}",
            f"- The recording needs {_cell(one.needs)}.\n",
        ]
    return "\n".join(parts)


def function_table() -> str:
    """Every function code, and the exception codes."""
    rows = (
        (
            f"{row.code} (0x{row.code:02X})" + (f" / {row.when[1]}" if row.when else ""),
            row.label,
            row.section,
            row.summary,
        )
        for row in functions()
    )
    parts = [
        "# Functions and exceptions\n",
        "Sections are those of the MODBUS Application Protocol Specification V1.1b3. `modlens "
        "explain 3` shows layout, limits and an example; `--functions` adds codes of a vendor.\n",
        table(("code", "name", "section", "what it does"), rows),
        "## Exceptions\n",
        table(
            ("code", "name", "meaning", "to check"),
            (
                (str(one.code), one.name, one.meaning, one.check)
                for one in vocabulary.names("exceptions")
            ),
        ),
    ]
    return "\n".join(parts)


def formats() -> str:
    """What is read, tapped, written and imported."""
    parts = [
        "# Formats\n",
        "## Recordings that are read\n",
        "The format is detected from the content; `--from NAME` overrides it. The clock says what "
        "times the format has.\n",
        table(
            ("name", "what it is", "clock"),
            ((_code(one.name), one.title, one.clock) for one in all_formats().values()),
        ),
        "### Samples\n",
    ]
    for one in all_formats().values():
        if one.sample:
            parts += [
                f"**{one.name}**: {_cell(one.title)}\n",
                _fence("text", "\n".join(one.sample)),
            ]
    parts += [
        "## Ports that are tapped\n",
        table(
            ("for example", "what it is"),
            ((_code(one.example), one.title) for one in SCHEMES.values()),
        ),
        "## Files that are written\n",
        table(("ending", "what it is", "`--style`"), map(_written, WRITTEN)),
        "## Register maps that are imported\n",
        "`modlens import NAME FILE`; those that can also be written are formats of `modlens "
        "profiles convert --to`.\n",
        table(
            ("name", "what it is", "read", "written"),
            (
                (_code(name), one.title, "yes" if one.reads else "", "yes" if one.writes else "")
                for name, one in importers.FORMATS.items()
            ),
        ),
        "## Profiles that are shipped\n",
        table(("name", "device", "source"), _shipped()),
    ]
    return "\n".join(parts)


def _written(name: str) -> tuple[str, str, str]:
    module = importlib.import_module(WRITTEN[name])
    summary = (module.__doc__ or "").split("\n\n")[0].replace("\n", " ")
    endings = [f".{name}", *(ending for ending, form in ENDINGS.items() if form == name)]
    return ", ".join(map(_code, endings)), summary, ", ".join(load(name).styles)


def _shipped() -> Iterator[tuple[str, str, str]]:
    for one in available_profiles():
        profile = load_profile(one.name)
        yield _code(one.name), profile.title, str(profile.device.get("source", ""))


def statistics() -> str:
    """The keys of the statistics and of what the doctor says."""
    stats, health = (
        _fence("text", (module.__doc__ or "").split("```")[1])
        for module in (views_stats, views_health)
    )
    parts = [
        "# Statistics and verdict\n",
        "`modlens stats --to json` writes both as one document, with time series: "
        "`statistics` and `doctor`; see [The report](../report.md). The "
        "types are those of JSON; `count` of n times is how many there were.\n",
        "## Statistics\n",
        "What `stats()` gives in Python, and `statistics` in the document.\n",
        stats,
        "## Verdict\n",
        "What `doctor()` gives in Python, `modlens doctor --to json` prints, and `doctor` is in "
        "the document. The codes are explained in [Diagnoses](diagnoses.md).\n",
        health,
    ]
    return "\n".join(parts)


def bus_files() -> str:
    """The keys of a bus file."""
    doc = bus_file.__doc__ or ""
    parts = [
        "# Bus file\n",
        "Port, line settings and the profiles of the units of each bus, in TOML.\n",
        "`modlens tap --bus plant.toml` taps all buses in it; `--bus plant.toml:pumps` is one of "
        "them, for `decode` and the other commands.\n",
        _fence("toml", doc.partition("```toml\n")[2].partition("```")[0]),
        doc.rpartition("```\n")[2],
        "## Keys of the file\n",
        table(("key", "meaning"), _keys(bus_file.FILE_KEYS)),
        "## Keys of a `[[bus]]`\n",
        table(("key", "meaning"), _keys(bus_file.BUS_KEYS)),
    ]
    return "\n".join(parts)


def _keys(keys: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    return ((_code(key), text) for key, text in keys.items())


def profile_format() -> str:
    """The keys of a profile, from its schema."""
    schema = json.loads(_modlens.profile_schema())["properties"]
    parts = [
        "# Profile\n",
        "The register map of a device, in TOML, YAML or CSV with the same keys; the schema is "
        "`dissectors/profiles/profile-1.json`. `modlens profiles check FILE` reports all mistakes "
        "at once, with their lines.\n",
        _fence("toml", PROFILE_EXAMPLE),
        "## Keys of `[device]`\n",
        table(("key", "values", "meaning"), _schema_rows(schema["device"]["properties"])),
        "## Keys of a `[[registers]]`\n",
        table(
            ("key", "values", "meaning"), _schema_rows(schema["registers"]["items"]["properties"])
        ),
    ]
    return "\n".join(parts)


PROFILE_EXAMPLE = """\
profile = 1

[device]
vendor = "Example"
model = "Flow meter"
address_base = "modicon"   # the manual counts 40001
order = "CDAB"             # lower register first

[[registers]]
at = "hr:40101"
name = "flow"
type = "f32"
unit = "m3/h"

[[registers]]
at = "hr:40103"
name = "state"
enum = {0 = "stopped", 1 = "running", 2 = "fault"}
"""


def _schema_rows(keys: Mapping[str, Mapping[str, object]]) -> Iterator[tuple[str, str, str]]:
    for key, rule in keys.items():
        values = rule.get("enum") or rule.get("type") or ""
        words = ", ".join(map(str, values)) if isinstance(values, list) else str(values)
        yield _code(key), words, str(rule.get("description", ""))


def filter_language() -> str:
    """The language of `--where`, as its parser describes it."""
    head, _, rest = (filters.__doc__ or "").partition("\n\n")
    grammar = rest.partition("\n## The tree")[0]
    words = [
        "## Single words\n",
        "A status: " + ", ".join(map(_code, vocabulary.statuses())) + ".\n",
        "A verdict (table `frames`): " + ", ".join(map(_code, vocabulary.verdicts())) + ".\n",
        "A finding: " + ", ".join(_code(one.code) for one in vocabulary.findings()) + ".\n",
        "Examples to copy are in the [cookbook](../cookbook/filters.md); the columns are listed in "
        "[Columns](columns.md).\n",
    ]
    return "\n".join(["# Filters\n", head + "\n", grammar, *words])


PAGES: Mapping[str, tuple[str, Callable[[], str]]] = {
    "commands": ("Commands", commands),
    "columns": ("Columns", column_tables),
    "filters": ("Filters", filter_language),
    "findings": ("Findings", findings),
    "diagnoses": ("Diagnoses", diagnoses),
    "functions": ("Functions and exceptions", function_table),
    "formats": ("Formats", formats),
    "statistics": ("Statistics and verdict", statistics),
    "profile": ("Profile", profile_format),
    "bus-file": ("Bus file", bus_files),
}
"""File name -> title in the menu, and what makes the page."""
