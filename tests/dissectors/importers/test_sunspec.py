"""SunSpec's JSON models, a test a feature; the models of the Alliance; the shipped ones.

Types and their "not implemented" values are those of the Device Information Model Specification,
section 5.5.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import sunspec2

import _modlens
from dissectors import importers
from dissectors.errors import ProfileError
from dissectors.importers.toml import dumps
from dissectors.profile import from_model
from tests.support.importing import Feature, imported

SUNSPEC = Path(sunspec2.__file__).parent / "models" / "json"


def model(*points: dict[str, Any], **keys: Any) -> str:
    """A model of some points after ID and length."""
    head = [{"name": "ID", "type": "uint16", "size": 1}, {"name": "L", "type": "uint16", "size": 1}]
    return json.dumps({"id": 64, "group": {"name": "own", "points": [*head, *points], **keys}})


def point(kind: str, size: int = 1, **keys: Any) -> dict[str, Any]:
    """A point called x."""
    return {"name": "x", "type": kind, "size": size, **keys}


def x(kind: str = "u16", at: int = 2, nan: int | None = None, **keys: Any) -> dict[str, Any]:
    """The point x after ID and length."""
    if nan is not None:
        keys["nan"] = [nan]
    head = {"type": "u16", "nan": [0xFFFF], "group": "own"}
    return {
        "ID": {"at": "hr:0", **head},
        "L": {"at": "hr:1", **head},
        "x": {"at": f"hr:{at}", "type": kind, "group": "own", **keys},
    }


TYPES = [
    ("int16", 1, "s16", 0x8000), ("uint16", 1, "u16", 0xFFFF), ("count", 1, "u16", None),
    ("acc16", 1, "u16", None), ("enum16", 1, "u16", 0xFFFF), ("bitfield16", 1, "u16", 0xFFFF),
    ("raw16", 1, "u16", None), ("sunssf", 1, "s16", 0x8000), ("int32", 2, "s32", 0x80000000),
    ("uint32", 2, "u32", 0xFFFFFFFF), ("acc32", 2, "u32", None), ("enum32", 2, "u32", 0xFFFFFFFF),
    ("bitfield32", 2, "u32", 0xFFFFFFFF), ("int64", 4, "s64", 0x8000000000000000),
    ("uint64", 4, "u64", 0xFFFFFFFFFFFFFFFF), ("acc64", 4, "u64", None),
    ("bitfield64", 4, "u64", 0xFFFFFFFFFFFFFFFF), ("float32", 2, "f32", None),
    ("float64", 4, "f64", None),
]  # fmt: skip

TEXTS = [("string", 8, "str"), ("ipaddr", 2, "raw"), ("ipv6addr", 8, "raw"), ("eui48", 4, "raw")]

SYMBOLS = [{"name": "OFF", "value": 0}, {"name": "MPPT", "value": 4, "label": "tracking"}]

FEATURES = {
    **{
        f"type-{word}": Feature(model(point(word, size)), x(kind, nan=nan))
        for word, size, kind, nan in TYPES
    },
    **{
        f"type-{word}": Feature(model(point(word, size)), x(kind, count=size))
        for word, size, kind in TEXTS
    },
    "type-pad": Feature(model({"name": "Pad", "type": "pad", "size": 2}, point("acc16")), x(at=4)),
    "type-unknown": Feature(
        model(point("int24", 2)),
        x("raw", count=2),
        ("type int24: is not known, its registers are raw",),
    ),
    "scale-of-a-point": Feature(
        model(point("acc16", sf="F"), {"name": "F", "type": "sunssf", "size": 1}),
        {
            **x(sf="F"),
            "F": {"at": "hr:3", "type": "s16", "nan": [0x8000], "group": "own"},
        },
    ),
    "scale-of-no-point": Feature(
        model(point("acc16", sf="F")),
        x(),
        ("x: there is no point 'F' for its scale factor; left unscaled",),
    ),
    "scale-constant": Feature(model(point("acc16", sf=-3)), x(scale=0.001)),
    "scale-constant-positive": Feature(model(point("acc16", sf=2)), x(scale=100)),
    "scale-constant-0": Feature(model(point("acc16", sf=0)), x()),
    "unit-access-label": Feature(
        model(point("acc16", units="Wh", access="RW", label="Energy")),
        x(unit="Wh", access="rw", note="Energy"),
    ),
    "symbols": Feature(
        model(point("enum16", symbols=SYMBOLS)), x(enum={"0": "OFF", "4": "tracking"}, nan=0xFFFF)
    ),
    "symbols-of-bits": Feature(
        model(point("bitfield16", symbols=SYMBOLS)),
        x(bits={"0": "OFF", "4": "tracking"}, nan=0xFFFF),
    ),
    "left-keys": Feature(
        model(point("acc16", mandatory="M", desc="words", static="S"), desc="a model"),
        x(),
        (
            "desc: cannot be kept in a profile (2 times)",
            "mandatory: cannot be kept in a profile",
            "static: cannot be kept in a profile",
        ),
    ),
    "left-options": Feature(
        model(point("acc16")),
        x(),
        tuple(
            f"--{key} is ignored: a file for sunspec states it itself"
            for key in ("base", "order", "unit")
        ),
        {"base": 1, "order": "CDAB", "unit": 3},
    ),
    "group-once": Feature(
        model(
            point("acc16"),
            groups=[{"name": "Set", "points": [point("acc16", sf="F"), point("sunssf", name="F")]}],
        ),
        {
            **x(),
            "Set_x": {"at": "hr:3", "type": "u16", "sf": "Set_F", "group": "Set"},
            "Set_F": {"at": "hr:4", "type": "s16", "nan": [0x8000], "group": "Set"},
        },
    ),
    "group-twice": Feature(
        model(point("acc16"), groups=[{"name": "Set", "count": 2, "points": [point("acc32", 2)]}]),
        {
            **x(),
            "Set_1_x": {"at": "hr:3", "type": "u32", "group": "Set"},
            "Set_2_x": {"at": "hr:5", "type": "u32", "group": "Set"},
        },
    ),
    "group-as-often-as-the-device-says": Feature(
        model(
            point("acc16"),
            groups=[
                {"name": "Curve", "count": "N", "points": [point("acc16")]},
                {"name": "Tail", "points": [point("acc16")]},
            ],
        ),
        x(),
        ("group Curve, and what follows it: repeats as the device says",),
    ),
    "group-that-repeats-inside-one-that-does-not": Feature(
        model(
            point("acc16"),
            groups=[
                {"name": "Set", "groups": [{"name": "Pt", "count": "N", "points": []}]},
                {"name": "Tail", "points": [point("acc16")]},
            ],
        ),
        x(),
        ("group Pt, and what follows it: repeats as the device says",),
    ),
    "group-to-the-end-of-the-model": Feature(
        model(point("acc16"), groups=[{"name": "Module", "count": 0, "points": [point("acc16")]}]),
        x(),
        ("group Module, and what follows it: repeats as the device says",),
    ),
}


@pytest.mark.parametrize("feature", FEATURES.values(), ids=FEATURES)
def test_feature(feature: Feature) -> None:
    """Each feature gives exactly the expected points and notes."""
    assert feature.found("sunspec") == feature.expected


def test_every_type_of_the_alliance_is_known() -> None:
    """The types of the JSON models, `pad` included."""
    used: set[str] = set()

    def walk(group: dict[str, Any]) -> None:
        used.update(one["type"] for one in group["points"])
        for inner in group.get("groups", ()):
            walk(inner)

    for path in SUNSPEC.glob("model_*.json"):
        walk(json.loads(path.read_text(encoding="utf-8"))["group"])
    assert used <= {word for word, *_ in (*TYPES, *TEXTS)} | {"pad"}


def test_the_device_is_named() -> None:
    """By the number and the label of the model; addresses count from its ID register."""
    assert imported("sunspec", model(label="Own model"))["device"] == {
        "id": "sunspec.64",
        "vendor": "SunSpec Alliance",
        "model": "64 Own model",
        "source": "SunSpec model 64, JSON",
        "address_base": 0,
        "sunspec": 64,
    }


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("{", "map: not a SunSpec model: Expecting"),
        ("[]", "map: not a SunSpec model: "),
        ("{}", "map: not a SunSpec model: 'group' is missing"),
        ('{"id": 1, "group": 3}', "map: not a SunSpec model: "),
        ('{"id": 1, "group": {"points": [{"name": "a"}]}}', "'type' is missing"),
        (model(point("acc16", -1)), "map: not a SunSpec model: size -1 of x"),
    ],
)
def test_what_is_no_model(text: str, part: str) -> None:
    """A file that is no model is refused with its name."""
    with pytest.raises(ProfileError, match=part):
        importers.read("sunspec", text, "map")


@pytest.mark.parametrize(("number", "text"), _modlens.sunspec_models())
def test_shipped_models_are_those_of_the_alliance(number: int, text: str) -> None:
    """The importer makes them from the JSON of the package pysunspec2."""
    source = (SUNSPEC / f"model_{number}.json").read_text(encoding="utf-8")
    found = importers.read("sunspec", source, f"model_{number}.json")
    assert text.split("\n", 2)[2] == dumps(from_model(found.model, "x").model)


def test_every_model_of_the_alliance_is_read() -> None:
    """Each is a profile; what is left out are words, and groups that repeat."""
    for path in sorted(SUNSPEC.glob("model_*.json")):
        found = importers.read("sunspec", path.read_text(encoding="utf-8"), path.name)
        from_model(found.model, path.name)
        for note in found.notes:
            words = ("repeats as the device says", "cannot be kept in a profile")
            assert any(word in note for word in words), (path.name, note)


def test_model_704_has_its_groups_once() -> None:
    """Its four power factor groups stand one after the other, two registers each (IEEE 1547)."""
    text = (SUNSPEC / "model_704.json").read_text(encoding="utf-8")
    rows = {row["name"]: row["at"] for row in imported("sunspec", text)["registers"]}
    group = json.loads(text)["group"]
    behind = sum(one["size"] for one in group["points"])
    names = ("PFWInj", "PFWInjRvrt", "PFWAbs", "PFWAbsRvrt")
    assert [rows[f"{name}_PF"] for name in names] == [
        f"hr:{behind + 2 * turn}" for turn in range(4)
    ]
    assert rows["PFWAbsRvrt_Ext"] == f"hr:{behind + 7}"
