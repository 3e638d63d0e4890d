"""The hubs of a Home Assistant configuration: a bus each, with its port and line settings."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Hub", "hub_of"]


@dataclass(frozen=True, slots=True)
class Hub:
    """A bus in a register map: the keys of a bus file, and the text with its registers.

    `keys` are those of a `[[bus]]`: name, port, line, mode.
    """

    keys: Mapping[str, str]
    units: tuple[int, ...]
    text: str


def hub_of(hub: Mapping[str, Any], units: tuple[int, ...], number: int) -> Hub:
    """Returns the bus of a hub; `number` names one without a name.

    >>> hub_of({"type": "serial", "port": "COM3", "baudrate": 9600, "parity": "N"}, (), 1).keys
    {'name': 'hub 1', 'port': 'COM3', 'line': '9600-8N1', 'mode': 'rtu'}
    """
    keys = {"name": str(hub.get("name") or f"hub {number}")}
    kind = str(hub.get("type", ""))
    if kind == "serial" and isinstance(hub.get("port"), str):
        keys["port"] = hub["port"]
        if isinstance(hub.get("baudrate"), int):
            bits, stop = hub.get("bytesize", 8), hub.get("stopbits", 1)
            keys["line"] = f"{hub['baudrate']}-{bits}{str(hub.get('parity', 'E'))[:1]}{stop}"
        keys["mode"] = "ascii" if hub.get("method") == "ascii" else "rtu"
    elif kind == "rtuovertcp" and hub.get("host"):
        keys |= {"port": f"socket://{hub['host']}:{hub.get('port', 502)}", "mode": "rtu"}
    elif kind == "tcp":
        keys["mode"] = "tcp"
    # JSON is YAML.
    return Hub(keys, units, json.dumps({"modbus": [hub]}, default=str))
