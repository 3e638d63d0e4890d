# ruff: noqa: E501 - tables
"""Ten kinds of devices with maps that others have published, for the accuracy of `modlens learn`.

The maps were looked up after the inference was written, in public repositories that name them:
Tinkerforge (SolarEdge battery), the Lambda and iDM integrations of Home Assistant, Keba P30,
Altivar, Seplos V3, Futura, Deep Sea (GenComm), PACE and DTSD422. A row has address, type, order,
role, scale, unit, quantity and the signal (`tests.support.plant_signals`).
"""

from __future__ import annotations

from tests.support.kind_rows import Item, Kind
from tests.support.kind_rows import bits as _b
from tests.support.kind_rows import constant as _k
from tests.support.kind_rows import counted as _c
from tests.support.kind_rows import measured as _m
from tests.support.kind_rows import state as _e

__all__ = ["KINDS"]


def _cells(first: int, count: int) -> tuple[Item, ...]:
    return tuple(_m(first + at, "u16", 0.001, "V", f"cell{at}") for at in range(count))


KINDS = {
    "solaredge_battery": Kind((("hr", 0xE16C, 28),), 5, (
        _m(0xE16C, "f32 CDAB", 1, "degC", "t_cell"), _m(0xE170, "f32 CDAB", 1, "V", "u_bat"),
        _m(0xE172, "f32 CDAB", 1, "A", "i_bat"), _m(0xE174, "f32 CDAB", 1, "W", "p_bat"),
        _c(0xE176, "u64 CDAB", 1, "Wh", "e_out"), _c(0xE17A, "u64 CDAB", 1, "Wh", "e_in"),
        _m(0xE184, "f32 CDAB", 1, "%", "soc"),
        _e(0xE186, "mode", "u32 CDAB"),
    )),
    "lambda_heat_pump": Kind((("hr", 0, 5), ("hr", 1000, 24)), 10, (
        _e(1, "mode"), _m(2, "s16", 0.1, "degC", "t_out"), _m(3, "s16", 0.1, "degC", "t_out_1h"),
        _k(4, "s16", 0.1, "degC", "fifteen"), _e(1003, "mode"),
        _m(1004, "s16", 0.01, "degC", "t_flow"), _m(1005, "s16", 0.01, "degC", "t_return"),
        _m(1006, "s16", 0.01, "l/min", "flow"), _m(1007, "s16", 0.01, "degC", "t_brine_in"),
        _m(1008, "s16", 0.01, "degC", "t_brine_out"), _m(1010, "u16", 0.01, "%", "percent"),
        _m(1011, "s16", 0.1, "kW", "kw_heat"), _m(1012, "s16", 1, "W", "p"),
        _m(1013, "s16", 0.01, None, "cop"), _k(1016, "s16", 0.1, "degC", "fifty"),
        _c(1020, "s32", 1, "Wh", "e"), _c(1022, "s32", 1, "Wh", "e_heat"),
    )),
    "keba_p30": Kind((("hr", 1000, 20), ("hr", 1020, 2), ("hr", 1036, 12), ("hr", 1502, 2)), 5, (
        _e(1000, "mode", "u32"), _e(1004, "cable", "u32"),
        _m(1008, "u32", 0.001, "A", "i1"), _m(1010, "u32", 0.001, "A", "i2"),
        _m(1012, "u32", 0.001, "A", "i3"), _k(1014, "u32", 1, None, "serial"),
        _m(1020, "u32", 0.001, "W", "p"), _c(1036, "u32", 0.1, "Wh", "e"),
        _m(1040, "u32", 1, "V", "u1"), _m(1042, "u32", 1, "V", "u2"), _m(1044, "u32", 1, "V", "u3"),
        _m(1046, "u32", 0.001, None, "pf"), _c(1502, "u32", 0.1, "Wh", "e_session"),
    )),
    "altivar": Kind((("hr", 3201, 16),), 2, (
        _b(3201, "bits"), _m(3202, "u16", 0.1, "Hz", "f_motor"), _m(3203, "u16", 0.1, "Hz", "f_ref"),
        _m(3204, "u16", 0.1, "A", "i_motor"), _m(3205, "s16", 0.1, "%", "torque"),
        _m(3207, "u16", 0.1, "V", "u_line"), _m(3208, "u16", 1, "V", "u_motor"),
        _m(3209, "u16", 1, "%", "thermal"), _m(3211, "s16", 1, "%", "percent"),
        _e(3206, "mode"), _c(3214, "u32", 1, "s", "seconds"),
    )),
    "seplos_v3": Kind((("ir", 0x1000, 18), ("ir", 0x1100, 26)), 5, (
        _m(0x1000, "u16", 0.01, "V", "u_bat"), _m(0x1001, "s16", 0.01, "A", "i_bat"),
        _m(0x1002, "u16", 0.01, "Ah", "ah"), _k(0x1003, "u16", 0.01, "Ah", "ah_full"),
        _k(0x1004, "u16", 10, "Ah", "ah_total"), _m(0x1005, "u16", 0.1, "%", "soc"),
        _k(0x1006, "u16", 0.1, "%", "soh"), _k(0x1007, "u16", 1, None, "cycles"),
        _m(0x1008, "u16", 0.001, "V", "cell_mean"), _m(0x1009, "u16", 0.1, "K", "t_kelvin"),
        _m(0x100A, "u16", 0.001, "V", "cell_max"), _m(0x100B, "u16", 0.001, "V", "cell_min"),
        *_cells(0x1100, 16), _m(0x1110, "u16", 0.1, "K", "t_kelvin"),
        _m(0x1111, "u16", 0.1, "K", "t_kelvin2"),
    )),
    "futura": Kind((("ir", 0, 20), ("ir", 30, 20)), 10, (
        _k(0, "u16", 1, None, "thirty_nine"), _k(1, "u32", 1, None, "serial"),
        _e(16, "mode", "u32"), _m(30, "s16", 0.1, "degC", "t_out"),
        _m(31, "s16", 0.1, "degC", "t_flow"), _m(32, "s16", 0.1, "degC", "t_room"),
        _m(33, "s16", 0.1, "degC", "t_return"), _m(34, "u16", 0.1, "%", "humidity"),
        _m(35, "u16", 0.1, "%", "humidity2"), _m(36, "u16", 0.1, "%", "humidity3"),
        _c(40, "u16", 1, "h", "hours"), _m(41, "u16", 1, "W", "p_fan"),
        _m(45, "u16", 1, "1/min", "rpm"), _m(46, "u16", 1, "1/min", "rpm2"),
        _m(47, "u16", 1, "ppm", "co2"),
    )),
    "deep_sea": Kind((("hr", 1024, 50), ("hr", 1798, 8)), 5, (
        _m(1024, "u16", 1, "kPa", "oil"), _m(1025, "s16", 1, "degC", "t_engine"),
        _m(1026, "s16", 1, "degC", "t_oil"), _m(1027, "u16", 1, "%", "fuel"),
        _m(1028, "u16", 0.1, "V", "u_24"), _m(1029, "u16", 0.1, "V", "u_24b"),
        _m(1030, "u16", 1, "1/min", "rpm"), _m(1031, "u16", 0.1, "Hz", "f"),
        _m(1032, "u32", 0.1, "V", "u1"), _m(1034, "u32", 0.1, "V", "u2"),
        _m(1036, "u32", 0.1, "V", "u3"), _m(1038, "u32", 0.1, "V", "u12"),
        _m(1040, "u32", 0.1, "V", "u23"), _m(1042, "u32", 0.1, "V", "u31"),
        _m(1044, "u32", 0.1, "A", "i1"), _m(1046, "u32", 0.1, "A", "i2"),
        _m(1048, "u32", 0.1, "A", "i3"), _m(1052, "s32", 1, "W", "p1"),
        _m(1054, "s32", 1, "W", "p2"), _m(1056, "s32", 1, "W", "p3"),
        _c(1798, "u32", 1, "s", "seconds"), _c(1800, "u32", 100, "Wh", "e"),
        _c(1804, "u32", 1, None, "starts"),
    )),
    "pace_bms": Kind((("hr", 0, 37),), 5, (
        _m(0, "s16", 0.01, "A", "i_bat"), _m(1, "u16", 0.01, "V", "u_bat"),
        _m(2, "u16", 1, "%", "soc"), _k(3, "u16", 1, "%", "soh"), _m(4, "u16", 0.01, "Ah", "ah"),
        _k(5, "u16", 0.01, "Ah", "ah_full"), _k(6, "u16", 0.01, "Ah", "ah_full"),
        _k(7, "u16", 1, None, "cycles"), _b(11, "bits"), *_cells(15, 16),
        _m(31, "s16", 0.1, "degC", "t_cell"), _m(32, "s16", 0.1, "degC", "t_cell2"),
        _m(35, "s16", 0.1, "degC", "t_mos"),
    )),
    "dtsd422": Kind((("hr", 1, 48),), 5, (
        _m(1, "u16", 0.1, "V", "u1"), _m(2, "u16", 0.1, "V", "u2"), _m(3, "u16", 0.1, "V", "u3"),
        _m(7, "s32", 0.001, "A", "i1"), _m(9, "s32", 0.001, "A", "i2"),
        _m(11, "s32", 0.001, "A", "i3"), _m(13, "s32", 1, "W", "p"), _m(15, "s32", 1, "W", "p1"),
        _m(17, "s32", 1, "W", "p2"), _m(19, "s32", 1, "W", "p3"),
        _m(35, "u16", 0.001, None, "pf"), _m(41, "u16", 0.01, "Hz", "f"),
        _c(42, "u32", 10, "Wh", "e"),
    )),
    "idm_navigator": Kind((("ir", 1000, 34), ("ir", 1050, 20), ("ir", 1748, 16), ("ir", 1790, 2)), 10, (
        _m(1000, "f32 CDAB", 1, "degC", "t_out"), _m(1002, "f32 CDAB", 1, "degC", "t_out_1h"),
        _e(1005, "mode"), _m(1008, "f32 CDAB", 1, "degC", "t_tank"),
        _m(1012, "f32 CDAB", 1, "degC", "t_dhw"), _m(1014, "f32 CDAB", 1, "degC", "t_dhw2"),
        _k(1032, "u16", 1, "degC", "fifty"), _m(1050, "f32 CDAB", 1, "degC", "t_flow"),
        _m(1052, "f32 CDAB", 1, "degC", "t_return"), _m(1056, "f32 CDAB", 1, "degC", "t_brine_in"),
        _m(1060, "f32 CDAB", 1, "degC", "t_room"), _c(1748, "f32 CDAB", 1, "kWh", "kwh_heat"),
        _c(1750, "f32 CDAB", 1, "kWh", "kwh"), _m(1790, "f32 CDAB", 1, "kW", "kw_heat"),
    )),
}  # fmt: skip
"""The kinds by name."""
