"""Whatever a file says, an importer gives a profile that the core takes, notes, or an error.

Structures are made of the keys that the importers know and of values of any kind.
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dissectors import importers
from dissectors.errors import ModlensError
from dissectors.importers import FORMATS, Options
from dissectors.importers.table_headers import HEADER_WORDS, TYPE_NAMES
from dissectors.profile import from_model

READERS = [name for name, form in FORMATS.items() if form.reads]

odd: st.SearchStrategy[Any] = st.sampled_from(
    [None, True, False, "", "x", "0x10", "-1", "65535", "1e999", "9" * 5000, "nan", 0, 1, -1, 0.1,
     1e300, 65535, 65536, 2**64, [], {}, [1], {"a": 1}, [[]], "word", "${x}", "°"]
)  # fmt: skip
whole = st.integers(0, 70000)


def rows(**keys: list[Any]) -> st.SearchStrategy[list[dict[str, Any]]]:
    """Some tables with some of these keys, each with one of its values or an odd one."""
    values = {key: st.sampled_from(listed) | odd for key, listed in keys.items()}
    row = st.fixed_dictionaries({}, optional={**values, "address": whole | odd, "unknown": odd})
    return st.lists(row, max_size=3)


TELEGRAF = rows(
    name=["a"], data_type=["INT32", "FIXED", "STRING"], type=["BIT"], byte_order=["CDAB"], bit=[3],
    length=[2], scale=[0.1], omit=[True], register=["input"],
)  # fmt: skip
HOME = rows(
    name=["a"], slave=[1], data_type=["uint32", "string", "custom", "int"], structure=[">2h"],
    count=[2], swap=["word"], scale=[0.1], offset=[1], nan_value=["0x8000"], virtual_count=[2],
    input_type=["coil"], unit_of_measurement=["V"], command_on=[1],
)  # fmt: skip
ESPHOME = rows(
    name=["a"], register_type=["coil", "read"], value_type=["U_DWORD_R", "RAW", "FP32"],
    bitmask=[0xF0], byte_offset=[2], filters=[[{"multiply": 0.1}]], multiply=[10],
    optionsmap=[{"On": 1}], register_count=[2], response_size=[3], raw_encode=["COMMA"],
    unit_of_measurement=["V"],
)  # fmt: skip
SUNSPEC = rows(
    name=["a"], type=["uint32", "string", "pad", "sunssf"], size=[1, 2], sf=["b", -2],
    symbols=[[{"name": "s", "value": 1}]], units=["V"], access=["RW"], label=["l"],
)  # fmt: skip

SOLARMAN = rows(
    name=["a"], rule=[1, 2, 3, 5, 6, 9], registers=[[1], [2, 1], [1, 2], ["0x10"]], scale=[0.1],
    offset=[1000], mask=[0xF0, 0xFFFF], lookup=[[{"key": 16, "value": "x"}]], uom=["V"],
    divide=[10],
)  # fmt: skip
CHANNELS = rows(
    name=["a"], reg_type=["input", "coil"], format=["s16", "float", "string"], scale=[0.1],
    string_data_size=[4], error_value=["0xFFFF"], enum=[[1, 2]], enum_titles=[["a", "b"]],
    readonly=[True], word_order=["little_endian"], write_address=[3], consists_of=[[{}]],
)  # fmt: skip


def no_crash(form: str, text: str, **options: Any) -> None:
    """A profile that the core takes, or an error for the operator."""
    try:
        found = importers.read(form, text, "map", Options(**options))
    except ModlensError:
        return
    from_model(found.model, "map")


def toml(value: Any) -> str:
    """A value in TOML; null is none of it."""
    if isinstance(value, dict):
        pairs = (f"{json.dumps(key)} = {toml(item)}" for key, item in value.items())
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    return "[]" if value is None else json.dumps(value)


@settings(deadline=None, max_examples=40)
@given(found=TELEGRAF, style=st.sampled_from(["register", "request", "metric"]))
def test_telegraf(found: list[dict[str, Any]], style: str) -> None:
    """Telegraf: any keys with any values are read, or refused with an error of ours."""
    plugin = {"holding_registers": found} if style == "register" else {style: [{"fields": found}]}
    no_crash("telegraf", f"inputs = {toml({'modbus': [plugin]})}\n")


@settings(deadline=None, max_examples=40)
@given(found=HOME, kind=st.sampled_from(["sensors", "binary_sensors", "switches", "climates"]))
def test_homeassistant(found: list[dict[str, Any]], kind: str) -> None:
    """Home Assistant: any keys with any values are read, or refused with an error of ours."""
    no_crash("homeassistant", json.dumps({"modbus": [{kind: found}]}))


@settings(deadline=None, max_examples=40)
@given(found=ESPHOME, kind=st.sampled_from(["sensor", "text_sensor", "number", "select"]))
def test_esphome(found: list[dict[str, Any]], kind: str) -> None:
    """ESPHome: any keys with any values are read, or refused with an error of ours."""
    entities = [{"platform": "modbus_controller", **row} for row in found]
    no_crash("esphome", json.dumps({kind: entities}))


@settings(deadline=None, max_examples=40)
@given(found=SUNSPEC, groups=SUNSPEC, count=odd)
def test_sunspec(found: list[dict[str, Any]], groups: list[dict[str, Any]], count: Any) -> None:
    """SunSpec: any keys with any values are read, or refused with an error of ours."""
    group = {"points": found, "groups": [{"name": "g", "count": count, "points": groups}]}
    no_crash("sunspec", json.dumps({"id": 1, "group": group}))


@settings(deadline=None, max_examples=40)
@given(found=SOLARMAN, start=odd, code=st.sampled_from([3, 4]) | odd)
def test_solarman(found: list[dict[str, Any]], start: Any, code: Any) -> None:
    """Solarman: any keys with any values are read, or refused with an error of ours."""
    requests = [{"start": start, "end": 99, "mb_functioncode": code}]
    no_crash("solarman", json.dumps({"requests": requests, "parameters": [{"items": found}]}))


@settings(deadline=None, max_examples=40)
@given(found=CHANNELS, parameters=CHANNELS, unit=odd)
def test_wb_mqtt_serial(
    found: list[dict[str, Any]], parameters: list[dict[str, Any]], unit: Any
) -> None:
    """wb-mqtt-serial: any keys with any values are read, or refused with an error of ours."""
    device = {"slave_id": unit, "channels": found, "parameters": parameters}
    no_crash("wb-mqtt-serial", json.dumps({"device": device}))


CELLS = st.sampled_from(
    ["", "0", "7", "7.3", "7.20H", "7 [2]", "7-9", "40001", "HR7", "0x10", "65535", "-1", "0,1",
     "x", "2", "0=off;1=on", "0xFFFFFFFFFFFFFFFF=a", "9" * 5000, "1e300", "1/0", "True", "CDAB",
     "coil", "Linear", '"', "nan", *sorted(TYPE_NAMES)]
)  # fmt: skip


@settings(deadline=None, max_examples=40)
@given(data=st.data(), base=st.sampled_from([None, 0, 1, "modicon"]))
def test_csv(data: st.DataObject, base: int | str | None) -> None:
    """CSV: any columns with any cells are read, or refused with an error of ours."""
    heads = data.draw(
        st.lists(st.sampled_from([key for key in HEADER_WORDS if key != "address"]), max_size=8)
    )
    head = ["address", "name", *(HEADER_WORDS[key][0] for key in heads)]
    lines = data.draw(st.lists(st.lists(CELLS, min_size=2, max_size=len(head)), max_size=4))
    text = "\n".join(";".join(line) for line in [head, *lines])
    no_crash("csv", text, base=base)


@pytest.mark.parametrize("form", READERS)
@settings(deadline=None, max_examples=20)
@given(text=st.text(max_size=60))
@example(text="\x00")
@example(text="[" * 300)
@example(text="&a [*a]")
@example(text="? {a: b}\n: c")
@example(text="a: !!int x\nb: !!float y\n")
def test_any_text(form: str, text: str) -> None:
    """Words, control characters, brackets without end."""
    no_crash(form, text)
