"""Explains functions, exceptions, sub-functions and findings.

With the section that specifies it, and an example taken apart.

>>> found = explain("ex2")
>>> found.title
'Illegal Data Address (exception 2)'
>>> explain("fc3").section
'Modbus Application Protocol V1.1b3, section 6.3'
>>> explain("Read Coil")
Traceback (most recent call last):
...
modlens.UsageError: no such code or name: 'Read Coil'; did you mean 'Read Coils'?
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import _modlens
from dissectors import vocabulary
from dissectors.craft import craft_pdu
from dissectors.describe import describe
from dissectors.errors import UsageError
from dissectors.function_lookup import (
    FunctionChoice,
    function_names,
    normalized,
    parse_code,
    parse_number,
    similar_name,
)
from dissectors.table import (
    DIRECTIONS,
    EXCEPTION_BIT,
    Direction,
    Field,
    Function,
    function,
    functions,
)
from dissectors.texts import respelled

__all__ = ["Explanation", "explain", "known_words"]

ENCAPSULATED = 0x2B
DIAGNOSTICS = 0x08
EXCEPTION_RESPONSE_CODES = range(EXCEPTION_BIT, 0x100)

_EXCEPTION = re.compile(r"(?:ex|exc|exception)\s*(?:code)?\s*(0x[0-9a-f]+|\d+)")
# Without 0x the first digit has to be 8 or 9, because `fc 99` is a function.
_EXCEPTION_RESPONSE = re.compile(
    r"(?:0x(?=[89a-f])|(?=[89]))([0-9a-f]{2})h?[\s/:]+(0x[0-9a-f]+|\d+)"
)
_SUB = re.compile(
    r"(?:fc|function|diagnostics?|sub-?function)?\s*(0x[0-9a-f]+|\d+)[\s/.:]+(0x[0-9a-f]+|\d+)"
)
_BARE_SUB = re.compile(r"(?:diagnostics?|sub-?function)\s*(0x[0-9a-f]+|\d+)")

_FIELD_TYPE_TEXTS = {
    "u8": "1 byte",
    "u16": "2 bytes",
    "len8": "1 byte: how many bytes follow",
    "len16": "2 bytes: how many bytes follow",
    "count8": "1 byte: how many items follow",
    "count16": "2 bytes: how many items follow",
    "bits": "lowest bit of the first byte first",
    "u8[]": "1 byte each",
    "u16[]": "2 bytes each",
    "bytes": "text or binary",
}
"""Field types of the table (see functions.toml) in words."""

Kind = Literal[
    "function",
    "exception",
    "diagnostic",
    "mei_type",
    "object_id",
    "finding",
    "diagnosis",
    "status",
    "verdict",
    "column",
]


@dataclass(frozen=True, slots=True)
class Explanation:
    """An explanation: title, section of the specification, paragraphs, lines of an example.

    Section and example may be empty.
    """

    kind: Kind
    title: str
    section: str
    text: tuple[str, ...]
    example: tuple[str, ...] = ()

    def __str__(self) -> str:
        head = self.title if not self.section else f"{self.title}\n{self.section}"
        parts = [head, *self.text]
        if self.example:
            parts.append("\n".join(("Example", *(f"  {line}" for line in self.example))))
        return "\n\n".join(parts)


def explain(word: str, *, source: _modlens.Functions | None = None) -> Explanation:
    """Explain a word; `UsageError` suggests a similar known word.

    A function: `3`, `0x03`, `fc3`, `Read Holding Registers`. An exception: `exception 2`, `ex2`,
    `0x83 2` or its name. A sub-function of Diagnostics: `8/11`, `diagnostics 11` or its name. An
    MEI type: `43/14` or its name. An object of Read Device Identification: its name. A finding: its
    code. A status or a verdict: its word. Former spellings of the last three are known as well.
    """
    text = " ".join(word.split()).casefold()
    for reading in (_as_exception, _as_pair, _as_function):
        found = reading(text, source)
        if found is not None:
            return found
    named = _named(source).get(normalized(text))
    if named is not None:
        return _explanation(named, source)
    state = _as_state(text)
    if state is not None:
        return state
    # Among some hundred names, what is less similar is far-fetched: `tables` is no `stray_bytes`.
    hint = similar_name(word, known_words(source=source), least=0.7)
    end = "try 3, 'exception 2' or bad_checksum; modlens explain list prints all names"
    if hint is not None:
        end = f"did you mean {hint!r}?"
    if text in ("filter", "filters", "where", "--where"):
        end = "a filter is --where 'unit == 3'; modlens explain list prints its columns and words"
    raise UsageError(f"no such code or name: {word!r}; {end}")


def known_words(*, source: _modlens.Functions | None = None) -> tuple[str, ...]:
    """All names that `explain` knows, functions first.

    >>> known_words()[:2]
    ('Read Coils', 'Read Discrete Inputs')
    """
    found = [row.name for row in functions(source)]
    found += [row.label for row in functions(source)]
    for kind in ("exceptions", "diagnostics", "mei_types", "object_ids"):
        found += [entry.name for entry in vocabulary.names(kind)]
    found += [finding.code for finding in vocabulary.findings()]
    found += [diagnosis.code for diagnosis in vocabulary.diagnoses()]
    found += [*vocabulary.statuses(), *vocabulary.verdicts()]
    return tuple(dict.fromkeys(found))


Named = FunctionChoice | vocabulary.Name | vocabulary.Finding


def _named(source: _modlens.Functions | None) -> dict[str, Named]:
    """Normalized name -> entry; later entries win, but a finding never hides a function."""
    found: dict[str, Named] = {}
    for kind in ("object_ids", "exceptions"):
        found.update({normalized(entry.name): entry for entry in vocabulary.names(kind)})
    found.update(
        {normalized(name): choice for name, choice in function_names(source=source).items()}
    )
    for finding in vocabulary.findings():
        found.setdefault(normalized(finding.code), finding)
    return found


def _as_state(text: str) -> Explanation | None:
    """A finding in its former spelling, the status of a transaction, or the verdict on a frame."""
    word = text.replace(" ", "_").replace("-", "_")
    finding = vocabulary.finding(word)
    if finding is not None:
        return _finding(finding)
    diagnosis = vocabulary.diagnosis(word)
    if diagnosis is not None:
        title = f"{diagnosis.code} (diagnosis, severity up to {diagnosis.severity})"
        return Explanation("diagnosis", title, "", _diagnosis(diagnosis))
    status = respelled("status", word)
    if status in vocabulary.statuses():
        meaning = _sentence(vocabulary.statuses()[status])
        how = (_DAMAGE,) if status == "bad_response" else ()
        return Explanation("status", f"{status} (status of a transaction)", "", (meaning, *how))
    if word in vocabulary.verdicts():
        meaning = _sentence(vocabulary.verdicts()[word])
        return Explanation("verdict", f"{word} (verdict of a frame)", "", (meaning,))
    return None


_DAMAGE = (
    "The findings of its response say how: bad_checksum, incomplete, response_length and others."
)


def _explanation(named: Named, source: _modlens.Functions | None) -> Explanation:
    """The explanation of a name's entry."""
    if isinstance(named, vocabulary.Finding):
        return _finding(named)
    if isinstance(named, vocabulary.Name):
        known = vocabulary.exception(named.code)
        if known == named:
            return _exception(named.code, None)
        return _object(named)
    value = next(iter(named.preset.values()), None)
    if value is None:
        return _function(named.code, source)
    return _sub_function(named.code, value, source)


