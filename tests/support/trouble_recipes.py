"""Recordings of lines with one trouble each; the plays are in `tests.support.trouble_scenarios`."""

from __future__ import annotations

from collections.abc import Mapping

from tests.support import trouble_scenarios as scenarios
from tests.support.recipe import Recipe

__all__ = ["TROUBLE_RECIPES"]

TROUBLE_RECIPES: Mapping[str, Recipe] = {
    "pymodbus_register_hole": Recipe(
        "Unit 1 has no register 23: reads of 10 to 39 are refused with exception 2, the parts "
        "below and above it are answered. Unit 2 is well.",
        scenarios.hole,
        line="57600-8E1",
    ),
    "pymodbus_block_too_long": Recipe(
        "Unit 1 refuses reads of more than 32 registers with exception 3; unit 2 answers 40.",
        scenarios.too_long,
        line="57600-8E1",
    ),
    "pymodbus_address_off_by_one": Recipe(
        "Reads of 11 registers from 50 on are refused with exception 2, since 60 does not exist; "
        "from 49 on they are answered.",
        scenarios.off_by_one,
        line="57600-8E1",
    ),
    "pymodbus_wrong_function": Recipe(
        "Addresses 100 to 111 of unit 1 are input registers: function 3 is refused with exception "
        "2, function 4 is answered. Function 3 is answered at other addresses.",
        scenarios.wrong_function,
        line="57600-8E1",
    ),
    "pymodbus_device_busy": Recipe(
        "Unit 2 answers exception 6 when it was asked less than 40 ms ago: the second and third of "
        "three reads in a row.",
        scenarios.busy,
        line="57600-8E1",
    ),
    "pymodbus_dead_unit": Recipe(
        "Units 1 and 2 answer, unit 3 is on the poll list and not on the bus: each cycle waits 150 "
        "ms for it.",
        scenarios.dead,
        line="57600-8E1",
    ),
    "pymodbus_device_absent": Recipe(
        "Unit 2 answers, is without supply for 20 requests, and answers again.",
        scenarios.absent,
        line="57600-8E1",
    ),
    "pymodbus_repeated_write": Recipe(
        "A master that writes the same three values to registers 40 to 42 of unit 2 in each cycle.",
        scenarios.writer,
        line="57600-8E1",
    ),
    "pymodbus_value_spikes": Recipe(
        "Unit 2 gives FFFF in all registers of each seventeenth answer, with a right checksum; "
        "otherwise its values are waves.",
        scenarios.spikes,
        line="57600-8E1",
    ),
    "pymodbus_full_line": Recipe(
        "Three units with reads of 60 registers at 9600 baud, one behind the other: the line is "
        "never free for longer than a few characters.",
        scenarios.saturated,
        line="9600-8E1",
    ),
    "pymodbus_slow_unit": Recipe(
        "Unit 2 takes 100 to 190 ms for an answer, the master waits 150 ms: two of nine answers "
        "come after it has given up.",
        scenarios.slow,
        line="57600-8E1",
    ),
    "pymodbus_stray_bytes": Recipe(
        "A stray 00 behind each third answer of unit 2, as an unbiased line leaves it when the "
        "driver is switched off.",
        scenarios.strays,
        line="57600-8E1",
    ),
    "pymodbus_late_driver": Recipe(
        "Unit 2 answers after 1 to 30 ms. Where it answers sooner than 9 ms after the request, "
        "the first byte is lost, as by a driver that is enabled too late.",
        scenarios.late_driver,
        line="57600-8E1",
    ),
    "pymodbus_too_fast": Recipe(
        "Unit 2 does not answer requests that come within 25 ms of the frame before; the master "
        "pauses for 5 to 75 ms.",
        scenarios.too_fast,
        line="57600-8E1",
    ),
    "pymodbus_two_with_one_address": Recipe(
        "Two devices have the address 2 and answer at the same time: the AND of two valid frames.",
        scenarios.two_with_one_address,
        line="57600-8E1",
    ),
}
