"""Tables with a head, a test a feature: the exact points, and the exact notes of what is dropped.

| what | tests (`test_feature[...]`) |
| --- | --- |
| words of heads | `head-*` |
| types, their widths | `type-*` |
| texts, raw bytes, arrays | `text-*`, `array-*` |
| orders of bytes and words | `order-*` |
| scale, offset, limits | `scale-*` |
| addresses, tables, bits, halves | `at-*`, `table-*`, `bit-*` |
| access, labels, sentinels, units | `access-*`, `enum-*`, `nan-*`, `slave-*` |
| tables of programs that are known | `test_kepware.py`, `preset-*` |
| broken rows | `row-*` |
"""

from __future__ import annotations

import pytest

from dissectors import importers
from dissectors.errors import ProfileError, UsageError
from dissectors.importers import Options
from dissectors.importers.profile_builder import ORDERS
from dissectors.importers.table_headers import HEADER_WORDS, TYPE_NAMES
from dissectors.profile import from_model
from tests.support.importing import Feature, imported, notes, points


def rows(head: str, *lines: str) -> str:
    """A table."""
    return "\n".join([head, *lines]) + "\n"


def one(head: str, line: str) -> str:
    """A table of one row, whose point is called x and is at 7."""
    return rows(f"Address,Name,{head}", f"7,x,{line}")


def x(**keys: object) -> dict[str, dict[str, object]]:
    """The point x at hr:7."""
    return {"x": {"at": "hr:7", "type": "u16", **keys}}


