"""Discovery as Home Assistant documents it: devices of buses and units, problems, values."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any, cast

import _modlens
from analyzer.bus_days import COLUMNS
from analyzer.feeds.home_assistant import FAILURES, HomeAssistant
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
        assert about["state_topic"] == about["json_attributes_topic"] == "plant/boiler/day"
        assert about["device"]["identifiers"] == ["plant_boiler"]
        used = about["value_template"].split("value_json.")[1].split()[0]
        assert used in COLUMNS


def test_a_unit_is_a_problem_after_three_failures_in_a_row() -> None:
    """Not after a lost frame; not before it has answered once; an answer ends it."""
    home = HomeAssistant("plant", "plant/status")
    assert not [m for m in sent(home, *["no_response"] * 9) if m.topic.endswith("/_problem")]

    def problems(*statuses: str) -> list[bytes]:
        return [m.payload for m in sent(home, *statuses) if m.topic == "plant/boiler/4/_problem"]

    assert problems("ok") == [b"0"]
    assert problems("no_response", "bad_response", "ok") == []
    assert problems("no_response", "not_observed", "bad_response", "unsolicited") == []
    assert problems("no_response", "no_response") == [b"1"]
    assert problems("exception", "ok") == [b"0"]
    assert FAILURES == 3
    about = configs(home.announcements)[
        "homeassistant/binary_sensor/plant_boiler_4/_problem/config"
    ]
    assert (about["device_class"], about["payload_on"]) == ("problem", "1")
    assert about["device"]["via_device"] == "plant_boiler"
    assert about["state_topic"] == "plant/boiler/4/_problem"


def test_values_are_sensors_of_their_unit() -> None:
    """A bit is a binary sensor; names become what topics of discovery may hold."""
    home = HomeAssistant("plant", "plant/status")
    found = configs(list(home.value("plant/boiler/4/Öl.1", True, row("ok"), "Öl.1")))
    [(topic, about)] = found.items()
    assert topic == "homeassistant/binary_sensor/plant_boiler_4/_l_1/config"
    assert (about["name"], about["payload_on"]) == ("Öl.1", "1")
    assert not list(home.value("plant/boiler/4/Öl.1", False, row("ok"), "Öl.1"))
