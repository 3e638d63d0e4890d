"""Kepware's CSV, a test a feature, from its documented columns: addresses, types, scaling."""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.importing import Feature, notes, points

HEAD = (
    "Tag Name,Address,Data Type,Respect Data Type,Client Access,Scan Rate,Scaling,Raw Low,Raw High,"
    "Scaled Low,Scaled High,Scaled Data Type,Clamp Low,Clamp High,Eng Units,Description,"
    "Negate Value\n"
)

SAID = (
    "a table of Kepware",
    "values of several registers: lowest register first, CDAB (assumed; it is a setting of the "
    "device that the file does not have; --order overrides it)",
    "column 'Respect Data Type' cannot be kept in a profile; skipped",
    "column 'Scan Rate' cannot be kept in a profile; skipped",
    "column 'Scaled Data Type' cannot be kept in a profile; skipped",
)


def tag(
    address: str, kind: str, access: str = "RO", scaling: str = "None,,,,,,,", rest: str = ",,"
) -> str:
    """A tag called T; `scaling` are its eight columns, from Scaling to Clamp High."""
    return f'{HEAD}"T","{address}",{kind},1,{access},100,{scaling},{rest}\n'


def linear(limits: str, clamp: str = "0,0") -> str:
    """The eight columns of linear scaling."""
    return f"Linear,{limits},Double,{clamp}"


def t(at: str, kind: str = "u16", **keys: Any) -> dict[str, dict[str, Any]]:
    """The point T."""
    return {"T": {"at": at, "type": kind, **keys}}


CDAB = {"order": "CDAB"}

FEATURES = {
    # Addresses.
    "at-five-digits": Feature(tag("40108", "Word"), t("hr:107"), SAID),
    "at-six-digits": Feature(tag("400108", "Word"), t("hr:107"), SAID),
    "at-input-register": Feature(tag("300008", "Word"), t("ir:7"), SAID),
    "at-coil": Feature(tag("000006", "Boolean", "R/W"), t("co:5", "bool", access="rw"), SAID),
    "at-discrete-input": Feature(tag("100006", "Boolean"), t("di:5", "bool"), SAID),
    "at-last": Feature(tag("465536", "Word"), t("hr:65535"), SAID),
    "at-bit": Feature(tag("40001.5", "Boolean"), t("hr:0.5", "bool"), SAID),
    "at-text-high-byte-first": Feature(
        tag("400200.20H", "String"), t("hr:199", "str", count=10), SAID
    ),
    "at-text-low-byte-first": Feature(
        tag("400200.21L", "String"), t("hr:199", "str", count=11, order="BADC"), SAID
    ),
    "at-array": Feature(tag("400001 [4]", "Word Array"), t("hr:0", count=4), SAID),
    "at-array-of-two": Feature(
        tag("400001 [2][3]", "Float Array"), t("hr:0", "f32", count=12, **CDAB), SAID
    ),
    "at-hexadecimal-is-not-understood": Feature(
        tag("40001", "Word") + '"U","H400100",Word,1,RO,100,None,,,,,,,,,,\n',
        t("hr:0"),
        (*SAID, "line 3, U: 'H400100': 'H' is not a known table; skipped"),
    ),
    # Types.
    **{
        f"type-{word.lower()}": Feature(tag("40001", word), t("hr:0", kind, **keys), SAID)
        for word, kind, keys in [
            ("Short", "s16", {}),
            ("Word", "u16", {}),
            ("Long", "s32", CDAB),
            ("DWord", "u32", CDAB),
            ("LLong", "s64", CDAB),
            ("QWord", "u64", CDAB),
            ("Float", "f32", CDAB),
            ("Double", "f64", CDAB),
            ("BCD", "bcd16", {}),
            ("LBCD", "bcd32", CDAB),
            ("Byte", "u8l", {}),
            ("Char", "s8l", {}),
        ]
    },
    "type-date": Feature(
        tag("40001", "Word") + '"U","40002",Date,1,RO,100,None,,,,,,,,,,\n',
        t("hr:0"),
        (*SAID, "line 3, U: type 'Date' is not known; skipped"),
    ),
    # The order: assumed, or told.
    "order-told": Feature(
        tag("40001", "Float"), t("hr:0", "f32"), (SAID[0], *SAID[2:]), {"order": "ABCD"}
    ),
    # The base: known, or told.
    "base-told": Feature(tag("108", "Word"), t("hr:107"), SAID, {"base": 1}),
    # Scaling.
    "scaling-linear": Feature(
        tag("40001", "Short", scaling=linear("0,1000,0,100")), t("hr:0", "s16", scale=0.1), SAID
    ),
    "scaling-linear-with-offset": Feature(
        tag("40001", "Short", scaling=linear("4000,20000,-50,150")),
        t("hr:0", "s16", scale=0.0125, offset=-100),
        SAID,
    ),
    "scaling-negated": Feature(
        tag("40001", "Short", scaling=linear("0,10,5,25"), rest=",,1"),
        t("hr:0", "s16", scale=-2, offset=-5),
        SAID,
    ),
    "scaling-clamped": Feature(
        tag("40001", "Short", scaling=linear("0,10,0,100", "1,1")),
        t("hr:0", "s16", scale=10),
        (*SAID, "clamplow: cannot be kept in a profile", "clamphigh: cannot be kept in a profile"),
    ),
    "scaling-square-root": Feature(
        tag("40001", "Short", scaling='"Square Root",0,1,0,1,Float,0,0'),
        t("hr:0", "s16"),
        (*SAID, "line 2, T: scaling 'Square Root' is not linear; skipped"),
    ),
    "scaling-without-limits": Feature(
        tag("40001", "Short", scaling=linear("0,,0,100")),
        t("hr:0", "s16"),
        (*SAID, "line 2, T: scaling without its four limits; skipped"),
    ),
    # The rest.
    "unit-and-description": Feature(
        tag("40001", "Word", rest="%,Tank level,0"), t("hr:0", unit="%", note="Tank level"), SAID
    ),
    "access-read-write": Feature(tag("40001", "Word", "R/W"), t("hr:0", access="rw"), SAID),
}


@pytest.mark.parametrize("feature", FEATURES.values(), ids=FEATURES)
def test_feature(feature: Feature) -> None:
    """Each feature gives exactly the expected points and notes."""
    assert feature.found("csv") == feature.expected


def test_a_file_as_it_is_exported() -> None:
    """Several tags, comments above the head as Kepware writes them."""
    text = f"# exported tags\n{HEAD}" + (
        '"Tank.Level","40108",Short,1,R/W,100,Linear,0,1000,0,100,Double,0,0,"%","Tank level",0\n'
        '"Energy","400111",DWord,1,RO,100,None,,,,,,,,"kWh","",0\n'
    )
    assert points("csv", text) == {
        "Tank.Level": {
            "at": "hr:107", "type": "s16", "scale": 0.1, "unit": "%", "access": "rw",
            "note": "Tank level",
        },
        "Energy": {"at": "hr:110", "type": "u32", "order": "CDAB", "unit": "kWh"},
    }  # fmt: skip
    assert notes("csv", text) == list(SAID)
