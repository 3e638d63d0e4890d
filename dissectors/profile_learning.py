"""Conclusions from a survey of traffic: a profile skeleton, and how well a profile fits.

The survey is made by `_modlens.Survey`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from dissectors.importers.profile_builder import REGISTERS_OF_TYPE
from dissectors.profile import Profile

__all__ = ["ProfileScore", "answer_lines", "evidence_lines", "profile_skeleton", "score_profile"]

Tables = Sequence[Mapping[str, Any]]
Registers = Mapping[tuple[str, int], Sequence[Mapping[str, Any]]]

_SMALLEST, _LARGEST = 127 - 20, 127 + 40
"""The exponents of float32 of 1e-6 and of 1e12."""

_LARGE = 0x2000
"""The upper register of an integer that is larger than what devices count."""

MIN_PERCENT = 60
"""A profile with at least so many per cent fits."""


ANSWERS = (
    "unit", "register_type", "address", "count", "type", "order", "layout_bits", "role",
    "role_bits", "scale", "unit_symbol", "scale_bits", "quantity", "quantity_bits",
)  # fmt: skip
"""The keys of a line of `answer_lines`."""


def answer_lines(tables: Tables) -> str:
    """What was learned as JSON lines, an object per value; null where the data do not say."""
    rows = [
        {"unit": table["unit"], "register_type": table["register_type"], **answer}
        for table in tables for answer in table["answers"]
    ]  # fmt: skip
    return "".join(json.dumps({key: row[key] for key in ANSWERS}) + "\n" for row in rows)


def profile_skeleton(tables: Tables, source: str) -> dict[str, Any]:
    """A profile model with a point for every register, or group of registers, that was seen.

    Points whose type is certain get type and order; the others are single registers, with the most
    likely type in the note.
    """
    registers = []
    for table in tables:
        sure = {point["address"]: point for point in table["points"] if point["sure"]}
        guesses = {point["address"]: point for point in table["points"] if not point["sure"]}
        taken = {
            address + offset for address, point in sure.items() for offset in range(point["count"])
        }
        answers = {answer["address"]: answer for answer in table["answers"]}
        for register in table["registers"]:
            address = register["address"]
            if address in sure:
                point = _typed_point(table, sure[address], register)
            elif address not in taken:
                point = _single_register(table, register, guesses.get(address))
            else:
                continue
            registers.append({**point, **_scaled(answers.get(address), point["note"])})
    device = {"source": f"learned from {source}", "address_base": 0}
    return {"profile": 1, "device": device, "registers": registers}


def evidence_lines(tables: Tables) -> Iterator[str]:
    """The evidence in lines of text: blocks, learned types, registers that change together."""
    for table in tables:
        head = f"unit {table['unit']} {table['space']}"
        blocks = ", ".join(_block(block) for block in table["blocks"])
        yield f"{head}: {len(table['registers'])} addresses in {blocks}"
        for point in table["points"]:
            sure = "" if point["sure"] else "undecided; perhaps "
            yield (
                f"{head} {point['address']}: {sure}{point['type']} {point['order']} "
                f"(evidence {point['bits']:.0f} bits): {point['reason']}"
            )
        for answer in table["answers"]:
            if answer["unit_symbol"] is not None:
                scale = f"{answer['unit_symbol']} x {answer['scale']:g}"
                why = f"{scale}: {answer['scale_reason']}"
                yield f"{head} {answer['address']}: {answer['role']}, {why}"
        for first, second in table["together"]:
            yield f"{head}: {first} and {second} change together"


def _block(block: Mapping[str, Any]) -> str:
    last = block["first"] + block["count"] - 1
    words = [f"{block['reads']} reads"] if block["reads"] else []
    words += [f"{block['writes']} writes"] if block["writes"] else []
    words += [f"exception {code} {n} times" for code, n in block["exceptions"].items()]
    return f"{block['first']}-{last} ({', '.join(words)})"


def _typed_point(
    table: Mapping[str, Any], point: Mapping[str, Any], register: Mapping[str, Any]
) -> dict[str, Any]:
    found = {**_address_keys(table, register), "type": point["type"]}
    if point["type"] == "str":
        found["count"] = point["count"]
    if point["order"] != "ABCD":
        found["order"] = point["order"]
    return {**found, "note": point["reason"]}


def _single_register(
    table: Mapping[str, Any], register: Mapping[str, Any], guess: Mapping[str, Any] | None
) -> dict[str, Any]:
    """A point of one register, with what its values look like in the note."""
    found = _address_keys(table, register)
    if register["looks"] == "signed":
        found["type"] = "s16"
    note = f"{register['looks']}, {register['min']} to {register['max']}"
    if register["looks"] == "enum":
        note = f"one of {', '.join(map(str, register['values']))}"
    elif register["looks"] == "constant":
        note = f"constant {register['min']}"
    if guess is not None:
        note += f"; perhaps {guess['type']} {guess['order']}: {guess['reason']}"
    return {**found, "note": note}


def _scaled(answer: Mapping[str, Any] | None, note: str) -> dict[str, Any]:
    """Scale and unit of a point, and its role in the note, where they are known."""
    if answer is None:
        return {}
    found: dict[str, Any] = {}
    if answer["scale"] not in (None, 1.0):
        found["scale"] = answer["scale"]
    if answer["unit_symbol"] is not None:
        found["unit"] = answer["unit_symbol"]
        note = f"{note}; {answer['scale_reason']}"
    if answer["role"] is not None and answer["role"] not in note:
        note = f"{note}; {answer['role']}"
    return {**found, "note": note}


def _address_keys(table: Mapping[str, Any], register: Mapping[str, Any]) -> dict[str, Any]:
    space, address = table["space"], register["address"]
    found = {"at": f"{space}:{address}", "name": f"{space}_{address}"}
    if register["written"]:
        found["access"] = "rw" if register["read"] else "w"
    return found


@dataclass(frozen=True, slots=True)
class ProfileScore:
    """How well a profile fits, in per cent, and the reasons."""

    points: int
    reasons: tuple[str, ...]
    share: float = 0.0
    """The share of the profile's points that were asked for: it decides between equal points."""

    @property
    def fits(self) -> bool:
        """Whether the profile probably belongs to the unit."""
        return self.points >= MIN_PERCENT


