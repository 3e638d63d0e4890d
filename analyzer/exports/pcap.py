"""Classic pcap with times in nanoseconds: no names, comments or flags; better take pcapng."""

from __future__ import annotations

from analyzer.exports import pcapng

__all__ = ["Format"]


class Format(pcapng.Format):
    """A classic capture of frames."""

    styles = ("udp", "rtu", "tcp")
    classic = True
