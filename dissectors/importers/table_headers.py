"""Words for columns and types in tables, and programs whose tables the header line reveals.

To add a word, add it to its row; to add a program's table, add a row to `PRESETS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from dissectors.function_lookup import normalized

__all__ = [
    "HEADER_WORDS",
    "KEY_OF_HEADER",
    "ORDER_SUFFIXES",
    "PRESETS",
    "TABLE_OF_FUNCTION",
    "TYPES_WITHOUT_WIDTH",
    "TYPE_NAMES",
    "Preset",
    "preset_of",
]

_HEADER_WORDS: Mapping[str, tuple[str, ...]] = {
    # The first word that a table has is used: an address beside a register number is a wire
    # address.
    "address": ("address", "modbus address", "register address", "address hex", "hex address",
                "address dec", "decimal address", "startaddress", "start", "addr", "register",
                "register hex", "reg", "_address", "register number", "element"),
    "name": ("name", "tag name", "tag", "variable name", "varname", "register name", "point name",
             "variable", "signal"),
    "type": ("data type", "datatype", "type", "format", "sttype", "value type"),
    "table": ("table", "register type", "registertype", "object type", "modbus type"),
    "function": ("function", "function code", "fc"),
    "unit": ("unit", "units", "eng units", "engunits", "uom", "unit of measure",
             "unit of measurement"),
    "scale": ("scale", "factor", "k", "multiplier", "scale factor", "gain"),
    "transform": ("transform",),
    "offset": ("offset", "q", "bias"),
    "order": ("order", "byte order", "byteorder", "endian", "endianness", "swap"),
    "words": ("word order", "wordorder", "word swap", "wordswap", "mixed endian"),
    "access": ("access", "rw", "client access", "r/w", "writable", "writeable", "read/write",
               "action"),
    "count": ("count", "quantity", "registers", "register count", "number of registers"),
    "length": ("length", "len", "size"),
    "title": ("documented name",),
    "note": ("description", "note", "notes", "comment"),
    "group": ("group", "category"),
    "enum": ("enum", "values"),
    "nan": ("nan", "no value", "invalid value", "error value"),
    "slave": ("slave", "slave id", "slave address", "unit id", "device id", "device address",
              "station", "station number", "node"),
    "scaling": ("scaling",),
    "rawlow": ("raw low", "inlo", "x1"),
    "rawhigh": ("raw high", "inhi", "x2"),
    "scaledlow": ("scaled low", "outlo", "y1"),
    "scaledhigh": ("scaled high", "outhi", "y2"),
    "clamplow": ("clamp low",),
    "clamphigh": ("clamp high",),
    "negatevalue": ("negate value",),
}  # fmt: skip

HEADER_WORDS: Mapping[str, tuple[str, ...]] = {
    key: tuple(dict.fromkeys(map(normalized, words))) for key, words in _HEADER_WORDS.items()
}
"""Key -> normalized words for its column."""

KEY_OF_HEADER: Mapping[str, str] = {
    name: key for key, names in HEADER_WORDS.items() for name in names
}
"""Normalized word for a column -> key."""

TYPE_NAMES: Mapping[str, str] = {
    normalized(word): kind
    for kind, words in {
        "bool": ("bool", "boolean", "bit", "digital", "binary"),
        "u16": ("u16", "uint16", "word", "uint", "unsigned", "ushort", "unsigned16", "unsigned int",
                "uint16_t"),
        "s16": ("s16", "int16", "short", "int", "integer", "signed", "signed16", "int16_t"),
        "u32": ("u32", "uint32", "dword", "udint", "ulong", "unsigned32", "uint32_t"),
        "s32": ("s32", "int32", "long", "dint", "signed32", "int32_t"),
        "u64": ("u64", "uint64", "qword", "ulint", "lword", "uint64_t"),
        "s64": ("s64", "int64", "llong", "lint", "int64_t"),
        "f16": ("f16", "float16", "half"),
        "f32": ("f32", "float", "float32", "real", "single"),
        "f64": ("f64", "float64", "double", "lreal"),
        "bcd16": ("bcd16", "bcd"),
        "bcd32": ("bcd32", "lbcd"),
        "u8l": ("u8l", "byte", "uint8", "u8"),
        "s8l": ("s8l", "char", "int8", "s8", "sint"),
        "u8h": ("u8h",),
        "s8h": ("s8h",),
        "str": ("str", "string", "ascii", "text"),
        "raw": ("raw",),
    }.items()
    for word in words
}  # fmt: skip
"""Normalized word for a type -> type."""

TYPES_WITHOUT_WIDTH = frozenset(
    normalized(word) for word in ("int", "integer", "uint", "unsigned", "unsigned int", "signed")
)
"""Words for types that do not state a width."""

ORDER_SUFFIXES: Mapping[str, str] = {"be": "ABCD", "le": "DCBA", "sw": "CDAB", "sb": "BADC"}
"""Suffix of a type -> order, as in `uint32be` and `floatsw`."""

TABLE_OF_FUNCTION: Mapping[int, str] = {
    1: "co", 2: "di", 3: "hr", 4: "ir", 5: "co", 6: "hr", 15: "co", 16: "hr", 22: "hr", 23: "hr",
}  # fmt: skip
"""Function code -> the table that it reads or writes."""


@dataclass(frozen=True, slots=True)
class Preset:
    """A program's table: the columns by which it is recognized, and what its files leave open."""

    title: str
    headers: tuple[str, ...]
    base: int | str = 0
    order: str | None = None
    """Of values of several registers, where it is a setting of the device."""
    first_bit: int = 0
    """The number of the lowest bit."""
    types: Mapping[str, str] = field(default_factory=dict)
    scaled_units: bool = False
    """Whether a unit such as `0.1V` has the scale in it."""
    bit_types: Mapping[str, int] = field(default_factory=dict)
    """Normalized word for a type -> how many bits of a register it takes."""
    access: Mapping[str, str] = field(default_factory=dict)
    """Normalized words for access that mean something other than usual -> the usual ones."""
    table_in_file_name: bool = False
    """Whether the file's name says that the registers are input or holding registers."""
    ignored_columns: tuple[str, ...] = ()
    """Columns that say nothing of registers: how often to ask, and the like."""


PRESETS = (
    Preset(
        "Kepware",
        ("tagname", "address", "datatype", "clientaccess"),
        base="modicon",
        order="CDAB",
        ignored_columns=("respectdatatype", "scanrate", "scaleddatatype"),
    ),
    Preset("Mervis", ("stationnumber", "element", "sttype"), first_bit=1),
    Preset("Control Solutions", ("rw", "type", "reg", "format"), base=1, ignored_columns=("poll",)),
    Preset("Kaspersky", ("varname", "connection", "address", "datatype"), base="modicon"),
    Preset(
        "PythonProtocolGateway",
        ("variablename", "datatype", "register", "documentedname"),
        types={
            "uint": "u32",
            "int": "s32",
            "16bitflags": "u16",
            "32bitflags": "u32",
            "asciile": "str",
        },
        bit_types={"byte": 8, "uint8": 8, "8bitflags": 8},
        # What may be written is read as well; WD is writable in the manual, but switched off.
        access={"w": "rw", "wd": "r"},
        scaled_units=True,
        table_in_file_name=True,
        ignored_columns=("hadiscovery", "readinterval", "readcommand"),
    ),
)
"""The tables that are recognized by their header line."""


def preset_of(head: Iterable[str]) -> Preset | None:
    """The preset of the program whose table has this header line; None for others."""
    words = {normalized(cell) for cell in head}
    return next((one for one in PRESETS if words.issuperset(one.headers)), None)