FEATURES = {
    # Heads: delimiters, case, two columns for one thing, columns that nobody knows.
    "head-semicolon": Feature("Register;Tag Name;UoM\n7;x;bar\n", x(unit="bar")),
    "head-tab": Feature("ADDR\tvariable_name\tEng. Units\n7\tx\tbar\n", x(unit="bar")),
    "head-bar": Feature("Address|Name|Unit\n7|x|bar\n", x(unit="bar")),
    "head-by-what-it-names": Feature(
        "Address;Name;Description\n7;x;one, two, three, four\n", x(note="one, two, three, four")
    ),
    "head-below-a-title": Feature("Heat meter 2\n\nAddress,Name\n7,x\n", x()),
    "head-excel-separator": Feature("sep=;\nAddress;Name\n7;x\n", x()),
    "head-quoted": Feature('"Address","Name","Unit"\n"7","x","l/s"\n', x(unit="l/s")),
    "head-with-brackets": Feature("Address [dec],Name,Unit (SI)\n7,x,V\n", x(unit="V")),
    "head-hexadecimal": Feature(
        "Address (hex),Name\n6B,a\n0x6C,b\n6Dh,c\n6E.3,d\nHR 10,e\n",
        {
            "a": {"at": "hr:107", "type": "u16"},
            "b": {"at": "hr:108", "type": "u16"},
            "c": {"at": "hr:109", "type": "u16"},
            "d": {"at": "hr:110.3", "type": "bool"},
            "e": {"at": "hr:16", "type": "u16"},
        },
        ("addresses are hexadecimal, as the header says",),
    ),
    "head-without-names": Feature(
        "Address,Description\n7,x\n",
        x(),
        ("no column has the names: those of 'Description' are taken",),
    ),
    "head-crlf": Feature("Address,Name\r\n7,x\r\n", x()),
    "head-byte-order-mark": Feature("\ufeffAddress,Name\n7,x\n", x()),
    "head-address-before-register": Feature(
        "Register,Address,Name\n8,7,x\n",
        x(),
        ("column 'Register' has the same meaning as 'Address'; skipped",),
    ),
    "head-twice": Feature(
        "Address,Name,Name\n7,x,y\n",
        x(),
        ("column 'Name' has the same meaning as 'Name'; skipped",),
    ),
    "head-unknown": Feature(
        one("Colour", "red"), x(), ("column 'Colour' is not understood; skipped",)
    ),
    "head-empty": Feature(one("", "red"), x(), ("column 3 is not understood; skipped",)),
    "head-offset-is-the-address": Feature("Offset,Name\n7,x\n", x()),
    "head-offset-beside-an-address": Feature(one("Offset", "-40"), x(offset=-40)),
    "head-comments": Feature("# from the plant\nAddress,Name\n# pumps\n7,x\n", x()),
    # Types.
    "type-none": Feature("Address,Name\n7,x\n", x()),
    "type-unknown": Feature(
        rows("Address,Name,Type", "7,x,", "8,y,INT12"),
        x(),
        ("line 3, y: type 'INT12' is not known; skipped",),
    ),
    "type-says-no-width": Feature(
        one("Type", "INT"),
        x(type="s16"),
        ("types without a width take 16 bits (assumed)",),
    ),
    "type-width-by-count": Feature(one("Type,Count", "unsigned int,2"), x(type="u32")),
    "type-width-by-length": Feature(one("Type,Length", "INT,4"), x(type="s64")),
    "type-none-width-by-count": Feature(one("Count", "2"), x(type="u32")),
    "type-length-in-bytes": Feature(one("Type,Size", "FLOAT,4"), x(type="f32")),
    "type-length-in-bits": Feature(one("Type,Size", "UINT32,32"), x(type="u32")),
    "type-length-that-cannot-be": Feature(
        one("Type,Length", "FLOAT,3"),
        x(type="f32"),
        ("line 2, x: a f32 does not take 3 registers; skipped",),
    ),
    "type-count-that-cannot-be": Feature(
        one("Type,Count", "UINT32,3"),
        x(type="u32"),
        ("line 2, x: a u32 does not take 3 registers; skipped",),
    ),
    "type-with-order": Feature(
        rows("Address,Name,Type", "7,a,uint32be", "9,b,floatsw", "11,c,int32sb", "13,d,doublele"),
        {
            "a": {"at": "hr:7", "type": "u32"},
            "b": {"at": "hr:9", "type": "f32", "order": "CDAB"},
            "c": {"at": "hr:11", "type": "s32", "order": "BADC"},
            "d": {"at": "hr:13", "type": "f64", "order": "DCBA"},
        },
    ),
    "type-of-a-coil": Feature(
        one("Type,Table", "WORD,coil"),
        {"x": {"at": "co:7", "type": "bool"}},
        ("line 2, x: a coil is a bool, not 'WORD'",),
    ),
    "type-bool-without-a-bit": Feature(
        one("Type", "BOOL"), x(), ("line 2, x: a bool without a bit is the whole register",)
    ),
    # Texts and raw bytes.
    "text-count": Feature(one("Type,Count", "STRING,8"), x(type="str", count=8)),
    "text-length": Feature(
        one("Type,Length", "ASCII,8"),
        x(type="str", count=8),
        ("the length of a text counts registers (assumed)",),
    ),
    "text-sized": Feature(one("Type", "String[15]"), x(type="str", count=8)),
    "text-sized-characters": Feature(one("Type", "char(4)"), x(type="str", count=2)),
    "text-range": Feature(rows("Address,Name,Type", "7-10,x,STRING"), x(type="str", count=4)),
    "text-swapped": Feature(
        one("Type,Count,Byte order", "STRING,8,BADC"), x(type="str", count=8, order="BADC")
    ),
    "text-words-cannot-turn": Feature(
        one("Type,Count,Byte order", "STRING,8,CDAB"), x(type="str", count=8)
    ),
    "text-without-length": Feature(
        rows("Address,Name,Type", "7,x,", "8,y,string"),
        x(),
        ("line 3, y: a str without a length; skipped",),
    ),
    "text-with-a-scale": Feature(
        one("Type,Count,Scale", "STRING,8,0.1"),
        x(type="str", count=8),
        ("line 2, x: scale 0.1 does not apply to a str; skipped",),
    ),
    "raw-count": Feature(one("Type,Count", "raw,3"), x(type="raw", count=3)),
    "raw-without-length": Feature(
        rows("Address,Name,Type", "7,x,", "8,y,raw"),
        x(),
        ("line 3, y: a raw without a length; skipped",),
    ),
    # Arrays.
    "array-count": Feature(one("Type,Count", "UINT32,6"), x(type="u32", count=6)),
    "array-range": Feature(rows("Address,Name,Type", "7-12,x,FLOAT"), x(type="f32", count=6)),
    "array-range-is-one-value": Feature(rows("Address,Name,Type", "7-8,x,DINT"), x(type="s32")),
    "array-range-backwards": Feature(
        rows("Address,Name", "7,x", "9-8,y"),
        x(),
        ("line 3, y: '9-8' ends before it begins; skipped",),
    ),
    "array-brackets": Feature(rows("Address,Name,Type", "7 [3],x,Word"), x(count=3)),
    "array-two-brackets": Feature(
        rows("Address,Name,Type", "7 [2][3],x,Float Array"), x(type="f32", count=12)
    ),
    "array-of-coils": Feature(
        one("Table,Count", "coil,4"), {"x": {"at": "co:7", "type": "bool", "count": 4}}
    ),
    # Orders.
    "order-swap-flag": Feature(one("Type,Swap", "FLOAT,T"), x(type="f32", order="CDAB")),
    "order-no-swap-flag": Feature(one("Type,Swap", "FLOAT,F"), x(type="f32")),
    "order-little": Feature(
        one("Type,Byte order", "FLOAT,little endian"), x(type="f32", order="DCBA")
    ),
    "order-of-words-only": Feature(
        one("Type,Word order", "FLOAT,little endian"), x(type="f32", order="CDAB")
    ),
    "order-of-words-and-bytes": Feature(
        one("Type,Word order,Byte order", "FLOAT,BIG,LITTLE"), x(type="f32", order="BADC")
    ),
    "order-both-little": Feature(
        one("Type,Word order,Byte order", "FLOAT,little,little"), x(type="f32", order="DCBA")
    ),
    "order-mixed-endian": Feature(
        one("Type,Mixed Endian", "uint32,TRUE"), x(type="u32", order="CDAB")
    ),
    "order-of-one-register": Feature(
        one("Type,Byte order", "INT16,DCBA"), x(type="s16", order="BADC")
    ),
    "order-of-one-register-words": Feature(one("Type,Byte order", "INT16,CDAB"), x(type="s16")),
    "order-unknown": Feature(
        rows("Address,Name,Endian", "7,x,", "8,y,upside"),
        x(),
        ("line 3, y: 'upside' is not a byte order; skipped",),
    ),
    "order-option": Feature(
        rows("Address,Name,Type", "7,a,FLOAT", "9,b,WORD"),
        {
            "a": {"at": "hr:7", "type": "f32", "order": "DCBA"},
            "b": {"at": "hr:9", "type": "u16"},
        },
        options={"order": "DCBA"},
    ),
    "order-file-before-option": Feature(
        one("Type,Order", "FLOAT,BADC"), x(type="f32", order="BADC"), options={"order": "CDAB"}
    ),
    # Scale and offset.
    "scale-decimal-comma": Feature(
        "Address;Name;Factor;Q\n7;x;0,1;-40,5\n", x(scale=0.1, offset=-40.5)
    ),
    "scale-fraction": Feature(one("Scale", "1/100"), x(scale=0.01)),
    "scale-one-and-zero": Feature(one("Scale,Offset", "1,0"), x()),
    "scale-of-many-digits": Feature(
        one("Scale", "1e300"), x(), ("line 2, x: scale 1e+300 has too many digits; skipped",)
    ),
    "scale-endless": Feature(
        one("Scale", "1e999"),
        x(),
        ("line 2, x: scale '1e999' is not a usable number; skipped",),
    ),
    "scale-power": Feature(one("Gain", "1e-3"), x(scale=0.001)),
    "scale-no-number": Feature(
        one("Multiplier", "times ten"),
        x(),
        ("line 2, x: scale 'times ten' is not a usable number; skipped",),
    ),
    "scale-zero": Feature(
        one("Scale", "0"), x(), ("line 2, x: scale '0' is not a usable number; skipped",)
    ),
    "scale-transform": Feature(one("Transform", "scale(0.01)"), x(scale=0.01)),
    "scale-transform-other": Feature(
        one("Transform", "mod10k(True)"),
        x(),
        ("line 2, x: scale 'mod10k(True)' is not a usable number; skipped",),
    ),
    "scale-limits": Feature(
        one("InLo,InHi,OutLo,OutHi", "0,1000,-50,150"), x(scale=0.2, offset=-50)
    ),
    "scale-limits-missing": Feature(
        one("X1,X2,Y1,Y2", "0,1000,,"),
        x(),
        ("line 2, x: scaling without its four limits; skipped",),
    ),
    "scale-beside-limits": Feature(
        one("K,X1,X2,Y1,Y2", "0.5,0,10,0,100"),
        x(scale=0.5),
        ("line 2, x: scale and offset count; the four limits beside them are ignored",),
    ),
    "scale-offset-no-number": Feature(
        one("Offset", "low"), x(), ("line 2, x: offset 'low' is not a number; skipped",)
    ),
    "scale-of-a-bit": Feature(
        rows("Address,Name,Scale", "7.3,x,10"),
        {"x": {"at": "hr:7.3", "type": "bool"}},
        ("line 2, x: scale 10 does not apply to a bool; skipped",),
    ),
    # Addresses and tables.
    "at-hexadecimal": Feature(
        rows("Address,Name", "0x6B,a", "6Ch,b"),
        {"a": {"at": "hr:107", "type": "u16"}, "b": {"at": "hr:108", "type": "u16"}},
    ),
    "at-with-table": Feature(
        rows("Address,Name", "HR107,a", "IR 7,b", "c:5,c", "DI5,d", "4x0108,e", "3x8,f"),
        {
            "a": {"at": "hr:107", "type": "u16"},
            "b": {"at": "ir:7", "type": "u16"},
            "c": {"at": "co:5", "type": "bool"},
            "d": {"at": "di:5", "type": "bool"},
            "e": {"at": "hr:108", "type": "u16"},
            "f": {"at": "ir:8", "type": "u16"},
        },
    ),
    "at-of-a-plc": Feature(
        rows("Address,Name", "7,x", "MW100,y", "%IX0.1,z"),
        x(),
        (
            "line 3, y: 'MW100': 'MW' is not a known table; skipped",
            "line 4, z: '%IX0.1' is not an address; skipped",
        ),
    ),
    "at-nothing": Feature(
        rows("Address,Name", "7,x", ",y"), x(), ("line 3, y: no address; skipped",)
    ),
    "at-base-1": Feature(rows("Address,Name", "8,x"), x(), options={"base": 1}),
    "at-0-with-base-1": Feature(
        rows("Address,Name", "8,x", "0,y"),
        x(),
        ("line 3, y: '0' is not an address where counting starts at 1; skipped",),
        {"base": 1},
    ),
    "at-beyond-the-last": Feature(
        rows("Address,Name", "7,x", "65536,y"),
        x(),
        ("line 3, y: '65536' is not an address where counting starts at 0; skipped",),
    ),
    "at-reaching-beyond-the-last": Feature(
        rows("Address,Name,Type", "7,x,", "65535,y,FLOAT"),
        x(),
        ("line 3, y: wire address 65536 does not exist; skipped",),
    ),
    "at-modicon-hexadecimal": Feature(
        rows("Address,Name", "40008,x", "0x006B,y"),
        x(),
        ("line 3, y: '0x006B' is not a Modicon address; skipped",),
        {"base": "modicon"},
    ),
    "at-modicon-of-another-table": Feature(
        rows("Address,Table,Name", "40008,holding,x", "30008,holding,y"),
        x(),
        ("line 3, y: '30008' is not a Modicon address of hr; skipped",),
        {"base": "modicon"},
    ),
    "at-modicon-short": Feature(
        rows("Address,Table,Name", "8,holding,x", "00006,,y"),
        {"x": {"at": "hr:7", "type": "u16"}, "y": {"at": "co:5", "type": "bool"}},
        options={"base": "modicon"},
    ),
    "table-words": Feature(
        rows(
            "Table,Address,Name",
            "Holding Register,7,a",
            "input,7,b",
            "coil,7,c",
            "discrete_input,7,d",
        ),
        {
            "a": {"at": "hr:7", "type": "u16"},
            "b": {"at": "ir:7", "type": "u16"},
            "c": {"at": "co:7", "type": "bool"},
            "d": {"at": "di:7", "type": "bool"},
        },
    ),
    "table-function-codes": Feature(
        rows("Function,Address,Name", "3,7,a", "04,7,b", "FC01,7,c", "2,7,d", "16,8,e"),
        {
            "a": {"at": "hr:7", "type": "u16"},
            "b": {"at": "ir:7", "type": "u16"},
            "c": {"at": "co:7", "type": "bool"},
            "d": {"at": "di:7", "type": "bool"},
            "e": {"at": "hr:8", "type": "u16"},
        },
    ),
    "table-numbers": Feature(
        rows("Table,Address,Name", "3,7,a", "4,7,b"),
        {"a": {"at": "hr:7", "type": "u16"}, "b": {"at": "ir:7", "type": "u16"}},
        ("numbers that name tables are function codes (assumed)",),
    ),
    "table-unknown": Feature(
        rows("Table,Address,Name", "holding,7,x", "memory,8,y"),
        x(),
        ("line 3, y: table 'memory' is not known; skipped",),
    ),
    # Bits and halves.
    "bit-of-a-register": Feature(
        rows("Address,Name,Type", "7.0,a,BOOL", "7.15,b,"),
        {"a": {"at": "hr:7.0", "type": "bool"}, "b": {"at": "hr:7.15", "type": "bool"}},
    ),
    "bit-beyond": Feature(
        rows("Address,Name", "7,x", "7.16,y"),
        x(),
        ("line 3, y: bit 16 is not one of 0 to 15; skipped",),
    ),
    "bit-of-a-number": Feature(
        rows("Address,Name,Type", "7,x,", "7.5,y,INT16"),
        x(),
        ("line 3, y: a bit of a register is a bool, not 'INT16'; skipped",),
    ),
    "bit-halves": Feature(
        rows("Address,Name,Type", "7.Lo,a,", "7.Hi,b,INT8"),
        {"a": {"at": "hr:7", "type": "u8l"}, "b": {"at": "hr:7", "type": "s8h"}},
    ),
    # Access, labels, sentinels, units.
    "access-words": Feature(
        rows(
            "Address,Name,Access",
            "1,a,R/W",
            "2,b,RO",
            "3,c,Write Only",
            "4,d,Read/Write",
            "5,e,owner",
        ),
        {
            "a": {"at": "hr:1", "type": "u16", "access": "rw"},
            "b": {"at": "hr:2", "type": "u16"},
            "c": {"at": "hr:3", "type": "u16", "access": "w"},
            "d": {"at": "hr:4", "type": "u16", "access": "rw"},
            "e": {"at": "hr:5", "type": "u16"},
        },
        ("line 6, e: access 'owner' is not known; skipped",),
    ),
    "access-flag": Feature(one("Writable", "TRUE"), x(access="rw")),
    "enum-pairs": Feature(
        one("Enum", '"0=off, by hand;0x10=on;-1=fault"'),
        x(enum={"0": "off, by hand", "16": "on", "-1": "fault"}),
    ),
    "enum-json": Feature(
        'Address;Name;Values\n7;x;{"0": "off", "1": "on"}\n', x(enum={"0": "off", "1": "on"})
    ),
    "enum-that-is-none": Feature(
        one("Values", "see manual"),
        x(),
        ("line 2, x: labels 'see manual' are not understood; skipped",),
    ),
    "enum-that-is-a-range": Feature(
        one("Values", "-5~100%"), x(), ("a range of values: cannot be kept in a profile",)
    ),
    "enum-of-a-float": Feature(
        one("Type,Enum", "FLOAT,0=off"),
        x(type="f32"),
        ("line 2, x: enum {'0': 'off'} does not apply to a f32; skipped",),
    ),
    "nan-raw-values": Feature(one("Type,NaN", "INT16,0x8000;-1"), x(type="s16", nan=[0x8000, -1])),
    "nan-fraction-of-a-whole": Feature(
        one("NaN", "1.5"), x(), ("line 2, x: nan [1.5] is not a raw value of a u16; skipped",)
    ),
    "enum-without-a-label": Feature(one("Enum", "0=;1=on"), x(enum={"1": "on"})),
    "nan-no-number": Feature(
        one("NaN", "none"), x(), ("line 2, x: no value 'none' is not a number; skipped",)
    ),
    "slave-one": Feature(one("Slave", "3"), x()),
    "slave-chosen": Feature(
        rows("Address,Name,Slave ID", "7,x,3", "7,y,4"), x(), options={"unit": 3}
    ),
    # Rows.
    "row-longer-than-the-head": Feature(
        rows("Address,Name,Factor", "7,x,1", "8,y,0,1"),
        x(),
        (
            "line 3: 4 cells, but 3 columns; skipped (a decimal comma, or a text without "
            "quotation marks?)",
        ),
    ),
    "row-shorter-than-the-head": Feature(rows("Address,Name,Unit", "7,x"), x()),
    "row-of-commas": Feature(rows("Address,Name,Unit", ",,", "7,x,"), x()),
    "row-of-two-lines": Feature(
        'Address,Name,Note\n7,x,"two\nlines"\n8,y,z\n9,bad\n,w\n',
        {
            "x": {"at": "hr:7", "type": "u16", "note": "two\nlines"},
            "y": {"at": "hr:8", "type": "u16", "note": "z"},
            "bad": {"at": "hr:9", "type": "u16"},
        },
        ("line 6, w: no address; skipped",),
    ),
    "row-twice": Feature(
        rows("Address,Name", "7,x", "7,x"), x(), ("line 3, x: hr:7 belongs to x; skipped",)
    ),
    "row-name-twice": Feature(
        rows("Address,Name", "7,x", "8,x"),
        {**x(), "x_2": {"at": "hr:8", "type": "u16"}},
        ("line 3, x: the name appears twice; renamed to x_2",),
    ),
    "row-without-name": Feature(
        rows("Address,Name,Unit", "7,,V"), {"hr_7": {"at": "hr:7", "type": "u16", "unit": "V"}}
    ),
    # Tables of programs.
    "preset-mervis": Feature(
        "StationNumber;Name;Element;Count;Function;Writable;StType;ByteOrder;K;Q;X1;Y1;X2;Y2\n"
        "2;supply;20;2;3;0;REAL;3412;0,1;-3;;;;\n"
        "2;run;21.1;1;3;1;BOOL;;;;;;;\n2;alarm;21.16;1;3;0;BOOL;;;;;;;\n",
        {
            "supply": {"at": "hr:20", "type": "f32", "order": "CDAB", "scale": 0.1, "offset": -3},
            "run": {"at": "hr:21.0", "type": "bool", "access": "rw"},
            "alarm": {"at": "hr:21.15", "type": "bool"},
        },
        ("a table of Mervis",),
    ),
    "preset-control-solutions": Feature(
        "RW,TYPE,REG,FORMAT,SLAVE,SWAP,SCALE,OFFSET,POLL\nR,HR,8,UINT16,1,F,0.1,0,5\n"
        "W,IR,20,FLOAT,1,T,1,0,5\n",
        {
            "hr_7": {"at": "hr:7", "type": "u16", "scale": 0.1},
            "ir_19": {"at": "ir:19", "type": "f32", "order": "CDAB", "access": "w"},
        },
        ("a table of Control Solutions", "column 'POLL' cannot be kept in a profile; skipped"),
    ),
    "preset-kaspersky": Feature(
        "ID;Varname;Connection;Address;Datatype;Length;InLo;InHi;OutLo;OutHi;Description;EngUnits;"
        "EnumName\n1;level;plc;400108;INT16;1;0;1000;0;100;tank;%;\n",
        {"level": {"at": "hr:107", "type": "s16", "scale": 0.1, "unit": "%", "note": "tank"}},
        (
            "a table of Kaspersky",
            "column 'ID' is not understood; skipped",
            "column 'Connection' is not understood; skipped",
            "column 'EnumName' is not understood; skipped",
        ),
    ),
    "preset-python-protocol-gateway": Feature(
        "variable name;data type;register;documented name;length;writeable;unit;values;note\n"
        'grid;USHORT;7;grid voltage;;R;0.1V;;\nyield;UINT;8;;;R;kWh;;\nmode;USHORT;10;;;RW;;{"0": '
        '"idle", "1": "run"};\n',
        {
            "grid": {
                "at": "hr:7",
                "type": "u16",
                "scale": 0.1,
                "unit": "V",
                "note": "grid voltage",
            },
            "yield": {"at": "hr:8", "type": "u32", "unit": "kWh"},
            "mode": {
                "at": "hr:10",
                "type": "u16",
                "access": "rw",
                "enum": {"0": "idle", "1": "run"},
            },
        },
        ("a table of PythonProtocolGateway",),
    ),
    "preset-volttron-by-its-words": Feature(
        "Register Name,Address,Type,Units,Writable,Transform,Table,Mixed Endian\n"
        "flow,7,float,l/s,FALSE,scale(0.1),analog_input_registers,TRUE\n"
        "pump,5,bool,,TRUE,,discrete_output_coils,FALSE\n",
        {
            "flow": {"at": "ir:7", "type": "f32", "order": "CDAB", "scale": 0.1, "unit": "l/s"},
            "pump": {"at": "co:5", "type": "bool", "access": "rw"},
        },
    ),
    "preset-iobroker-by-its-words": Feature(
        "_address\tdeviceId\tname\tdescription\tunit\ttype\tlen\tfactor\toffset\tformula\n"
        "7\t1\tx\tflow\tl/s\tfloatsw\t2\t0.5\t1\t\n",
        x(type="f32", order="CDAB", scale=0.5, offset=1, unit="l/s", note="flow"),
        ("column 'formula' is not understood; skipped",),
    ),
}


