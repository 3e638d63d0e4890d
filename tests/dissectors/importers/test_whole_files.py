"""Whole files in the form in which people publish them: what becomes of each line, all notes.

The files are written for these tests; names and numbers are their own. One feature at a time is
tested in the module of each format.
"""

from __future__ import annotations

from typing import Any

import pytest

from dissectors import importers
from dissectors.importers import Options
from dissectors.profile import from_model

TELEGRAF = """\
# Read registers of a heat pump
[[inputs.modbus]]
  ## Connection Configuration
  name = "heatpump"
  slave_id = 12
  timeout = "2s"
  controller = "file:///dev/ttyUSB0"
  baud_rate = 19200
  data_bits = 8
  parity = "E"
  stop_bits = 1
  transmission_mode = "RTU"

  ## Digital Variables, Discrete Inputs and Coils
  discrete_inputs = [
    { name = "compressor_runs", address = [0] },
    { name = "door_open",       address = [1] },
  ]
  coils = [
    { name = "defrost",         address = [16] },
  ]

  ## Analog Variables, Input Registers and Holding Registers
  holding_registers = [
    { name = "setpoint",  byte_order = "AB",   data_type = "FIXED",        scale = 0.1, address = [2] },
    { name = "heat",      byte_order = "ABCD", data_type = "UFIXED",       scale = 0.001, address = [5, 6] },
    { name = "flow",      byte_order = "CDAB", data_type = "FLOAT32-IEEE", scale = 1.0, address = [9, 10] },
  ]
  input_registers = [
    { name = "outside",   byte_order = "AB",   data_type = "INT16",        scale = 1.0, address = [3] },
    { measurement = "state", name = "alarm", byte_order = "AB", data_type = "BIT", bit = 7, address = [4] },
  ]
"""  # noqa: E501 - as wide as people write it

HOME = """\
# Loads default set of integrations
default_config:

modbus:
  - name: inverter
    type: tcp
    host: !secret inverter_host
    port: 502
    delay: 2
    message_wait_milliseconds: 30
    timeout: 5
    sensors:
      - name: PV Power
        unique_id: pv_power
        slave: 3
        address: 5016
        input_type: input
        data_type: uint32
        swap: word
        unit_of_measurement: W
        device_class: power
        state_class: measurement
        scan_interval: 10
      - name: Inside Temperature
        slave: 3
        address: 5007
        input_type: input
        data_type: int16
        scale: 0.1
        precision: 1
        unit_of_measurement: "°C"
        nan_value: 0x7FFF
      - name: Serial
        slave: 3
        address: 4989
        input_type: input
        data_type: string
        count: 10
    binary_sensors:
      - name: Grid Fault
        slave: 3
        address: 20
        input_type: discrete_input
    switches:
      - name: Remote Stop
        slave: 3
        address: 5005
        write_type: holding
        command_on: 0xCE
        command_off: 0xCF
        verify:
          input_type: holding
          address: 5005
          state_on: 0xCE
          state_off: 0xCF
"""

ESPHOME = """\
substitutions:
  devicename: charger

esphome:
  name: ${devicename}
esp32:
  board: esp32dev

uart:
  id: mod_uart
  tx_pin: 17
  rx_pin: 16
  baud_rate: 115200

modbus:
  id: mod_bus
  uart_id: mod_uart

modbus_controller:
  - id: epever
    address: 0x1
    modbus_id: mod_bus
    setup_priority: -10

sensor:
  - platform: modbus_controller
    modbus_controller_id: epever
    id: pv_input_voltage
    name: "PV input voltage"
    address: 0x3100
    unit_of_measurement: "V"
    register_type: read
    value_type: U_WORD
    accuracy_decimals: 1
    filters:
      - multiply: 0.01
  - platform: modbus_controller
    modbus_controller_id: epever
    id: pv_input_power
    name: "PV input power"
    address: 0x3102
    unit_of_measurement: "W"
    register_type: read
    value_type: U_DWORD_R
    accuracy_decimals: 1
    filters:
      - multiply: 0.01
  - platform: modbus_controller
    modbus_controller_id: epever
    name: "Odd one"
    address: 0x3200
    register_type: read
    value_type: S_WORD
    lambda: |-
      return x < 0 ? 0 : x;
binary_sensor:
  - platform: modbus_controller
    modbus_controller_id: epever
    name: "Over temperature"
    register_type: read
    address: 0x3201
    bitmask: 0x0400
switch:
  - platform: modbus_controller
    modbus_controller_id: epever
    name: "Load"
    register_type: coil
    address: 2
    bitmask: 1
"""