def score_profile(tables: Tables, profile: Profile) -> ProfileScore:
    """Rate how well a profile fits the traffic of a unit.

    The share of the requested addresses that the profile has, or where blocks are read that have
    holes, its mean with the share of the profile's points that were asked for. It is reduced by
    exception responses, by values that requests split, by values without a label, and by registers
    that cannot be what the profile says.
    """
    points = [_Point.of(point) for point in profile.points]
    known = {place for point in points for place in point.addresses}
    requested = {
        (table["space"], address)
        for table in tables
        for block in table["blocks"]
        for address in range(block["first"], block["first"] + block["count"])
    }
    if not requested or not known:
        return ProfileScore(0, ("nothing to compare",))
    covered = requested & known
    asked_for = [point for point in points if requested.issuperset(point.addresses)]
    share = len(asked_for) / len(points)
    coverage = len(covered) / len(requested)
    coverage = max(coverage, (coverage + share) / 2)
    refused = sum(
        count for table in tables for block in table["blocks"]
        if _addresses(table, block) & known for count in block["exceptions"].values()
    )  # fmt: skip
    answered = sum(
        block["reads"] + block["writes"] for table in tables for block in table["blocks"]
        if _addresses(table, block) & known
    )  # fmt: skip
    registers = _registers(tables, known)
    split_by_requests = [point.name for point in points if _is_split_by_requests(point, tables)]
    with_unknown_values = [point.name for point in points if point.has_unknown_values(registers)]
    unlikely = [point.name for point in points if point.is_implausible(registers)]
    other = [point.name for point in points if point.is_learned_otherwise(tables)]
    reasons = [f"{len(covered)} of {len(requested)} requested addresses are in this profile"]
    total = coverage
    if answered and refused:
        total *= 1 - refused / answered
        reasons.append(f"{refused} of {answered} requests for them got an exception")
    for names, words in (
        (split_by_requests, "only partly covered by requests"),
        (with_unknown_values, "with values outside its labels"),
        (unlikely, "with registers that are no such number"),
        (other, "with registers that the values show to be another number"),
    ):
        if names:
            total *= 0.5 ** min(len(names), 3)
            reasons.append(f"{', '.join(names[:3])} {words}")
    return ProfileScore(round(100 * total), tuple(reasons), share)


