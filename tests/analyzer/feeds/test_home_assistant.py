"""Discovery as Home Assistant documents it: devices of buses and units, problems, values."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any, cast

import _modlens
from analyzer.bus_days import COLUMNS
from analyzer.feeds.home_assistant import HomeAssistant
from analyzer.feeds.spool import Message

REQUIRED = {"name", "unique_id", "state_topic", "availability_topic", "device", "origin"}


def row(status: str, unit: int = 4) -> _modlens.Row:
    found = SimpleNamespace(bus="boiler", unit=unit, status=status, register_type="coil")
    return cast(_modlens.Row, found)


def sent(home: HomeAssistant, *statuses: str) -> list[Message]:
    return [message for status in statuses for message in home.transaction(row(status))]


def configs(messages: list[Message]) -> dict[str, dict[str, Any]]:
    return {one.topic: json.loads(one.payload) for one in messages if one.topic.endswith("/config")}


def test_a_bus_is_a_device_with_its_health() -> None:
    """Announced once, from the row of its day, whose columns the templates name."""
    home = HomeAssistant("plant", "plant/status")
    found = configs(sent(home, "no_response", "no_response"))
    assert set(found) == {
        "homeassistant/binary_sensor/plant_boiler/problem/config",
        "homeassistant/sensor/plant_boiler/verdict/config",
        "homeassistant/sensor/plant_boiler/failed/config",
        "homeassistant/sensor/plant_boiler/damaged/config",
    }
    for about in found.values():
        assert set(about) >= REQUIRED
        is_problem = about["name"] == "Problem"
        topic = "plant/boiler/trouble" if is_problem else "plant/boiler/day"
        assert about["state_topic"] == about["json_attributes_topic"] == topic
        assert about["device"]["identifiers"] == ["plant_boiler"]
        used = about["value_template"].split("value_json.")[1].split()[0]
        assert used in ("problem", *COLUMNS)


def test_a_unit_has_a_problem_sensor_once_it_has_answered() -> None:
    """With the sentence of its trouble as an attribute."""
    home = HomeAssistant("plant", "plant/status")
    topic = "homeassistant/binary_sensor/plant_boiler_4/_problem/config"
    assert topic not in configs(sent(home, *["no_response"] * 9))
    about = configs(sent(home, "ok", "ok"))[topic]
    assert (about["device_class"], about["payload_on"]) == ("problem", "1")
    assert about["device"]["via_device"] == "plant_boiler"
    assert about["state_topic"] == about["json_attributes_topic"] == "plant/boiler/4/_problem"


def test_values_are_sensors_of_their_unit() -> None:
    """A bit is a binary sensor; names become what topics of discovery may hold."""
    home = HomeAssistant("plant", "plant/status")
    found = configs(list(home.value("plant/boiler/4/Öl.1", True, row("ok"), "Öl.1")))
    [(topic, about)] = found.items()
    assert topic == "homeassistant/binary_sensor/plant_boiler_4/_l_1/config"
    assert (about["name"], about["payload_on"]) == ("Öl.1", "1")
    assert not list(home.value("plant/boiler/4/Öl.1", False, row("ok"), "Öl.1"))
