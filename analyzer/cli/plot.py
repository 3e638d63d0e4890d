"""`modlens plot`: values over time, in the terminal or as a picture."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import SIGNALLED
from analyzer.cli.parser import add_decoding, add_input, add_line
from analyzer.cli.recording_document import write_page
from analyzer.cli.selection import add_selection
from analyzer.cli.stop_signals import StopSignals
from analyzer.filters import Filter, parse
from analyzer.session import FileRun
from analyzer.views.plot import png, show_plot, svg
from analyzer.views.plot_series import AXES, Axis, Plot, Series, seconds_of
from analyzer.views.screen import stdout
from dissectors.errors import CaptureError, FilterError, UsageError
from dissectors.function_lookup import similar_name

__all__ = ["add_arguments", "run"]

MOST_SERIES = 8

EPILOG = """\
examples:
  modlens plot bus.jsonl 'unit == 1 and address == 107'
  modlens plot bus.jsonl "Room temperature" --profile 1=meter.toml -o room.svg

Values are kept in memory, 16 bytes each and more. Times are UTC; a recording
without a date has seconds from its start, one without times the numbers of
its transactions. Lines have gaps where a value was not heard for three times
its usual interval.
"""

_COLUMNS = (
    *("txn", "time", "elapsed_us", "bus", "unit", "register_type", "address", "name"),
    *("unit_of_measure", "value"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.usage = "modlens plot [OPTIONS] FILE... EXPR"
    add_input(parser)
    parser.add_argument(
        "expression",
        metavar="EXPR",
        help="which readings, such as 'unit == 1 and address == 107', or the name of one",
    )
    add_selection(parser)
    add_decoding(parser)
    add_line(parser)
    parser.add_argument(
        "-o",
        dest="output",
        metavar="FILE",
        help="write a picture instead: plot.svg, or plot.png (extra png)",
    )
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Decode the recordings, then draw the values; gives the exit status."""
    draw = _picture(options.output)
    messages = Messages(quiet=True)
    wanted = _filter_of(options.expression)
    files = file_run(
        options, replace(settings(options), tables=("transactions", "readings")), messages
    )
    with StopSignals() as stop_signals:
        plot, axis = _values(files, wanted, stop_signals)
        if not plot:
            raise UsageError(
                f"plot: no reading with a number meets {options.expression!r};"
                f"{_hint(options, messages)} modlens map lists what was read and written"
            )
        if draw is None:
            show_plot(plot, stdout(), axis)
        else:
            write_page(options.output, draw(plot, axis))
        if stop_signals.signal is not None:
            return SIGNALLED + stop_signals.signal
    return CaptureError.exit_status if files.unreadable else 0


def _hint(options: argparse.Namespace, messages: Messages) -> str:
    """The name in the recording that is most like the one that was given."""
    files = file_run(options, replace(settings(options), tables=("readings",)), messages)
    names: set[str] = set()
    for batch in files.batches():
        rows = batch.readings
        names |= {str(name) for (name,) in rows.tuples(["name"], 0, len(rows)) if name is not None}
    hint = similar_name(options.expression.strip(), sorted(names))
    return f" did you mean {hint!r}?" if hint else ""


def _picture(output: str | None) -> Callable[[Plot, Axis], bytes] | None:
    """What draws the picture of this name; none for the terminal."""
    if output is None:
        return None
    match Path(output).suffix.lower():
        case ".png":
            return png
        case ".svg":
            return lambda plot, axis: svg(plot, axis).encode()
        case _ if output == "-":
            return lambda plot, axis: svg(plot, axis).encode()
    raise UsageError(f"plot: -o {output}: pictures are SVG or PNG; name it .svg or .png")


def _filter_of(text: str) -> Filter:
    """The readings of this name, or those that meet the condition.

    What compares nothing and asks nothing is a name, also one with blanks.

    >>> str(_filter_of("Room temperature")), str(_filter_of("unit == 1"))
    ("name == 'Room temperature'", 'unit == 1')
    """
    by_name = f"name == {text.strip()!r}"
    if re.search(r"[=<>!'\"]|\w\(", text):
        return parse(text, "readings")
    if not re.search(r"\b(and|or|not)\b", text):
        return parse(by_name, "readings")
    try:
        return parse(text, "readings")
    except FilterError:
        return parse(by_name, "readings")


@dataclass(frozen=True, slots=True)
class _Point:
    """What a series is of: a register or a named value of a unit."""

    bus: str
    unit: int
    place: str
    name: str | None

    def label(self, others: Iterable[_Point]) -> str:
        """Its name, with unit and bus in front where another one has the same."""
        label = self.name or f"unit {self.unit} {self.place}"
        alike = [one for one in others if one != self and one.name == self.name]
        if self.name and any(one.unit != self.unit for one in alike):
            label = f"unit {self.unit} {label}"
        if self.name and any((one.bus, one.unit) == (self.bus, self.unit) for one in alike):
            label = f"{label} ({self.place})"
        return f"{self.bus}: {label}" if any(one.bus != self.bus for one in others) else label


def _values(files: FileRun, wanted: Filter, stop_signals: StopSignals) -> tuple[Plot, Axis]:
    """The values by the name of the reading, by the finest axis that all of them have."""
    predicate = wanted.predicate()
    found: dict[_Point, Series] = {}
    at: dict[Axis, dict[_Point, list[float]]] = {axis: {} for axis in AXES}
    for batch in files.batches():
        rows = batch.readings.where(predicate)
        for txn, time, elapsed, bus, unit, kind, address, name, measure, value in rows.tuples(
            _COLUMNS, 0, len(rows)
        ):
            if not isinstance(value, int | float):
                continue
            place = f"{str(kind).replace('_', ' ')} {address}"
            point = _Point(str(bus), int(unit or 0), place, None if name is None else str(name))
            found.setdefault(point, Series(str(measure or ""))).values.append(float(value))
            seconds = None if elapsed is None else float(elapsed) / 1e6
            moments = (seconds_of(time), seconds, float(txn or 0))
            for axis, moment in zip(AXES, moments, strict=True):
                if moment is not None:
                    at[axis].setdefault(point, []).append(moment)
        if stop_signals.received():
            break
    if len(found) > MOST_SERIES:
        raise UsageError(
            f"plot: {len(found)} registers meet the condition, {MOST_SERIES} at most are drawn;"
            f" add a condition, such as address == {next(iter(found)).place.rpartition(' ')[2]}"
        )
    count = sum(len(series.values) for series in found.values())
    axis = next(one for one in AXES if sum(map(len, at[one].values())) == count)
    for point, series in found.items():
        series.at = at[axis].get(point, [])
    return {point.label(found): series for point, series in found.items()}, axis
