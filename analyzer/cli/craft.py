"""`modlens craft`: build a frame from a function and its field values; nothing is sent.

What the specification does not permit is crafted all the same, to test devices with it, but told on
standard error.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import _modlens
from analyzer.cli.chosen_settings import load_functions
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_functions
from analyzer.views.screen import stdout
from dissectors.craft import craft, craft_pdu
from dissectors.describe import describe
from dissectors.errors import UsageError
from dissectors.function_lookup import parse_number
from dissectors.table import Direction, Function, function

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens craft read-holding-registers unit=1 address=107 quantity=3
  modlens craft 16 unit=17 address=1 registers=10,258
  modlens craft 3 unit=1 exception=2 --response
  modlens craft 3 unit=1 address=0 quantity=1 --mode ascii
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("function", metavar="FUNCTION", help="function code or name")
    parser.add_argument(
        "values", nargs="*", metavar="NAME=VALUE", help="the unit and the fields of the function"
    )
    parser.add_argument(
        "--response", action="store_true", help="build a response (default: a request)"
    )
    parser.add_argument(
        "--mode",
        choices=("rtu", "ascii", "tcp", "pdu"),
        default="rtu",
        help="framing (default: rtu)",
    )
    parser.add_argument(
        "--to",
        choices=("hex", "raw"),
        default="hex",
        help="write hex text or raw bytes (default: hex)",
    )
    add_functions(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Print the frame; gives the exit status."""
    functions = load_functions(options.functions)
    frame = _frame(options, functions)
    for fault in _faults(frame, options, functions):
        Messages(quiet=False).info(f"not permitted: {fault}")
    if options.to == "raw":
        from analyzer.exports.output import StandardOutput  # noqa: PLC0415

        StandardOutput().append(frame)
        return 0
    text = frame.decode("ascii").rstrip() if options.mode == "ascii" else frame.hex(" ").upper()
    stdout().line(text)
    return 0


def _faults(
    frame: bytes, options: argparse.Namespace, functions: _modlens.Functions
) -> Iterator[str]:
    """What the specification does not permit in the frame, a line each."""
    direction: Direction = "response" if options.response else "request"
    pieces = describe(frame, mode=options.mode, direction=direction, functions=functions)
    for piece in pieces:
        if not piece.is_valid:
            head = f"{piece.name} {piece.value}"
            yield piece.meaning if piece.meaning.startswith(head) else f"{head}: {piece.meaning}"
    numbers = {piece.name: piece.value for piece in pieces}
    if options.mode in ("rtu", "ascii") and numbers.get("unit") == "0":
        row = _row(numbers.get("function", ""), functions)
        if direction == "response" or (row is not None and row.operation == "read"):
            yield "unit 0: nothing is read by broadcast, and no unit responds to it"


def _row(code: str, source: _modlens.Functions) -> Function | None:
    """The row of a function code as `describe` prints it; None where the table has none."""
    try:
        return function(int(code, 0), source=source)
    except (KeyError, ValueError):
        return None


def _frame(options: argparse.Namespace, functions: _modlens.Functions) -> bytes:
    """The frame, or with `--mode pdu` the PDU, that the options describe."""
    values: dict[str, object] = dict(_pair(text) for text in options.values)
    unit = _integer("unit", values.pop("unit", 1))
    mbap_id = _integer("mbap_id", values.pop("mbap_id", 1))
    direction: Direction = "response" if options.response else "request"
    if options.mode == "pdu":
        return craft_pdu(options.function, direction=direction, values=values, functions=functions)
    return craft(
        options.function,
        unit=unit,
        direction=direction,
        mode=options.mode,
        values=values,
        mbap_id=mbap_id,
        functions=functions,
    )


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise UsageError(
            f"craft: {text!r}: write a field as name=value, such as unit=1 or address=107"
        )
    return name.strip(), value.strip()


def _integer(name: str, value: object) -> int:
    found = value if isinstance(value, int) else parse_number(str(value))
    if found is None:
        raise UsageError(f"craft: {name}={value}: not a number")
    return found
