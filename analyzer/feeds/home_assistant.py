"""What Home Assistant gets by MQTT discovery: devices with values, health and problems.

A bus is a device with the verdict of its day and the shares of failures and damage. A unit is a
device with its values. Both have a problem sensor, which is on while there is a trouble and has
its sentence as an attribute (see `analyzer.feeds.troubles`).

https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import _modlens
from analyzer.feeds.spool import Message
from analyzer.feeds.troubles import PROBLEM, TroubleTopics

__all__ = ["DISCOVERY", "HomeAssistant"]

DISCOVERY = "homeassistant"
"""The topics of discovery begin with it; below it is the state of Home Assistant itself."""

_BIT_TABLES = ("coil", "discrete_input")
_SHARE = {
    "unit_of_measurement": "%",
    "state_class": "measurement",
    "suggested_display_precision": 1,
}
_ON_OFF = {"payload_on": "1", "payload_off": "0"}

_BUS_SENSORS: dict[str, tuple[str, dict[str, Any]]] = {
    "problem": (
        "binary_sensor",
        {
            "name": "Problem",
            "device_class": "problem",
            "value_template": "{{ value_json.problem }}",
            "payload_on": "1",
            "payload_off": "0",
        },
    ),
    "verdict": (
        "sensor",
        {
            "name": "Verdict of the day",
            "device_class": "enum",
            "options": ["healthy", "trouble", "broken", "unknown"],
            "value_template": "{{ value_json.verdict }}",
        },
    ),
    "failed": (
        "sensor",
        {
            "name": "Failed requests",
            "value_template": "{{ 100 * value_json.failed_share | float(0) }}",
        }
        | _SHARE,
    ),
    "damaged": (
        "sensor",
        {
            "name": "Damaged frames",
            "value_template": "{{ 100 * value_json.damaged_share | float(0) }}",
        }
        | _SHARE,
    ),
}
"""The sensors of a bus, all but the problem of the row of its day: kind and configuration."""


class HomeAssistant:
    """Makes the messages; `prefix` and `status` are topics of the feed."""

    def __init__(self, prefix: str, status: str) -> None:
        self._prefix = prefix
        self._status = status
        self._announced: dict[str, Message] = {}
        self._topics = TroubleTopics(prefix)

    @property
    def announcements(self) -> list[Message]:
        """All announcements so far, for a Home Assistant that has started again."""
        return list(self._announced.values())

    def transaction(self, row: _modlens.Row) -> Iterator[Message]:
        """The bus and the unit of a transaction, the first time; a unit once it has answered."""
        yield from self._bus(row.bus)
        if row.status in ("ok", "exception"):
            yield from self._problem_sensor(row)

    def value(self, topic: str, value: Any, row: _modlens.Row, name: str) -> Iterator[Message]:
        """The announcement of a value, the first time."""
        is_bit = isinstance(value, bool) or row.register_type in _BIT_TABLES
        about = {"name": name, "state_topic": topic} | (_ON_OFF if is_bit else {})
        kind = "binary_sensor" if is_bit else "sensor"
        yield from self._announce(kind, self._unit_node(row), name, about, self._unit_device(row))

    def _bus(self, bus: str) -> Iterator[Message]:
        node = self._bus_node(bus)
        day = f"{self._prefix}/{_modlens.topic_level(bus)}/day"
        device = {"identifiers": [node], "name": f"Modbus {bus}", "manufacturer": "modlens"}
        for name, (kind, about) in _BUS_SENSORS.items():
            topic = self._topics.topic(bus) if name == "problem" else day
            where = {"state_topic": topic, "json_attributes_topic": topic}
            category = {"entity_category": "diagnostic"}
            yield from self._announce(kind, node, name, about | where | category, device)

    def _problem_sensor(self, row: _modlens.Row) -> Iterator[Message]:
        about = {
            "name": "Problem",
            "device_class": "problem",
            "entity_category": "diagnostic",
            "state_topic": self._topics.topic(row.bus, row.unit),
            "json_attributes_topic": self._topics.topic(row.bus, row.unit),
            "value_template": "{{ value_json.problem }}",
            **_ON_OFF,
        }
        node, device = self._unit_node(row), self._unit_device(row)
        yield from self._announce("binary_sensor", node, PROBLEM, about, device)

    def _announce(
        self, kind: str, node: str, name: str, about: dict[str, Any], device: dict[str, Any]
    ) -> Iterator[Message]:
        """The message that makes an entity, unless it has been announced."""
        level = name if name == PROBLEM else _identifier(name)
        topic = f"{DISCOVERY}/{kind}/{node}/{level}/config"
        if topic in self._announced:
            return
        identity = {
            "unique_id": f"{node}_{level}",
            "availability_topic": self._status,
            "device": device,
            "origin": {"name": "modlens", "sw_version": _modlens.__version__},
        }
        message = Message(topic, json.dumps(about | identity).encode(), retain=True)
        self._announced[topic] = message
        yield message

    def _bus_node(self, bus: str) -> str:
        return _identifier(f"{self._prefix}_{bus}")

    def _unit_node(self, row: _modlens.Row) -> str:
        return _identifier(f"{self._prefix}_{row.bus}_{row.unit}")

    def _unit_device(self, row: _modlens.Row) -> dict[str, Any]:
        return {
            "identifiers": [self._unit_node(row)],
            "name": f"{row.bus} unit {row.unit}",
            "manufacturer": "Modbus unit seen by modlens",
            "via_device": self._bus_node(row.bus),
        }


def _identifier(name: str) -> str:
    """A name as Home Assistant takes it in topics of discovery: ASCII letters, digits, `_`, `-`.

    >>> _identifier("plant/boiler.1")
    'plant_boiler_1'
    """
    return re.sub(r"[^A-Za-z0-9_-]", "_", _modlens.topic_level(name))
