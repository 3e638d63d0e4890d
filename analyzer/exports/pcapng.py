"""pcapng that Wireshark opens without any configuration.

Every frame of the recording is a packet, noise included; a filter keeps all frames of the
transactions for which it holds. Names, line settings, times in nanoseconds, findings as comments,
error flags; what Wireshark has no place for is in a custom option of each packet.

The styles: `udp` decodes every function, with direction and pairing (Wireshark calls the protocol
Modbus/UDP); `rtu` calls it Modbus RTU, but guesses directions and leaves most functions undecoded;
`tcp` dresses serial traffic as Modbus/TCP for programs that know no other; `original` cuts the
packets out of the capture that was read, byte for byte.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from typing import ClassVar

import _modlens
from analyzer import exports
from analyzer.exports.original_packets import extract_packets
from analyzer.exports.output import Output
from analyzer.pump import PartialBatch
from analyzer.sources.pipes import STDIN
from dissectors.errors import UsageError

__all__ = ["Format"]

ORIGINAL = "original"


class Format(exports.MultiTableFormat):
    """A capture of frames."""

    tables = ("transactions", "frames")
    required_tables = ("frames", "transactions", "findings")
    styles: ClassVar[Sequence[str]] = ("udp", "rtu", "tcp", ORIGINAL)
    has_column_choice = False
    classic = False

    def __init__(self, options: exports.ExportOptions) -> None:
        super().__init__(options)
        if options.style == ORIGINAL and STDIN in options.buses:
            raise UsageError("--style original: standard input cannot be read twice; name a file")
        self._selection = _PacketSelection(options) if options.style == ORIGINAL else None
        self._output: Output | None = None
        style = self.styles[0] if self._selection else options.style or self.styles[0]
        self._capture = _modlens.Capture(
            style, classic=self.classic, live=options.live, context=options.context
        )

    def output(self, path: str | None, *, growing: bool) -> Output:
        """Open the file; it is kept because `footer` writes to it in the style `original`."""
        if self._selection is not None and growing:
            raise UsageError("--style original needs a capture file; a tap has none, use --record")
        self._output = super().output(path, growing=growing)
        return self._output

    def encode_batch(self, batch: _modlens.Batch, kept: _modlens.Table | None) -> Iterable[bytes]:
        """Encode the packets that are complete.

        Findings on a transaction may come later than it.
        """
        if self._selection is not None:
            self._selection.add(batch, kept)
            return ()
        if isinstance(batch, PartialBatch):
            rows: _modlens.Table = getattr(batch, self.options.table)
            batch, kept = batch.whole, rows if kept is None else kept
        self._capture.put(batch, kept)
        return iter(self._capture.more, b"")

    def footer(self) -> bytes:
        """The remaining packets."""
        if self._selection is None:
            return self._capture.end()
        if self._output is not None:
            for name, packets in self._selection.packets().items():
                for block in extract_packets(name, packets):
                    self._output.append(block)
        return b""


class _PacketSelection:
    """The packets of all frames, and which frames are wanted, for the style `original`.

    They are kept in arrays of numbers, because which packets are wanted is known at the end only.
    """

    def __init__(self, options: exports.ExportOptions) -> None:
        self._wish = options
        self._filtered = False
        self._kept: set[int] = set()
        self._files: list[str] = []
        self._places = {key: array("q") for key in ("frame", "txn", "file", "packet")}
        self._further_packets: dict[int, list[int]] = {}

    def add(self, batch: _modlens.Batch, kept: _modlens.Table | None) -> None:
        """Add the frames of a batch, and the rows that match the filter."""
        for name, frame, txn, packets in batch.frames.origins():
            if not self._files or self._files[-1] != name:
                self._files.append(name)
            if packets[1:]:
                self._further_packets[len(self._places["packet"])] = packets[1:]
            place = (frame, txn or 0, len(self._files) - 1, packets[0])
            for numbers, number in zip(self._places.values(), place, strict=True):
                numbers.append(number)
        if kept is not None:
            self._filtered = True
            key = "txn" if self._wish.table == "transactions" else "frame"
            self._kept.update(int(number or 0) for (number,) in kept.tuples([key]))

    def packets(self) -> dict[str, set[int]]:
        """File -> numbers of its wanted packets, with those of the frames around (`context`)."""
        keys = self._places["txn" if self._wish.table == "transactions" else "frame"]
        context = self._wish.context
        found: dict[str, set[int]] = {name: set() for name in self._files}
        for at, key in enumerate(keys):
            if self._filtered and key not in self._kept:
                continue
            for other in range(max(at - context, 0), min(at + context + 1, len(keys))):
                packets = found[self._files[self._places["file"][other]]]
                packets.add(self._places["packet"][other])
                packets.update(self._further_packets.get(other, ()))
        return found