@pytest.mark.parametrize("feature", FEATURES.values(), ids=FEATURES)
def test_feature(feature: Feature) -> None:
    """Each feature gives exactly the expected points and notes."""
    assert feature.found("csv") == feature.expected


@pytest.mark.parametrize("key", HEADER_WORDS)
def test_every_word_of_a_head_is_known(key: str) -> None:
    """Each synonym in capitals, beside an address and a name: it is no unknown column."""
    for word in HEADER_WORDS[key]:
        heads = [one for one in ("address", "name") if one != key]
        cells = ["u16" if key == "type" else "1", *("1" for _ in heads)]
        said = notes("csv", f"{','.join([word.upper(), *heads])}\n{','.join(cells)}\n")
        assert not [note for note in said if note.startswith("column")], word


@pytest.mark.parametrize("word", TYPE_NAMES)
def test_every_word_of_a_type_is_known(word: str) -> None:
    """Each synonym gives the type of its row."""
    count = "3" if TYPE_NAMES[word] in ("str", "raw") else ""
    (point,) = imported("csv", one("Type,Count", f"{word.upper()},{count}"))["registers"]
    assert point["type"] == ("u16" if TYPE_NAMES[word] == "bool" else TYPE_NAMES[word])


@pytest.mark.parametrize("word", ORDERS)
def test_every_word_of_an_order_is_known(word: str) -> None:
    """Each synonym in a column of byte orders."""
    (point,) = imported("csv", one("Type,Byte order", f"FLOAT,{word}"))["registers"]
    assert point.get("order", "ABCD") == ORDERS[word]


