"""What the page says to who has nothing else: no command, unless it is said to be one."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT
from tests.support.browser import Browser
from tests.support.page import TROUBLE, show

COMMAND = re.compile(
    r"modlens (?:decode|doctor|explain|find|formats|learn|map|report|show|stats|tap)\b"
    r"|(?<![-\w])--[a-z]+"
)
"""A command, or an option of one."""

SAID_TO_BE_ONE = re.compile(r"(with the command line, |by the command )[^.;]*")


def commands_in(text: str) -> list[str]:
    """The commands and options that a text names, but for those said to be of the command line."""
    return COMMAND.findall(SAID_TO_BE_ONE.sub("", text))


def advice_in(value: Any) -> Iterator[str]:
    """The texts below the keys for what to check and what would prove it."""
    if isinstance(value, list):
        for one in value:
            yield from advice_in(one)
    elif isinstance(value, dict):
        yield from (value[key] for key in ("advice", "proof", "sentence") if key in value)
        for one in value.values():
            yield from advice_in(one)


def test_advice_names_what_can_be_done_here(opened: Browser) -> None:
    """Of every finding and every diagnosis, and the help of every column."""
    rows = tomllib.loads((ROOT / "dissectors/diagnoses.toml").read_text("utf-8"))["diagnosis"]
    texts = list(advice_in(rows))
    found = opened.ask(
        "Promise.resolve([...Object.values(Core.words.findings)"
        ".flatMap((it) => [it.why, it.advice]),"
        " ...Object.values(Core.words.columns).flat().map(({ help }) => help),"
        " ...arguments[0]].map((it) => Here.text(it)))",
        texts,
    )
    assert len(found) > len(texts)
    assert [text for text in found if commands_in(text)] == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Dear colleagues,\nthe meeting is at noon.\n", "if it is Modbus, name its format"),
        ("what is it? 11 22 33 44 55 66 77 88\n", "if it is Modbus, name its format"),
    ],
)
def test_refusals_name_what_can_be_done_here(
    text: str, said: str, opened: Browser, tmp_path: Path
) -> None:
    path = tmp_path / "letter.txt"
    path.write_text(text)
    show(opened, path, "refused")
    trouble = opened.run(TROUBLE)
    assert said in trouble
    assert commands_in(trouble) == []
