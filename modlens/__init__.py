r"""modlens: decode Modbus recordings, and listen to serial lines, from a program.

>>> import modlens
>>> recording = modlens.decode(bytes.fromhex("1103006B00037687 110306022B00000064C8BA"))
>>> for transaction in recording:
...     print(transaction.unit, transaction.function_name, transaction.data, transaction.status)
17 Read Holding Registers [555, 0, 100] ok

`decode` takes files, bytes and open files; `tap` listens to a port. What they give is described in
`analyzer.api` and `analyzer.rows`: tables that can be filtered, cut, counted, looked at in a
notebook, handed to polars, pandas, pyarrow and duckdb, and written to files.
"""

from typing import TYPE_CHECKING, NoReturn

from _modlens import __version__
from analyzer import (
    CaptureError,
    Decoding,
    FilterError,
    ModlensError,
    ModlensWarning,
    PortError,
    ProfileError,
    Rows,
    SourceError,
    Tap,
    UsageError,
    decode,
    tap,
)
from analyzer.row_types import DiagnosisRow, FindingRow, FrameRow, ReadingRow, TransactionRow

__all__ = [
    "CaptureError",
    "Decoding",
    "DiagnosisRow",
    "FilterError",
    "FindingRow",
    "FrameRow",
    "ModlensError",
    "ModlensWarning",
    "PortError",
    "ProfileError",
    "ReadingRow",
    "Rows",
    "SourceError",
    "Tap",
    "TransactionRow",
    "UsageError",
    "__version__",
    "decode",
    "tap",
]

if not TYPE_CHECKING:  # A type checker shall find names that there are not.
    _INSTEAD = {
        **dict.fromkeys(("load", "open", "parse", "read", "read_file"), 'decode("bus.log")'),
        **dict.fromkeys(("listen", "listen_to", "monitor", "sniff"), 'tap("/dev/ttyUSB0")'),
    }

    def __getattr__(name: str) -> NoReturn:
        """Say what to write instead of a name that there is not."""
        instead = f"; write modlens.{_INSTEAD[name]}" if name in _INSTEAD else ""
        raise AttributeError(f"module 'modlens' has no attribute {name!r}{instead}")
