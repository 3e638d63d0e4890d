r"""modlens: a passive Modbus analyzer, from a wire or a recording to transactions.

>>> from analyzer import decode
>>> import pathlib, tempfile
>>> path = pathlib.Path(tempfile.mkdtemp()) / "bus.hex"
>>> _ = path.write_text("11 03 006B 0003 7687\n11 03 06 022B 0000 0064 C8BA\n")
>>> for transaction in decode(path):
...     print(transaction.unit, transaction.function_name, transaction.data, transaction.status)
17 Read Holding Registers [555, 0, 100] ok

`decode(...)` has `.transactions`, `.frames`, `.readings` and `.findings`; each can be iterated,
filtered by `.where`, and handed to anything that takes Arrow streams (`polars.DataFrame(rows)`,
`pyarrow.table(rows)`, duckdb). `tap(port)` gives transactions as they happen on a serial line.
Importing this package loads no serial port, screen or capture library.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from analyzer.api import Decoding, Tap, decode, tap
    from analyzer.rows import Rows
    from dissectors.errors import (
        CaptureError,
        FilterError,
        ModlensError,
        ModlensWarning,
        PortError,
        ProfileError,
        SourceError,
        UsageError,
    )

__all__ = [
    "CaptureError",
    "Decoding",
    "FilterError",
    "ModlensError",
    "ModlensWarning",
    "PortError",
    "ProfileError",
    "Rows",
    "SourceError",
    "Tap",
    "UsageError",
    "decode",
    "tap",
]

_HOMES = {"Rows": "analyzer.rows"} | dict.fromkeys(
    ("Decoding", "Tap", "decode", "tap"), "analyzer.api"
)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used, so that the command line starts without them."""
    if name not in __all__:
        raise AttributeError(f"module 'analyzer' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES.get(name, "dissectors.errors")), name)
    globals()[name] = value
    return value