@dataclass(frozen=True, slots=True)
class _Point:
    """The properties of a point that matter for the rating."""

    name: str
    space: str
    address: int
    width: int
    labels: frozenset[int]
    kind: str
    high: int
    """The register with the highest bits of a number of two registers."""

    @classmethod
    def of(cls, point: Mapping[str, Any]) -> _Point:
        space, _, place = point["at"].partition(":")
        address, _, bits = place.partition(".")
        width = point.get("count") or REGISTERS_OF_TYPE[point["type"]]
        one = not bits and REGISTERS_OF_TYPE.get(point["type"]) == 1 and "scale" not in point
        labels = frozenset(map(int, point.get("enum", ()))) if one else frozenset()
        first = int(address)
        high = first + 1 if point.get("order") in ("CDAB", "DCBA") else first
        return cls(point["name"], space, first, width, labels, str(point["type"]), high)

    @property
    def addresses(self) -> Iterable[tuple[str, int]]:
        return [(self.space, self.address + offset) for offset in range(self.width)]

    def is_implausible(self, registers: Registers) -> bool:
        """Whether the upper register of a 32-bit number had values that such numbers hardly have.

        A float beyond 1e-6 to 1e12, an integer above half a thousand million.
        """
        if self.kind not in ("f32", "u32", "s32"):
            return False
        return any(
            not _is_likely_upper(self.kind, register[end])
            for register in registers.get((self.space, self.high), ())
            for end in ("min", "max")
        )

    def is_learned_otherwise(self, tables: Tables) -> bool:
        """Whether the values show a number in these registers that the profile does not have.

        One that begins elsewhere or is longer, or a float instead of an integer. Longer points of
        the profile, such as texts and arrays, are not compared.
        """
        if self.width > REGISTERS_OF_TYPE["f64"]:
            return False
        end = self.address + self.width
        learned = [
            point for table in tables if table["space"] == self.space
            for point in table["points"]
            if point["sure"] and point["type"] != "str"
            and point["address"] < end and self.address < point["address"] + point["count"]
        ]  # fmt: skip
        return any(
            (point["address"], point["count"]) != (self.address, self.width)
            or point["type"].startswith("f") != self.kind.startswith("f")
            for point in learned
        )

    def has_unknown_values(self, registers: Registers) -> bool:
        """Whether a register with labels had a value that has no label."""
        return bool(self.labels) and any(
            register["min"] not in self.labels or register["max"] not in self.labels
            for register in registers.get((self.space, self.address), ())
        )


def _registers(tables: Tables, known: set[tuple[str, int]]) -> Registers:
    """Looks up what was seen of the registers of a profile, by space and address."""
    found: dict[tuple[str, int], list[Mapping[str, Any]]] = {}
    for table in tables:
        for register in table["registers"]:
            place = (table["space"], register["address"])
            if place in known:
                found.setdefault(place, []).append(register)
    return found


def _is_likely_upper(kind: str, word: int) -> bool:
    """Whether a register is the upper half of a number of a usual size, or of none (FFFF, NaN)."""
    if word in (0, 0xFFFF, 0x8000, 0x7FFF) or (kind == "f32" and word & 0x7F80 == 0x7F80):  # noqa: PLR2004
        return True
    if kind == "f32":
        return _SMALLEST <= (word >> 7) & 0xFF <= _LARGEST
    return word < _LARGE or (kind == "s32" and word >= 0x10000 - _LARGE)


def _addresses(table: Mapping[str, Any], block: Mapping[str, Any]) -> set[tuple[str, int]]:
    return {(table["space"], block["first"] + offset) for offset in range(block["count"])}


def _is_split_by_requests(point: _Point, tables: Tables) -> bool:
    """Whether requests covered parts of the point's value, and none ever the whole."""
    own = set(point.addresses)
    parts = [
        len(own & _addresses(table, block))
        for table in tables
        if table["space"] == point.space
        for block in table["blocks"]
    ]
    return any(parts) and max(parts) < point.width and point.width <= REGISTERS_OF_TYPE["f64"]
