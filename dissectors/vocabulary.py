"""The names of numbers in a PDU, and the documented findings, as the core has read them.

The names are in vocabulary.toml, the findings in the core itself.

>>> exception_name(2)
'Illegal Data Address'
>>> diagnostic(11).name
'Return Bus Message Count'
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from dissectors.texts import respelled, vocabulary

__all__ = [
    "Finding",
    "Kind",
    "Name",
    "diagnoses",
    "diagnosis",
    "diagnostic",
    "exception",
    "exception_name",
    "finding",
    "findings",
    "mei_type",
    "names",
    "statuses",
    "vendors",
    "verdicts",
]


@dataclass(frozen=True, slots=True)
class Name:
    """A number inside a PDU that has a name: an exception, a sub-function, an object id.

    `last` is the end of a range of numbers (equal to `code` for most); `check` is advice, on
    exceptions only.
    """

    code: int
    last: int
    name: str
    section: str
    meaning: str
    check: str = ""
    category: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """A documented finding: what was seen, why it matters, what to check."""

    code: str
    severity: str
    title: str
    why: str
    advice: str
    section: str


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """A kind of trouble that `modlens doctor` recognizes (dissectors/diagnoses.toml).

    `confusions` has the codes that it may be taken for, with what distinguishes the two; `findings`
    are those that it brings forth.
    """

    code: str
    severity: str
    title: str
    contrast: str
    absent: str
    advice: str
    proof: str
    needs: str
    confusions: tuple[tuple[str, str], ...]
    findings: tuple[str, ...]


Kind = Literal[
    "exceptions",
    "diagnostics",
    "mei_types",
    "object_ids",
    "read_device_id_codes",
    "conformity_levels",
]


def exception(code: int) -> Name | None:
    """The exception code's entry, or None where the specification has none.

    >>> exception(11).name
    'Gateway Target Device Failed to Respond'
    """
    return _lookup("exceptions", code)


def exception_name(code: int) -> str:
    """The exception code's name, or "Exception 9" where the specification has none.

    >>> exception_name(9)
    'Exception 9'
    """
    entry = exception(code)
    return f"Exception {code}" if entry is None else entry.name


def diagnostic(sub_function: int) -> Name | None:
    """The entry of a sub-function of Diagnostics (function 8).

    >>> diagnostic(11).name
    'Return Bus Message Count'
    """
    return _lookup("diagnostics", sub_function)


def mei_type(code: int) -> Name | None:
    """The entry of an MEI type of function 43.

    >>> mei_type(14).section
    '6.21'
    """
    return _lookup("mei_types", code)


def names(kind: Kind) -> tuple[Name, ...]:
    """All entries of one part of the vocabulary, sorted by number.

    >>> [entry.code for entry in names("mei_types")]
    [13, 14]
    """
    return _names(kind)


@functools.cache
def findings() -> tuple[Finding, ...]:
    """The findings that the core can report."""
    keys = Finding.__slots__
    rows = vocabulary("findings")
    return tuple(Finding(**{key: str(row.get(key) or "") for key in keys}) for row in rows)


def finding(code: str) -> Finding | None:
    """The finding with this code, which may have its former spelling."""
    wanted = respelled("finding", code)
    return next((item for item in findings() if item.code == wanted), None)


@functools.cache
def diagnoses() -> tuple[Diagnosis, ...]:
    """The kinds of trouble that the doctor recognizes.

    >>> diagnoses()[0].code
    'slow_answers'
    """
    keys = [key for key in Diagnosis.__slots__ if key not in ("confusions", "findings")]
    return tuple(
        Diagnosis(
            **{key: str(row[key]) for key in keys},
            confusions=tuple((one["code"], one["difference"]) for one in row["confusions"]),
            findings=tuple(row["findings"]),
        )
        for row in vocabulary("diagnoses")
    )


def diagnosis(code: str) -> Diagnosis | None:
    """The kind of trouble with this code."""
    return next((item for item in diagnoses() if item.code == code), None)


@functools.cache
def statuses() -> Mapping[str, str]:
    """What each value of the column `status` means.

    >>> statuses()["bad_request"]
    'the request was damaged on the line'
    """
    return {row["code"]: row["meaning"] for row in vocabulary("statuses")}


@functools.cache
def verdicts() -> Mapping[str, str]:
    """What each value of the column `verdict` means."""
    return {row["code"]: row["meaning"] for row in vocabulary("verdicts")}


def vendors() -> tuple[str, ...]:
    """The vendors whose rows the core embeds.

    >>> "huawei" in vendors()
    True
    """
    return tuple(vocabulary("vendors"))


@functools.cache
def _names(kind: Kind) -> tuple[Name, ...]:
    entries = (_name(row) for row in vocabulary(kind))
    return tuple(sorted(entries, key=lambda entry: entry.code))


def _lookup(kind: Kind, code: int) -> Name | None:
    return next((entry for entry in _names(kind) if entry.code <= code <= entry.last), None)


def _name(row: Mapping[str, Any]) -> Name:
    code = next(row[key] for key in ("code", "sub_function", "id") if key in row)
    return Name(
        code=code,
        last=row.get("last") or code,
        name=row["name"],
        section=row["section"],
        meaning=row["meaning"],
        check=row.get("check") or "",
        category=row.get("category") or "",
    )
