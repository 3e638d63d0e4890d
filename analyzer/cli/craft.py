"""`modlens craft`: build the bytes of a frame from keywords and print them; nothing is sent."""

from __future__ import annotations

import argparse

from analyzer.cli.parser import add_functions, load_functions
from analyzer.views.screen import stdout
from dissectors.craft import craft, craft_pdu
from dissectors.errors import UsageError
from dissectors.function_lookup import parse_number
from dissectors.table import Direction

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
    frame = _frame(options)
    if options.to == "raw":
        from analyzer.exports.output import StandardOutput  # noqa: PLC0415

        StandardOutput().append(frame)
        return 0
    text = frame.decode("ascii").rstrip() if options.mode == "ascii" else frame.hex(" ").upper()
    stdout().line(text)
    return 0


def _frame(options: argparse.Namespace) -> bytes:
    """The frame, or with `--mode pdu` the PDU, that the options describe."""
    values: dict[str, object] = dict(_pair(text) for text in options.values)
    unit = _integer("unit", values.pop("unit", 1))
    mbap_id = _integer("mbap_id", values.pop("mbap_id", 1))
    direction: Direction = "response" if options.response else "request"
    functions = load_functions(options.functions)
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
        raise UsageError(f"craft: {name}={value}: a number is needed")
    return found
