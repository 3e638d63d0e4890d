"""`modbus_detailed.log` of CISA's icsnpp-modbus: a line a transaction, with its values."""

from __future__ import annotations

from analyzer.exports import zeek

__all__ = ["Format"]


class Format(zeek.Format):
    """A log in the form of icsnpp-modbus."""

    log = "modbus_detailed"
