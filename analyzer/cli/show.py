"""`modlens show`.

Bytes beside meaning, for pasted hex or for one frame or transaction of a recording.
"""

from __future__ import annotations

import argparse
import io
import os

from analyzer.annotated import (
    DisplayedExchange,
    lookup_frame,
    lookup_packet,
    lookup_transaction,
    show,
)
from analyzer.cli.chosen_settings import settings
from analyzer.cli.file_input import file_run
from analyzer.cli.messages import Messages
from analyzer.cli.parser import add_decoding, add_line
from analyzer.cli.show_registers import add_place, show_registers
from analyzer.hex_text import frame_bytes, parse_hex
from analyzer.session import FileRun
from analyzer.settings import Settings
from analyzer.views.detail import show_frame
from analyzer.views.screen import Screen, stdout
from dissectors.describe import describe
from dissectors.errors import UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens show 01 03 00 6B 00 03 74 17
  modlens show :010300000001FB
  modlens show --pdu --direction response 03 06 022B 0000 0064
  modlens show bus.hex --txn 3
  modlens show bus.hex --at 3:hr:107 --as all
  modlens show plant.pcapng --packet 17
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("words", nargs="+", metavar="FILE|HEX", help="a recording, or hex text")
    parser.add_argument("--frame", type=int, metavar="N", help="show this frame of the recording")
    add_place(parser)
    parser.add_argument(
        "--txn", type=int, metavar="N", help="show this transaction of the recording"
    )
    parser.add_argument(
        "--packet",
        type=int,
        metavar="N",
        help="show the frame that starts in this packet of the capture",
    )
    parser.add_argument("--from", dest="read_as", metavar="FORMAT", help="format of the recording")
    parser.add_argument(
        "--pdu",
        action="store_true",
        help="the hex is a PDU only, without unit address and checksum",
    )
    parser.add_argument(
        "--direction",
        choices=("request", "response"),
        help="direction of the frame (default: detected)",
    )
    parser.add_argument(
        "--to",
        choices=("md",),
        metavar="FORMAT",
        help="md: between Markdown fences, for a ticket",
    )
    add_decoding(parser)
    add_line(parser)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Show it; gives the exit status."""
    screen = stdout()
    if options.to is None:
        _show(options, screen)
        return 0
    text = io.StringIO()
    _show(options, Screen(text, width=screen.width))
    screen.text(f"```text\n{text.getvalue()}```\n")
    return 0


def _show(options: argparse.Namespace, screen: Screen) -> None:
    """Draw what the options ask for."""
    if options.at is not None:
        if len(options.words) != 1 or options.frame is not None or options.txn is not None:
            raise UsageError("show: --at needs one recording, and neither --frame nor --txn")
        show_registers(options, screen)
    elif options.packet is not None:
        _show_packet(options, screen)
    elif options.frame is None and options.txn is None:
        _show_hex(options, screen)
    else:
        _show_recording(options, screen)


def _show_packet(options: argparse.Namespace, screen: Screen) -> None:
    """Draw the frames that begin in a packet of a capture."""
    if len(options.words) != 1 or options.pdu or (options.frame, options.txn) != (None, None):
        raise UsageError("show: --packet needs one capture, and none of --frame, --txn and --pdu")
    chosen = settings(options)
    run = FileRun(options.words, chosen, read_as=options.read_as)
    found = lookup_packet(run, options.words[0], options.packet)
    if not found:
        raise UsageError(
            f"show: no frame begins in packet {options.packet} of {options.words[0]}; it"
            f" may contain only the end of a frame, no payload, or no Modbus"
        )
    for number, exchange in enumerate(found):
        if number:
            screen.line("")
        show(exchange, screen, chosen.functions, options.direction)


def _show_recording(options: argparse.Namespace, screen: Screen) -> None:
    """Draw a frame or transaction of a recording; `UsageError` says how many there are."""
    if options.frame is not None and options.txn is not None:
        raise UsageError("show: use either --frame or --txn")
    if len(options.words) != 1 or options.pdu:
        raise UsageError("show: --frame and --txn need one recording")
    chosen = settings(options)
    messages = Messages(quiet=True)
    run = file_run(options, chosen, messages, files=options.words)
    if options.frame is not None:
        found = lookup_frame(run, options.frame)
    else:
        found = lookup_transaction(run, options.txn)
    if found is None:
        stats = run.stats()
        kind = "frame" if options.frame is not None else "transaction"
        counts = [bus["frames"] for bus in stats["buses"]]
        totals = counts if kind == "frame" else [stats["transactions"]]
        last = sum(sum(total.values()) for total in totals)
        wanted = options.frame if kind == "frame" else options.txn
        raise UsageError(f"show: there is no {kind} {wanted}; {options.words[0]} has 1 to {last}")
    show(found, screen, chosen.functions, options.direction)


def _show_hex(options: argparse.Namespace, screen: Screen) -> None:
    """Draw the frames, or the PDU, of hex text on the command line."""
    if len(options.words) == 1 and os.path.exists(options.words[0]):
        raise UsageError(
            f"show: add --frame N, --txn N or --packet N to choose from {options.words[0]}"
        )
    chosen = settings(options)
    text = " ".join(options.words)
    if options.pdu:
        pieces = describe(
            parse_hex(text),
            mode="pdu",
            direction=options.direction or "unknown",
            functions=chosen.functions,
        )
        show_frame("PDU", pieces, screen)
        return
    for number, found in enumerate(_decode_hex(text, options.mode, chosen)):
        if number:
            screen.line("")
        show(found, screen, chosen.functions, options.direction)


def _decode_hex(text: str, mode: str, chosen: Settings) -> list[DisplayedExchange]:
    """Decode pasted text like a recording; gives its frames."""
    data, mode = frame_bytes(text, mode)
    core = chosen.core(live=False)
    line = None if chosen.line is None else chosen.line.settings
    bus = core.add_bus("hex", source="hex", mode=mode, line=line)
    core.feed(bus, data)
    core.flush()
    batch = core.take()
    requests = {row.txn: row.request_hex for row in batch.transactions}
    return [
        DisplayedExchange.of_frame(
            row,
            request=requests.get(row.txn) if row.direction == "response" else None,
            findings=[found.as_dict() for found in batch.findings if found.frame == row.frame],
        )
        for row in batch.frames
    ]