def _as_exception(text: str, source: _modlens.Functions | None) -> Explanation | None:
    alone = _EXCEPTION.fullmatch(text)
    if alone is not None:
        return _exception(parse_number(alone[1]) or 0, None)
    response = _EXCEPTION_RESPONSE.fullmatch(text)
    if response is None:
        return None
    return _exception(parse_number(response[2]) or 0, int(response[1], 16) & ~EXCEPTION_BIT)


def _as_pair(text: str, source: _modlens.Functions | None) -> Explanation | None:
    bare = _BARE_SUB.fullmatch(text)
    if bare is not None:
        return _sub_function(DIAGNOSTICS, parse_number(bare[1]) or 0, source)
    pair = _SUB.fullmatch(text)
    if pair is None:
        return None
    return _sub_function(parse_number(pair[1]) or 0, parse_number(pair[2]) or 0, source)


def _as_function(text: str, source: _modlens.Functions | None) -> Explanation | None:
    code = parse_code(text)
    if code is None:
        return None
    if code in EXCEPTION_RESPONSE_CODES:
        # 0x83 is the code of function 3 in an exception response.
        return _function(code & ~EXCEPTION_BIT, source)
    found, other = _function(code, source), vocabulary.exception(code)
    if other is None or not text[0].isdigit():
        return found
    # A bare number may be either.
    see = f"Exception code {code} is {other.name}: modlens explain exception {code}"
    return replace(found, text=(*found.text, see))