def test_orders_have_one_table() -> None:
    """Section 1.3 of the survey of register maps: every synonym."""
    for order, words in {
        "ABCD": "big BE_BE 1234 highlow MSWLSW none", "CDAB": "lowhigh LSWMSW 3412 sw word",
        "BADC": "2143 sb byte", "DCBA": "4321 little word_byte",
    }.items():  # fmt: skip
        for word in words.split():
            assert importers.parse_order(word, "x") == order
    assert set(ORDERS.values()) == {"ABCD", "CDAB", "BADC", "DCBA"}
    with pytest.raises(UsageError, match="is not a byte order"):
        importers.parse_order("upside down", "x")


@pytest.mark.parametrize(
    ("base", "said"),
    [
        (
            None,
            "addresses count from 0, as on the wire (assumed; --base 0, 1 or modicon overrides)",
        ),
        (
            0,
            "addresses count from 0, as on the wire (as given; --base 0, 1 or modicon overrides)",
        ),
        (1, "addresses count from 1 (as given; --base 0, 1 or modicon overrides)"),
        (
            "modicon",
            "addresses count 40001 or 400001 (as given; --base 0, 1 or modicon overrides)",
        ),
    ],
)
def test_the_assumed_base_is_noted(base: int | str | None, said: str) -> None:
    """The base is assumed or given, and that no column names the table is noted."""
    found = importers.read("csv", "Address,Name\n40008,x\n", "map", Options(base=base))
    assert said in found.notes
    assumed = "no column names the table: holding registers (assumed)"
    assert (assumed in found.notes) == (base != "modicon")


