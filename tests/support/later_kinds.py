# ruff: noqa: E501 - tables
"""Seven kinds of devices more, modelled after the inference was changed on the others.

Looked up in public repositories that name the maps: EM530 (Carlo Gavazzi), Deye (string inverter),
Xintai (water meter), Countis (Socomec), Tracer (EPEVER), GoodWe (EMS) and Quasar (Wallbox). Rows
are those of `tests.support.kind_rows`; where the plant has no such signal, one alike stands for
it.
"""

from __future__ import annotations

from tests.support.kind_rows import Kind
from tests.support.kind_rows import counted as _c
from tests.support.kind_rows import measured as _m
from tests.support.kind_rows import state as _e

__all__ = ["KINDS"]

KINDS = {
    "em530": Kind((("hr", 0, 64),), 5, (
        *(_m(2 * at, "u32", 0.1, "V", f"u{at + 1}") for at in range(3)),
        _m(6, "u32", 0.1, "V", "u12"), _m(8, "u32", 0.1, "V", "u23"), _m(10, "u32", 0.1, "V", "u31"),
        *(_m(12 + 2 * at, "u32", 0.001, "A", f"i{at + 1}") for at in range(3)),
        *(_m(18 + 2 * at, "s32", 0.1, "W", f"p{at + 1}") for at in range(3)),
        _m(40, "s32", 0.1, "W", "p"), _m(49, "s16", 0.001, None, "pf"), _m(51, "u16", 0.1, "Hz", "f"),
        _c(52, "u32", 0.1, "kWh", "kwh"), _c(60, "u32", 0.1, "kWh", "kwh_heat"),
    )),
    "deye_string": Kind((("hr", 59, 54),), 10, (
        _e(59, "mode"), _c(60, "u16", 0.1, "kWh", "e_day"), _c(63, "u32 CDAB", 0.1, "kWh", "kwh"),
        *(_m(73 + at, "u16", 0.1, "V", f"u{at + 1}") for at in range(3)),
        *(_m(76 + at, "u16", 0.1, "A", f"i{at + 1}") for at in range(3)),
        _m(79, "u16", 0.01, "Hz", "f"), _m(80, "u32 CDAB", 0.1, "W", "p"), _m(86, "u32 CDAB", 0.1, "W", "p"),
        _m(90, "u16", 0.1, "degC", "t_engine"), _m(91, "u16", 0.1, "degC", "t_oil"),
        _m(109, "u16", 0.1, "V", "u_line"), _m(110, "u16", 0.1, "A", "i_motor"),
    )),
    "xintai_water": Kind((("hr", 1, 14),), 10, (
        _c(1, "f32 DCBA", 1, "m3", "volume"), _m(5, "f32 DCBA", 1, "m3/h", "flow"), _e(7, "cable"),
        _m(10, "f32 DCBA", 1, "MPa", "u_24"), _m(12, "f32 DCBA", 1, "degC", "t_return"),
    )),
    "countis": Kind((("hr", 0xC550, 66),), 10, (
        _c(0xC550, "u32", 0.01, "h", "hours"),
        *(_m(0xC552 + 2 * at, "u32", 0.01, "V", name) for at, name in enumerate(("u12", "u23", "u31", "u1", "u2", "u3"))),
        _m(0xC55E, "u32", 0.01, "Hz", "f"), *(_m(0xC560 + 2 * at, "u32", 0.001, "A", f"i{at + 1}") for at in range(3)),
        _m(0xC568, "s32", 10, "W", "p"), _m(0xC56E, "s32", 0.001, None, "pf"),
        *(_m(0xC570 + 2 * at, "s32", 10, "W", f"p{at + 1}") for at in range(3)),
    )),
    "epever": Kind((("ir", 0x3100, 28), ("ir", 0x3300, 20)), 5, (
        _m(0x3100, "u16", 0.01, "V", "u_bat"), _m(0x3101, "u16", 0.01, "A", "i_motor"),
        _m(0x3102, "u32 CDAB", 0.01, "W", "p"), _m(0x3104, "u16", 0.01, "V", "u_24"),
        _m(0x310C, "u16", 0.01, "V", "u_24b"), _m(0x310D, "u16", 0.01, "A", "i1"), _m(0x310E, "u32 CDAB", 0.01, "W", "p1"),
        _m(0x3110, "s16", 0.01, "degC", "t_out"), _m(0x3111, "s16", 0.01, "degC", "t_flow"), _m(0x311A, "u16", 1, "%", "soc"),
        _c(0x330A, "u32 CDAB", 0.01, "kWh", "kwh"), _c(0x3312, "u32 CDAB", 0.01, "kWh", "kwh_heat"),
    )),
    "goodwe_ems": Kind((("hr", 45103, 40),), 5, (
        _m(45103, "u16", 0.1, "V", "u_line"), _m(45104, "u16", 0.1, "A", "i_motor"), _m(45105, "u32", 1, "W", "p"),
        _m(45107, "u16", 0.1, "V", "u_motor"), _m(45108, "u16", 0.1, "A", "i3"), _m(45109, "u32", 1, "W", "p3"),
        *(_m(45121 + 5 * at, "u16", 0.1, "V", f"u{at + 1}") for at in range(3)),
        *(_m(45122 + 5 * at, "u16", 0.1, "A", f"i{at + 1}") for at in range(3)),
        *(_m(45123 + 5 * at, "u16", 0.01, "Hz", "f") for at in range(3)),
        *(_m(45124 + 5 * at, "s32", 1, "W", f"p_signed{at + 1}") for at in range(3)),
        _e(45136, "mode"), _m(45138, "s32", 1, "W", "p_bat"), _m(45140, "s16", 1, "W", "p_bat"),
    )),
    "quasar": Kind((("hr", 514, 26),), 5, (
        _m(514, "u16", 1, "A", "i1"), _m(526, "s16", 1, "W", "p_bat"), _e(537, "mode"), _m(538, "u16", 1, "%", "soc"),
        _m(539, "u16", 1, None, "bits", "bit field"),
    )),
}  # fmt: skip
"""The kinds by name."""
