"""What the doctor does not tell yet, by what is examined. Each entry is a debt.

`python -m tests.doctor.score` says how often each kind is right; here is what fails with the seeds
of the tests. Whoever mends one takes its entry away.
"""

from __future__ import annotations

from collections.abc import Iterable

import pytest
from _pytest.mark import ParameterSet

__all__ = ["NOT_YET", "marked"]

NOT_YET = frozenset(
    {
        # kinds
        "lockstep",
        "no_bias",
        "two_masters",
        "swapped_wires",
        # near confusions
        "a float that straddles two quantities",
        # captures
        "pymodbus_mixed_answers",
        "pymodbus_two_masters",
        "pymodbus_two_with_one_address",
        "pymodbus_wrong_function",
        # other views of the same traffic
        "views of device_absent",
        "views of slow_answers",
    }
)


def marked(names: Iterable[str], about: str = "") -> list[ParameterSet]:
    """Parameters of a test; those that are known to fail are expected to."""
    fails = pytest.mark.xfail(reason="the doctor does not tell it yet", strict=False)
    return [
        pytest.param(name, id=name, marks=[fails] if f"{about}{name}" in NOT_YET else [])
        for name in names
    ]
