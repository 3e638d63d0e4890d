"""All kinds and counter-cases: importing this file enters them.

`make("lockstep", 1)` makes the recordings of one, `KINDS` has their names.
"""

from __future__ import annotations

import tests.doctor.kinds.connections
import tests.doctor.kinds.damage
import tests.doctor.kinds.gateways
import tests.doctor.kinds.layouts
import tests.doctor.kinds.register_maps
import tests.doctor.kinds.silences
import tests.doctor.kinds.strangers
import tests.doctor.kinds.values_written  # noqa: F401 - importing enters them
from tests.doctor.case import COUNTER_CASES, KINDS, Case, Expected, make

__all__ = ["COUNTER_CASES", "KINDS", "Case", "Expected", "make"]
