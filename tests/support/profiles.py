"""Profiles of any kind, for property tests: models as files say them, with wire addresses."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from dissectors.importers.profile_builder import REGISTERS_OF_TYPE

__all__ = ["models"]

NUMBERS = [kind for kind in REGISTERS_OF_TYPE if kind != "bool"]
TEXTS = ("str", "strh", "strl", "raw")
FLOATS = ("f16", "f32", "f64")

words = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cs", "Cc")), min_size=1, max_size=8
).filter(lambda text: text.strip() == text)
# A scale of 1 and an offset of 0 say nothing; other programs do not tell them from none.
decimals = (
    st.integers(-9999, 9999)
    .filter(lambda number: number not in (0, 100))
    .map(lambda number: number / 100)
)


@st.composite
def points(draw: st.DrawFn, space: str, address: int, name: str) -> dict[str, Any]:
    """A point at an address, with any of the keys that go with its type."""
    point: dict[str, Any] = {"name": name, "at": f"{space}:{address}"}
    kind = "bool"
    if space in ("hr", "ir"):
        part = draw(st.sampled_from(["", "", "", ".0", ".7", ".15", ".4-7"]))
        point["at"] += part
        kind = draw(st.sampled_from((*NUMBERS, *TEXTS))) if not part else "u16"
        kind = "bool" if part and "-" not in part else kind
        point["order"] = draw(st.sampled_from(["ABCD", "CDAB", "BADC", "DCBA"]))
        width = REGISTERS_OF_TYPE.get(kind, 1)
        if kind in TEXTS:
            point["count"] = draw(st.integers(1, 4))
        elif not part and draw(st.booleans()):
            point["count"] = width * draw(st.integers(1, 3))
    elif draw(st.booleans()):
        point["count"] = draw(st.integers(1, 4))
    point["type"] = kind
    point["access"] = draw(st.sampled_from(["r", "w", "rw"]))
    keys: dict[str, st.SearchStrategy[Any]] = {"unit": words, "group": words, "note": words}
    if kind != "bool" and kind not in TEXTS:
        keys |= {"scale": decimals, "offset": decimals}
        keys["nan"] = st.lists(st.integers(0, 0xFF), min_size=1, max_size=2, unique=True)
    if kind not in FLOATS and kind not in TEXTS:
        keys["enum"] = st.dictionaries(st.integers(0, 9).map(str), words, min_size=1, max_size=2)
    if kind in ("u16", "u32") and "." not in point["at"]:
        keys["bits"] = st.dictionaries(st.integers(0, 15).map(str), words, min_size=1, max_size=2)
    for key, values in keys.items():
        if draw(st.integers(0, 2)) == 0:
            point[key] = draw(values)
    return point


@st.composite
def models(draw: st.DrawFn) -> dict[str, Any]:
    """A whole profile: some device, some points that do not meet."""
    device: dict[str, Any] = {"address_base": 0}
    for key in ("id", "vendor", "model", "source", "note"):
        if draw(st.integers(0, 2)) == 0:
            device[key] = draw(words)
    if draw(st.booleans()):
        device["order"] = draw(st.sampled_from(["CDAB", "DCBA"]))
        device["functions"] = [3, 16]
        device["exceptions"] = {"4": draw(words)}
    spaces = draw(st.lists(st.sampled_from(["hr", "ir", "co", "di"]), min_size=1, max_size=5))
    rows = [draw(points(space, 20 * turn, f"p{turn}")) for turn, space in enumerate(spaces)]
    return {"profile": 1, "device": device, "registers": rows}
