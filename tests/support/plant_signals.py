# ruff: noqa: E501 - tables
"""What happens in a plant over time: mains, a load, a battery, a heat pump, a motor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from random import Random

__all__ = ["signals"]

DAY = 86_400


class _Drift:
    """A quantity that wanders about a mean."""

    def __init__(self, rng: Random, mean: float, spread: float, seconds: float) -> None:
        self._rng, self._mean, self._spread, self._tau = rng, mean, spread, seconds
        self.now = mean + spread * rng.gauss(0, 0.7)

    def step(self, seconds: float) -> float:
        """The value after some seconds."""
        pull = 1 - math.exp(-seconds / self._tau)
        self.now += pull * (self._mean - self.now)
        self.now += self._spread * math.sqrt(2 * pull) * self._rng.gauss(0, 0.7)
        return self.now


def signals(seed: int, seconds: int) -> Iterator[dict[str, float]]:
    """The values of all signals, every so many seconds, from ten in the morning on."""
    rng = Random(seed)
    drift = {
        name: _Drift(rng, *shape)
        for name, shape in {
            "u1": (230, 1.5, 300), "u2": (231, 1.5, 300), "u3": (229, 1.5, 300),
            "f": (50, 0.02, 60), "load": (6, 3, 900), "share": (0, 0.2, 600), "bat": (5, 30, 1200),
            "t_out": (6, 2, 7200), "t_flow": (38, 3, 1200), "t_room": (21.5, 0.4, 3600),
            "hum": (46, 6, 3600), "rpm": (1480, 25, 120), "motor": (42, 6, 300), "co2": (720, 150, 1800),
            "cell": (3.29, 0.015, 2400), "noise": (0, 1, 20), "oil": (410, 12, 200),
        }.items()
    }  # fmt: skip
    offsets = [rng.gauss(0, 0.006) for _ in range(16)]
    start = {name: 10 ** rng.uniform(5.2, 7.6) for name in ("e", "e_heat", "e_out", "e_in")}
    total, soc, mode, cable, starts, dwell = dict(start), rng.uniform(45, 75), 2, 3, 812, 0.0
    bits, hours, clock = 0x0027, rng.randrange(900, 9000), float(rng.randrange(10**6, 10**7))
    serial, session, at = rng.randrange(10**7, 10**8), 0.0, 0.0
    while True:
        at += seconds
        now = {name: one.step(seconds) for name, one in drift.items()}
        dwell -= seconds
        if dwell < 0:
            mode, dwell = rng.choice([1, 2, 3, 5]), rng.expovariate(1 / 500) + 60
            starts += mode == 2
            bits ^= 1 << rng.randrange(8)
        if rng.random() < seconds / 2500:
            cable = rng.choice([0, 1, 3, 5, 7])
        load = max(0.4, now["load"])
        amps = [load * (1 + now["share"] * turn) for turn in (-1, 0.2, 0.8)]
        power = [0.97 * now[f"u{at}"] * amp for at, amp in enumerate(amps, 1)]
        heat = 3.4 * sum(power)
        i_bat = now["bat"] + now["noise"] * 0.2
        cells = [now["cell"] + 0.0004 * i_bat + offset for offset in offsets]
        u_bat = sum(cells)
        soc = min(98.0, max(8.0, soc + i_bat * seconds / 3600 / 2.8))
        hour = seconds / 3600
        total["e"] += sum(power) * hour
        total["e_heat"] += heat * hour
        total["e_in"] += max(0.0, i_bat) * u_bat * hour
        total["e_out"] += max(0.0, -i_bat) * u_bat * hour
        session += sum(power) * hour
        daily = math.sin(2 * math.pi * (at / DAY + 10 / 24 - 0.35))
        out, flow = now["t_out"] + 5 * daily, now["t_flow"] - 0.3 * now["t_out"]
        motor = max(5.0, now["motor"])
        yield {
            **{f"u{phase}": now[f"u{phase}"] for phase in (1, 2, 3)},
            **{f"u{pair}": now[f"u{str(pair)[0]}"] * math.sqrt(3) for pair in (12, 23, 31)},
            **{f"i{phase}": amp for phase, amp in enumerate(amps, 1)},
            **{f"p{phase}": watt for phase, watt in enumerate(power, 1)},
            **{f"cell{number}": cell for number, cell in enumerate(cells)},
            **total,
            "p": sum(power), "pf": 0.97 + 0.004 * now["noise"], "f": now["f"], "soc": soc,
            "u_bat": u_bat, "i_bat": i_bat, "p_bat": u_bat * i_bat, "ah": soc * 2.8,
            "ah_full": 280, "ah_total": 9310, "soh": 98, "cycles": 143, "e_session": session,
            "cell_mean": u_bat / 16, "cell_max": max(cells), "cell_min": min(cells),
            "t_cell": 22 + 0.03 * abs(i_bat) + 0.3 * now["t_room"] / 20, "t_cell2": 23 + now["hum"] / 40,
            "t_mos": 28 + 0.1 * abs(i_bat), "t_kelvin": 295.15 + now["hum"] / 30,
            "t_kelvin2": 296.15 + now["t_room"] / 15, "t_out": out, "t_out_1h": now["t_out"] + 4 * daily,
            "t_flow": flow, "t_return": flow - 5 - 0.2 * load, "t_room": now["t_room"],
            "t_brine_in": 0.6 * out - 1, "t_brine_out": 0.6 * out - 4, "t_tank": flow + 1.5,
            "t_dhw": 48 + 0.4 * now["t_flow"] / 4, "t_dhw2": 46 + 0.5 * now["t_flow"] / 4,
            "t_engine": 82 + now["load"] / 2, "t_oil": 91 + now["load"] / 2, "oil": now["oil"],
            "fuel": 71 - at / 1600, "u_24": 27.6 + 0.08 * now["noise"], "u_24b": 27.1 + 0.06 * now["noise"],
            "rpm": now["rpm"], "rpm2": 0.93 * now["rpm"] + 3 * now["noise"], "p_fan": 60 + now["rpm"] / 40,
            **{f"kw{phase}": watt / 1000 for phase, watt in enumerate(power, 1)}, "kw": sum(power) / 1000,
            "humidity": now["hum"], "humidity2": now["hum"] + 6, "humidity3": 0.8 * now["hum"] + 7,
            "co2": now["co2"], "kw_heat": heat / 1000, "cop": 3.4 + 0.05 * now["noise"],
            "kwh": total["e"] / 1000, "kwh_heat": total["e_heat"] / 1000, "flow": 14 + now["load"] / 3,
            "percent": 100 * load / 16, "f_motor": motor, "f_ref": round(motor), "i_motor": 3 + motor / 12,
            "torque": 40 + motor / 3 + now["noise"], "u_line": 400 + 2 * (now["u1"] - 230),
            "u_motor": motor * 7.6, "thermal": 55 + motor / 6, "seconds": clock + at,
            "hours": hours + at // 3600, "starts": starts, "mode": mode, "cable": cable, "bits": bits,
            "volume": total["e"] / 4e4, "e_day": 3.1 + (total["e"] - start["e"]) / 1000,
            **{f"p_signed{phase}": watt - 1400 for phase, watt in enumerate(power, 1)},
            "serial": serial, "fifteen": 15, "fifty": 50, "thirty_nine": 39,
        }  # fmt: skip
