"""What people who know pandas write first is refused at once, with what to write instead."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import _modlens
import modlens

decode: Any = modlens.decode
ROWS: Any = decode(bytes.fromhex("1103006B00037687 110306022B00000064C8BA")).transactions


@pytest.mark.parametrize(
    ("mistake", "instead"),
    [
        (lambda: decode("nope.hex"), "nope.hex: no such file"),
        (lambda: decode(42), "a file's name, bytes or an open file, not int"),
        (lambda: decode(b"", line=19200), '"19200-8E1"'),
        (lambda: decode(b"", profiles={1: "mightyzap"}), '["1=mightyzap"'),
        (lambda: ROWS.where(lambda row: row.unit == 1), 'where("unit == 1'),
        (lambda: ROWS["unit"], 'select("unit")'),
    ],
)
def test_a_mistake_says_what_to_write(mistake: Callable[[], Any], instead: str) -> None:
    with pytest.raises(modlens.ModlensError) as caught:
        mistake()
    assert instead in str(caught.value)


def test_errors_have_the_name_that_programs_import() -> None:
    assert modlens.UsageError.__module__ == "modlens"


def test_the_version_is_that_of_the_core() -> None:
    assert modlens.__version__ == _modlens.__version__