def _function(code: int, source: _modlens.Functions | None) -> Explanation:
    """The explanation of a function code; `UsageError` if the table has none."""
    rows = [row for row in functions(source) if row.code == code]
    if not rows:
        known = ", ".join(str(code) for code in sorted({row.code for row in functions(source)}))
        raise UsageError(f"function {code} is not known; choose from {known}")
    row = next((row for row in rows if row.when is None), rows[0])
    text = [_sentence(row.summary), *_layout(row)]
    chosen = [f"{value} {name}" for value, name in _values(code, source).items()]
    if chosen:
        text.append(f"Sub-functions: {'; '.join(chosen)}.")
    title = f"{row.name} (function {code}, 0x{code:02X})"
    section = _section_text(row.section)
    return Explanation("function", title, section, tuple(text), _example(row, source))


def _sub_function(code: int, value: int, source: _modlens.Functions | None) -> Explanation:
    """The explanation of a function for one value of its leading field."""
    try:
        row = function(code, when=value, source=source)
    except KeyError:
        return _function(code, source)
    look_up = {DIAGNOSTICS: vocabulary.diagnostic, ENCAPSULATED: vocabulary.mei_type}.get(code)
    entry = None if look_up is None else look_up(value)
    if entry is None:
        return _unnamed_value(row, value, source)
    text = (_sentence(entry.meaning), *_layout(row))
    section = _section_text(entry.section)
    if code == ENCAPSULATED:
        title = f"{entry.name} (function {code}, MEI type {value})"
        return Explanation("mei_type", title, section, text, _example(row, source))
    title = f"{entry.name} (function {code}, sub-function {value})"
    example = (
        _example(row, source) if row.when else _described_pdu(_query(value), "request", source)
    )
    return Explanation("diagnostic", title, section, text, tuple(example))


def _unnamed_value(row: Function, value: int, source: _modlens.Functions | None) -> Explanation:
    """The explanation of a leading field's value that only the table may know."""
    if row.when is None:
        known = ", ".join(str(code) for code in _values(row.code, source))
        end = f"choose from {known}" if known else "it has none"
        raise UsageError(f"{row.name} has no sub-function {value} in the table; {end}")
    title = f"{row.label} ({row.name}, {row.when[0]} {value})"
    text = (_sentence(row.summary), *_layout(row))
    return Explanation("function", title, _section_text(row.section), text, _example(row, source))


def _values(code: int, source: _modlens.Functions | None) -> dict[int, str]:
    """The values of a function's leading field -> their names, sorted."""
    found = {row.when[1]: row.label for row in functions(source) if row.code == code and row.when}
    if code == DIAGNOSTICS:
        found |= {entry.code: entry.name for entry in vocabulary.names("diagnostics")}
    return dict(sorted(found.items()))


def _query(sub_function: int) -> bytes:
    return craft_pdu(DIAGNOSTICS, values={"sub_function": sub_function, "data": 0})


def _exception(code: int, function_code: int | None) -> Explanation:
    """The explanation of an exception code, with the response to `function_code` as example.

    Read Holding Registers is the example where no function is given.
    """
    entry = vocabulary.exception(code)
    pdu = bytes([(function_code or 0x03) | EXCEPTION_BIT, code & 0xFF])
    example = tuple(_described_pdu(pdu, "response", None))
    if entry is None:
        unknown = "The specification has no such code: the vendor's manual may explain it."
        return Explanation(
            "exception", f"Exception {code}", _section_text("7"), (unknown,), example
        )
    text = (_sentence(entry.meaning), f"Check: {entry.check}")
    title = f"{entry.name} (exception {code})"
    return Explanation("exception", title, _section_text(entry.section), text, example)


def _object(entry: vocabulary.Name) -> Explanation:
    span = f"0x{entry.code:02X}"
    if entry.last != entry.code:
        span = f"{span} to 0x{entry.last:02X}"
    title = f"{entry.name} (object {span} of Read Device Identification)"
    text = (_sentence(entry.meaning), f"Category: {entry.category}.")
    return Explanation("object_id", title, _section_text(entry.section), text)


