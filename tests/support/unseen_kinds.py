# ruff: noqa: E501 - tables
"""Five kinds of devices more, modelled after the inference was changed on all others.

Looked up in public repositories that name the maps: Plenticore (Kostal), WPM (Stiebel Eltron ISG),
CHARX (Phoenix Contact), Venus (Marstek) and iEM3155 (Schneider). Rows are those of
`tests.support.kind_rows`; where the plant has no such signal, one alike stands for it.
"""

from __future__ import annotations

from tests.support.kind_rows import Kind
from tests.support.kind_rows import constant as _k
from tests.support.kind_rows import counted as _c
from tests.support.kind_rows import measured as _m
from tests.support.kind_rows import state as _e

__all__ = ["KINDS"]

_F = "f32 CDAB"

KINDS = {
    "plenticore": Kind((("hr", 100, 26), ("hr", 144, 36), ("hr", 190, 28), ("hr", 320, 8), ("hr", 575, 8)), 5, (
        _m(100, _F, 1, "W", "p_bat"), _e(104, "mode", _F), _m(106, _F, 1, "W", "p1"), _m(108, _F, 1, "W", "p2"),
        _c(110, _F, 1, "Wh", "e_out"), _c(112, _F, 1, "Wh", "e_in"), _c(114, _F, 1, "Wh", "e"), _m(116, _F, 1, "W", "p3"),
        _c(118, _F, 1, "Wh", "e_heat"), _k(122, _F, 1, "%", "fifty"), _c(144, _F, 1, "s", "seconds"),
        _m(150, _F, 1, None, "pf"), _m(152, _F, 1, "Hz", "f"),
        *(_m(154 + 6 * at, _F, 1, "A", f"i{at + 1}") for at in range(3)),
        *(_m(156 + 6 * at, _F, 1, "W", f"p{at + 1}") for at in range(3)),
        *(_m(158 + 6 * at, _F, 1, "V", f"u{at + 1}") for at in range(3)),
        _m(172, _F, 1, "W", "p"), _k(194, _F, 1, None, "cycles"), _m(200, _F, 1, "A", "i_bat"), _m(210, _F, 1, "%", "soc"),
        _m(214, _F, 1, "degC", "t_cell"), _m(216, _F, 1, "V", "u_bat"),
        _c(320, _F, 1, "Wh", "e"), _c(322, _F, 1, "kWh", "e_day"), _m(575, "s16", 1, "W", "p"), _c(577, "u32 CDAB", 1, "Wh", "e"),
        _m(582, "s16", 1, "W", "p_bat"),
    )),
    "stiebel_wpm": Kind((("ir", 500, 48), ("ir", 2500, 4)), 10, (
        _m(502, "s16", 0.1, "degC", "t_room"), _k(503, "s16", 0.1, "degC", "fifteen"), _m(504, "s16", 0.1, "%", "humidity"),
        _m(506, "s16", 0.1, "degC", "t_out"), _m(507, "s16", 0.1, "degC", "t_flow"), _k(509, "s16", 0.1, "degC", "fifty"),
        _m(514, "s16", 0.1, "degC", "t_flow"), _m(515, "s16", 0.1, "degC", "t_return"), _m(517, "s16", 0.1, "degC", "t_tank"),
        _m(519, "s16", 0.01, "bar", "u_bat"), _m(520, "s16", 0.01, "l/min", "flow"), _m(521, "s16", 0.1, "degC", "t_dhw"),
        _k(522, "s16", 0.1, "degC", "fifty"), _m(535, "s16", 0.1, "degC", "t_brine_in"), _m(537, "s16", 0.01, "bar", "u_24"),
        _m(541, "s16", 0.1, "degC", "t_return"), _m(542, "s16", 0.1, "degC", "t_flow"), _m(543, "s16", 0.1, "degC", "t_engine"),
        _m(544, "s16", 0.01, "bar", "cell_mean"), _m(546, "s16", 0.01, "bar", "u_24b"), _m(547, "s16", 0.1, "l/min", "flow"),
        _m(2500, "u16", 1, None, "bits", "bit field"), _e(2501, "mode"),
    )),
    "charx": Kind((("hr", 1232, 34), ("hr", 1287, 16)), 5, (
        *(_m(1232 + 2 * at, "s32", 0.001, "V", f"u{at + 1}") for at in range(3)),
        *(_m(1238 + 2 * at, "s32", 0.001, "A", f"i{at + 1}") for at in range(3)),
        _m(1244, "s32", 0.001, "W", "p"), _c(1250, "s64", 1, "Wh", "e"), _m(1264, "u16", 1, "%", "soc"),
        _c(1287, "u32", 1, "s", "seconds"), _c(1289, "u32", 1, "Wh", "e_session"), _e(1299, "cable"), _k(1301, "u16", 1, "A", "fifteen"),
    )),
    "venus": Kind((("hr", 32100, 6), ("hr", 32200, 5), ("hr", 33000, 8), ("hr", 35000, 3), ("hr", 35100, 1), ("hr", 37007, 2)), 10, (
        _m(32100, "u16", 0.01, "V", "u_bat"), _m(32101, "s16", 0.01, "A", "i_bat"), _m(32102, "s32", 1, "W", "p_bat"),
        _m(32104, "u16", 1, "%", "soc"), _k(32105, "u16", 0.001, "kWh", "ah_total"), _m(32200, "u16", 0.1, "V", "u1"),
        _m(32201, "s16", 0.01, "A", "i1"), _m(32202, "s32", 1, "W", "p1"), _m(32204, "s16", 0.01, "Hz", "f"),
        _c(33000, "u32", 0.01, "kWh", "kwh"), _c(33002, "s32", 0.01, "kWh", "kwh_heat"), _c(33004, "u32", 0.01, "kWh", "e_day"),
        _m(35000, "s16", 0.1, "degC", "t_cell"), _m(35001, "s16", 0.1, "degC", "t_mos"), _m(35002, "s16", 0.1, "degC", "t_cell2"),
        _e(35100, "mode"), _m(37007, "s16", 0.001, "V", "cell_max"), _m(37008, "s16", 0.001, "V", "cell_min"),
    )),
    "iem3155": Kind((("hr", 2999, 6), ("hr", 3019, 14), ("hr", 3053, 8), ("hr", 3083, 2), ("hr", 3109, 2), ("hr", 3203, 4)), 5, (
        *(_m(2999 + 2 * at, "f32", 1, "A", f"i{at + 1}") for at in range(3)),
        *(_m(3019 + 2 * at, "f32", 1, "V", name) for at, name in enumerate(("u12", "u23", "u31"))),
        *(_m(3027 + 2 * at, "f32", 1, "V", f"u{at + 1}") for at in range(3)),
        *(_m(3053 + 2 * at, "f32", 1, "kW", f"kw{at + 1}") for at in range(3)), _m(3059, "f32", 1, "kW", "kw"),
        _m(3083, "f32", 1, None, "pf"), _m(3109, "f32", 1, "Hz", "f"), _c(3203, "s64", 1, "Wh", "e"),
    )),
}  # fmt: skip
"""The kinds by name."""
