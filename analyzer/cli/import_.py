"""`modlens import`: register maps of other programs become profiles."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from analyzer.cli.standard_streams import STDERR, discard_output
from analyzer.counts import count_of
from analyzer.exports.output import AtomicFile, StandardOutput
from analyzer.views.screen import Screen, visible
from dissectors import importers
from dissectors.errors import ModlensError, SourceError, UsageError
from dissectors.profile import from_model

__all__ = ["add_arguments", "decode_text", "run", "show_notes", "write_text"]

EPILOG = """\
examples:
  modlens import inverter.yaml -o inverter.toml
  modlens import telegraf telegraf.conf -o meter.toml
  modlens import csv tags.csv --base modicon --order CDAB
  modlens import homeassistant configuration.yaml --unit 3
  modlens import homeassistant configuration.yaml -o plant.toml
  modlens import solarman inverter_definitions/ -o profiles/
  modlens import maps/

Of a folder, every file in it is tried: a line says what was taken, or why not.
-o names the folder for the profiles. Without FORMAT all are tried. Assumptions,
and anything a profile cannot store, are reported on standard error.
"""

AUTO = "auto"
"""The format that stands for whichever reads the file."""

BYTE_ORDER_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}
"""Byte order mark -> the encoding of the text after it."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    read = [name for name, form in importers.FORMATS.items() if form.reads]
    written = [name for name, form in importers.FORMATS.items() if form.writes]
    parser.add_argument(
        "format",
        metavar="FORMAT",
        nargs="?",
        default=AUTO,
        help=f"one of {', '.join(read)}; or {AUTO} for any of them, which is the default",
    )
    parser.add_argument(
        "file", metavar="FILE", help="the register map, or a folder of them; - is standard input"
    )
    parser.add_argument(
        "--base",
        choices=("0", "1", "modicon"),
        help="address numbering in the file: from 0, from 1, or modicon (40001)",
    )
    parser.add_argument("--order", metavar="ORDER", help="byte order: ABCD, CDAB, BADC or DCBA")
    parser.add_argument(
        "--unit", type=int, metavar="N", help="the unit to import, if there are several"
    )
    parser.add_argument("--encoding", metavar="NAME", help="text encoding (default: UTF-8)")
    parser.add_argument(
        "--to", metavar="FORMAT", default="toml", help=f"format to write: {', '.join(written)}"
    )
    parser.add_argument(
        "-o",
        dest="output",
        metavar="OUT",
        help="output file (default: standard output); for a file with several units a bus file,"
        " with a profile for each unit beside it; for a folder the folder to write to",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Import; gives the exit status."""
    if options.file != "-" and Path(options.file).is_dir():
        return _import_folder(options, Path(options.file))
    try:
        text, notes = _imported(options, options.file)
    except importers.SeveralUnitsError as error:
        if options.output is None or options.to != "toml":
            raise
        text, notes = _imported_buses(options, error)
    write_text(text, options.output)
    show_notes(notes)
    return 0


def _imported_buses(
    options: argparse.Namespace, several: importers.SeveralUnitsError
) -> tuple[str, list[str]]:
    """The text of a bus file for all units of a file, whose profiles are written beside it."""
    text, notes = decode_text(_read_input(options.file), options.encoding, options.file)
    form = several.form or options.format
    buses = importers.hubs(form, text, options.file, several.units)
    target, lines = Path(options.output), ["plant = 1"]
    for hub in buses:
        lines += ["", "[[bus]]", *(f"{key} = {json.dumps(one)}" for key, one in hub.keys.items())]
        lines += ["", "[bus.units]"]
        name = f"{target.stem}-{_file_word(hub.keys['name'])}" if len(buses) > 1 else target.stem
        # Registers without a unit may be those of any.
        for unit in hub.units or (None,):
            found = importers.read(form, hub.text, options.file, _chosen(options, unit))
            written = importers.write(options.to, from_model(found.model, options.file))
            beside = f"{name}-{'units' if unit is None else f'unit{unit}'}.toml"
            write_text(written.text, str(target.with_name(beside)))
            lines.append(f'"{unit or "1-247"}" = {json.dumps(beside)}')
            notes.append(f"{beside}: {count_of(len(found.model['registers']), 'register')}")
            notes += [one for one in (*found.notes, *written.notes) if one not in notes]
    return "\n".join(lines) + "\n", [f"a bus file, for --bus {options.output}", *notes]


def _file_word(name: str) -> str:
    """A name as a part of a file name."""
    return re.sub(r"[^\w-]+", "_", name).strip("_") or "bus"


def _chosen(options: argparse.Namespace, unit: int | None) -> importers.Options:
    base = int(options.base) if options.base in ("0", "1") else options.base
    return importers.Options(base, importers.parse_order(options.order, "--order"), unit)


def _imported(options: argparse.Namespace, file: str) -> tuple[str, list[str]]:
    """The text of the profile that a file becomes, and the notes on it."""
    text, encoding_notes = decode_text(_read_input(file), options.encoding, file)
    chosen = _chosen(options, options.unit)
    form, notes = options.format, encoding_notes
    if form == AUTO:
        form = importers.detect(text, file, options.unit)
        notes = [*notes, f"read as {form} (detected)"]
    found = importers.read(form, text, file, chosen)
    profile = from_model(found.model, file)
    written = importers.write(options.to, profile)
    registers = count_of(len(profile.points), "register")
    return written.text, [registers, *notes, *found.notes, *written.notes]


def _import_folder(options: argparse.Namespace, folder: Path) -> int:
    """Import each file below a folder; a line each says what was taken, or why not.

    Gives the exit status: that of an unreadable input where no file was taken.
    """
    for form, way in ((options.format, "reads"), (options.to, "writes")):
        if form != AUTO:
            importers.check_format(form, way)
    suffix = importers.FORMATS[options.to].suffix
    screen, taken = Screen(sys.stdout), 0
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    for path in files:
        name = str(path.relative_to(folder))
        try:
            text, notes = _imported(options, str(path))
            if options.output is not None:
                target = Path(options.output) / path.relative_to(folder).with_suffix(suffix)
                target.parent.mkdir(parents=True, exist_ok=True)
                write_text(text, str(target))
        except ModlensError as error:
            why = error.message.splitlines()[0].removeprefix(f"{path}: ")
            screen.lines([[("not taken ", "bad"), (visible(f"{name}: {why}"), "")]])
            continue
        taken += 1
        left_out = sum(note.endswith("skipped") for note in notes)
        more = f", {left_out} left out" if left_out else ""
        screen.lines([[("taken     ", "good"), (visible(f"{name}: {notes[0]}{more}"), "")]])
    show_notes([f"{taken} of {count_of(len(files), 'file')} taken"])
    return 0 if taken else SourceError.exit_status


def show_notes(notes: Iterable[str]) -> None:
    """Print each note as a dimmed line on standard error; they are dropped when nobody reads."""
    try:
        screen = Screen(sys.stderr)
        for note in notes:
            screen.line(visible(note), "dim")
    except (BrokenPipeError, SourceError):
        discard_output(STDERR)


def write_text(text: str, path: str | None) -> None:
    """Write a text to a file that appears when it is complete, or to standard output for None."""
    output = StandardOutput() if path is None else AtomicFile(path)
    try:
        output.append(text.encode("utf-8"))
        output.close()
    except SourceError:
        output.rollback()
        raise


def decode_text(data: bytes, encoding: str | None, name: str) -> tuple[str, list[str]]:
    """Decode the bytes of a file; gives the text, and a note where its encoding was guessed.

    >>> decode_text("Größe".encode("utf-16"), None, "x")
    ('Größe', [])
    """
    marked = next((code for mark, code in BYTE_ORDER_MARKS.items() if data.startswith(mark)), None)
    if not encoding and not marked and b"\0" in data:
        return _decode_utf16(data, name)
    try:
        return data.decode(encoding or marked or "utf-8"), []
    except LookupError as error:
        raise UsageError(f"--encoding {encoding}: no such encoding") from error
    except UnicodeDecodeError as error:
        if encoding or marked:
            raise SourceError(
                f"{name}: not valid {encoding or marked} at byte {error.start}"
            ) from error
    note = (
        "not UTF-8: read as Windows-1252 (assumed; --encoding names another, such as cp1251 or"
        " cp936)"
    )
    return data.decode("cp1252", "replace"), [note]


def _decode_utf16(data: bytes, name: str) -> tuple[str, list[str]]:
    """Decode UTF-16 without a byte order mark; the byte order follows from where the zeros are.

    `SourceError` where the zeros are not those of UTF-16: the file is binary.
    """
    for first, code in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros, letters = data[first::2], data[1 - first :: 2]
        if len(data) % 2 == 0 and 5 * zeros.count(0) > 4 * len(zeros) and 0 not in letters:
            note = f"every other byte is zero: read as {code} (assumed; --encoding names another)"
            return data.decode(code, "replace"), [note]
    at = data.index(0)
    raise SourceError(f"{name}: not text: a zero at byte {at}; --encoding names its encoding")


def _read_input(path: str) -> bytes:
    try:
        return sys.stdin.buffer.read() if path == "-" else Path(path).read_bytes()
    except OSError as error:
        raise SourceError(f"{path}: cannot be read: {error.strerror or error}") from error