VENDOR = """\
Compact meter CM-7;;;;;;
Register list, revision 3;;;;;;
;;;;;;
Address (hex);Register;Action (R/W);Size;Type;Units;Description
0x0BB7;3000;R;2;Float32;A;Current L1
0x0BED;3054;R;2;Float32;W;Active power L1
0x0C83;3204;R;4;INT64;Wh;Energy
0x1F40;8001;R/W;1;UINT16;-;Demand mode
"""

SCALED = {"scale": 0.01}

FILES: dict[str, tuple[str, str, list[dict[str, Any]], list[str]]] = {
    "telegraf": (
        "telegraf",
        TELEGRAF,
        [
            {"at": "co:16", "name": "defrost", "type": "bool"},
            {"at": "di:0", "name": "compressor_runs", "type": "bool"},
            {"at": "di:1", "name": "door_open", "type": "bool"},
            {"at": "hr:2", "name": "setpoint", "type": "s16", "scale": 0.1},
            {"at": "hr:5", "name": "heat", "type": "u32", "scale": 0.001},
            {"at": "hr:9", "name": "flow", "type": "f32", "order": "CDAB"},
            {"at": "ir:3", "name": "outside", "type": "s16"},
            {"at": "ir:4.7", "name": "alarm", "type": "bool"},
        ],
        [
            "addresses count from 0, as Telegraf does",
            *(
                f"{key}: is not part of a register map"
                for key in (
                    "baud_rate", "controller", "data_bits", "name", "parity", "stop_bits",
                    "timeout", "transmission_mode",
                )
            ),
            "measurement: cannot be kept in a profile",
        ],
    ),
    "homeassistant": (
        "homeassistant",
        HOME,
        [
            {"at": "ir:5016", "name": "PV Power", "type": "u32", "order": "CDAB", "unit": "W"},
            {
                "at": "ir:5007", "name": "Inside Temperature", "type": "s16", "scale": 0.1,
                "unit": "°C", "nan": [0x7FFF],
            },
            {"at": "ir:4989", "name": "Serial", "type": "str", "count": 10},
            {"at": "di:20", "name": "Grid Fault", "type": "bool"},
            {
                "at": "hr:5005", "name": "Remote Stop", "type": "u16", "access": "rw",
                "enum": {"206": "on", "207": "off"},
            },
        ],
        [
            "addresses count from 0, as Home Assistant does",
            "line 7: !secret inverter_host is not followed; skipped",
            *(
                f"{key}: cannot be kept in a profile"
                for key in (
                    "device_class", "scan_interval", "state_class", "unique_id", "precision",
                    "verify",
                )
            ),
        ],
    ),
    "esphome": (
        "esphome",
        ESPHOME,
        [
            {"at": "ir:12544", "name": "PV input voltage", "type": "u16", "unit": "V", **SCALED},
            {
                "at": "ir:12546", "name": "PV input power", "type": "u32", "order": "CDAB",
                "unit": "W", **SCALED,
            },
            {"at": "ir:12800", "name": "Odd one", "type": "s16"},
            {"at": "ir:12801.10", "name": "Over temperature", "type": "bool"},
            {"at": "co:2", "name": "Load", "type": "bool", "access": "rw"},
        ],
        [
            "addresses count from 0, as ESPHome does",
            "Odd one: lambda is not understood; the value is the raw one",
            "accuracy_decimals: cannot be kept in a profile (2 times)",
        ],
    ),
    "a table of a vendor's manual": (
        "csv",
        VENDOR,
        [
            {"at": "hr:2999", "name": "Current L1", "type": "f32", "unit": "A"},
            {"at": "hr:3053", "name": "Active power L1", "type": "f32", "unit": "W"},
            {"at": "hr:3203", "name": "Energy", "type": "s64", "unit": "Wh"},
            {
                "at": "hr:8000", "name": "Demand mode", "type": "u16", "unit": "-", "access": "rw",
            },
        ],
        [
            "addresses count from 0, as on the wire (assumed; --base 0, 1 or modicon overrides)",
            "column 'Register' has the same meaning as 'Address (hex)'; skipped",
            "no column has the names: those of 'Description' are taken",
            "addresses are hexadecimal, as the header says",
            "no column names the table: holding registers (assumed)",
            "values of several registers: highest register first, ABCD (assumed; --order overrides"
            " it)",
        ],
    ),
}  # fmt: skip


@pytest.mark.parametrize(("form", "text", "expected", "notes"), FILES.values(), ids=FILES)
def test_a_file_as_people_write_it(
    form: str, text: str, expected: list[dict[str, Any]], notes: list[str]
) -> None:
    """Every point in the order of the file, every note."""
    found = importers.read(form, text, "map", Options())
    assert from_model(found.model, "map").points == expected
    assert list(found.notes) == notes