@pytest.mark.parametrize(
    ("line", "options", "said"),
    [
        ("FLOAT,", Options(), True),
        ("FLOAT,ABCD", Options(), False),
        ("FLOAT,none", Options(), False),
        ("FLOAT,", Options(order="ABCD"), False),
        ("WORD,", Options(), False),
        ("floatbe,", Options(), False),
    ],
)
def test_an_assumed_order_is_noted(line: str, options: Options, said: bool) -> None:
    """Where a value takes several registers and neither the file nor an option says the order."""
    found = importers.read("csv", one("Type,Byte order", line), "map", options)
    note = (
        "values of several registers: highest register first, ABCD (assumed; --order overrides it)"
    )
    assert (note in found.notes) == said


def test_several_units_want_one_chosen() -> None:
    """No unit is given, or one that is not in the file."""
    text = rows("Address,Name,Slave", "7,x,3", "7,y,4")
    for unit in (None, 9):
        with pytest.raises(UsageError, match=r"map: choose a unit with --unit N; there are 3, 4"):
            points("csv", text, unit=unit)


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("Name,Type\nx,INT16\n", 1, "no line names the columns.*begins with 'Name,Type'"),
        ('Address,Name\n7,x\n8,"y\n9,z\n', 3, "not CSV from here on: .*quotation marks"),
        ("at,name,type\nhr:1,x,u23\n", 2, r"registers\[0\].type: .* is not one of"),
        (
            "Address,Name\n,x\n",
            None,
            "it has no point that a profile can hold: line 2, x: no addre",
        ),
        ("", None, "the file is empty"),
    ],
)
def test_what_is_no_table(text: str, line: int | None, part: str) -> None:
    """Texts that are no table are refused with line and reason."""
    with pytest.raises(ProfileError, match=part) as raised:
        importers.read("csv", text, "map")
    assert raised.value.line == line


def test_the_own_csv_says_everything_itself() -> None:
    """Columns in any order; options have nothing to say, which is said."""
    text = "#base=1\nname;at\nx;hr:8\n"
    assert points("csv", text) == x()
    assert notes("csv", text, base=0, unit=3) == [
        "--base is ignored: a profile in CSV states it itself",
        "--unit is ignored: a profile in CSV states it itself",
    ]


def test_no_cell_is_a_formula_or_controls_a_terminal() -> None:
    """A profile may come from anybody, and its table is opened in a spreadsheet."""
    point = {"at": "hr:7", "name": "x", "note": "=1+1", "group": "'@x", "unit": "\x1b[31mkW"}
    profile = from_model({"profile": 1, "registers": [point]}, "map")
    written = importers.write("csv", profile)
    cells = written.text.replace("\n", ",").split(",")
    assert "'=1+1" in cells
    assert not [cell for cell in cells if cell.startswith(("=", "@")) or "\x1b" in cell]
    read = importers.read("csv", written.text, "map").model["registers"][0]
    assert (read["note"], read["group"], read["unit"]) == ("=1+1", "'@x", "?[31mkW")
