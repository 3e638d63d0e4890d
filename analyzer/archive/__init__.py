"""Many recordings of many buses, file by file side by side: exported, examined, distinguished.

`recordings` says which files there are and of which bus, `manifest` which of them a folder of
exports has already, `folder` writes such a folder, `side_by_side` runs the work, `days` makes a row
for each bus and day.
"""

from __future__ import annotations

__all__ = ["BUS_NAMES"]

BUS_NAMES = ("folder", "stem", "path")
"""What names the bus of a recording that does not name it: see `recordings.name_of_bus`."""