def _finding(entry: vocabulary.Finding) -> Explanation:
    title = f"{entry.code} (finding, {entry.severity})"
    text = [_sentence(entry.title), entry.why, f"Check: {entry.advice}"]
    status = vocabulary.statuses().get(entry.code)
    if status is not None:
        text.append(f"As the status of a transaction: {status}.")
    diagnosis = vocabulary.diagnosis(entry.code)
    if diagnosis is not None:
        text += [f"As a diagnosis of modlens doctor (severity up to {diagnosis.severity}):"]
        text += _diagnosis(diagnosis)
    return Explanation("finding", title, _section_text(entry.section), tuple(text))


def _diagnosis(entry: vocabulary.Diagnosis) -> tuple[str, ...]:
    """What shows a kind of trouble, what it may be taken for, and what to do."""
    confusions = [
        f"Not to be confused with {code}: {difference}." for code, difference in entry.confusions
    ]
    page = [f"With an example: docs/doctor/{entry.code}.md"] if entry.code in _WITH_PAGE else []
    return (
        _sentence(entry.title),
        f"Shown by: {entry.contrast}",
        f"Absent: {entry.absent}",
        *confusions,
        f"Needs: {entry.needs}.",
        *page,
    )


_WITH_PAGE = frozenset(
    {
        "address_off_by_one",
        "connection_limit",
        "line_noise",
        "lockstep",
        "no_bias",
        "polled_too_fast",
        "slow_answers",
        "swapped_wires",
        "two_masters",
        "word_order",
    }
)
"""The most common kinds of trouble have a page of their own in the documents."""


def _layout(row: Function) -> Iterator[str]:
    """The fields of both directions, in sentences."""
    lines = []
    for direction in DIRECTIONS:
        if direction == "response" and not row.has_response:
            lines.append("There is no response.")
        elif not row.has_layout(direction):
            lines.append(f"The layout of the {direction} is not public.")
        else:
            fields = ", ".join(map(_field, row.fields(direction)))
            body = fields or "nothing but the function code"
            lines.append(f"{direction.capitalize()}: {body}.")
    yield "\n".join(lines)
    permitted = [f"{name} {low} to {high}" for name, (low, high) in row.limits.items()]
    permitted += [f"{name} {_either(values)}" for name, values in row.allowed.items()]
    notes = [f"Permitted: {', '.join(permitted)}."] if permitted else []
    if row.echo:
        notes.append(f"The response repeats {', '.join(row.echo)}.")
    if row.serial_only:
        notes.append("Serial line only.")
    if notes:
        yield " ".join(notes)


def _field(field: Field) -> str:
    if field.field_type == "group":
        return f"{field.name} (groups of {', '.join(map(_field, field.children))})"
    return f"{field.name} ({_FIELD_TYPE_TEXTS[field.field_type]})"


def _example(row: Function, source: _modlens.Functions | None) -> tuple[str, ...]:
    lines = list(_described_pdu(row.example_request, "request", source))
    if row.example_response is not None:
        asked = row.example_request
        lines += ["", *_described_pdu(row.example_response, "response", source, request=asked)]
    return tuple(lines)


def _described_pdu(
    pdu: bytes,
    direction: Direction,
    source: _modlens.Functions | None,
    *,
    request: bytes | None = None,
) -> Iterable[str]:
    """The lines of an example: the bytes of a PDU, then each field with its meaning."""
    pieces = describe(pdu, mode="pdu", direction=direction, request=request, functions=source)
    yield f"{direction} {pdu.hex(' ')}"
    for piece in pieces:
        words = piece.meaning or piece.value
        yield f"  {piece.name}: {words}"


def _section_text(section: str) -> str:
    """A section with its document; plain numbers are sections of the application protocol."""
    if section in ("", "vendor"):
        return "" if not section else "not in the specification; defined by the vendor"
    for prefix, document in (
        ("serial line ", "Modbus over Serial Line V1.02"),
        ("messaging on TCP/IP ", "Modbus Messaging on TCP/IP V1.0b"),
    ):
        if section.startswith(prefix):
            return f"{document}, section {section.removeprefix(prefix)}"
    kind = "" if section.startswith("Annex") else "section "
    return f"Modbus Application Protocol V1.1b3, {kind}{section}"


def _either(values: Iterable[int]) -> str:
    return " or ".join(f"0x{value:02X}" for value in values)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."
