"""What people who know pandas write first is refused at once, with what to write instead."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import _modlens
import modlens

decode: Any = modlens.decode
HEX = bytes.fromhex("1103006B00037687 110306022B00000064C8BA")
ROWS: Any = decode(HEX).transactions


@pytest.mark.parametrize(
    ("mistake", "instead"),
    [
        (lambda: decode("nope.hex"), "nope.hex: no such file"),
        (lambda: decode(42), "a file's name, bytes or an open file, not int"),
        (lambda: decode(b"", line=19200), '"19200-8E1"'),
        (lambda: decode(b"", profiles={1: "mightyzap"}), '["1=mightyzap"'),
        (lambda: ROWS.where(lambda row: row.unit == 1), 'where("unit == 1'),
        (lambda: ROWS["unit"], 'select("unit")'),
        (lambda: ROWS[ROWS.select("unit") == 3], 'where("unit == 3")'),
        (lambda: decode(HEX)["transactions"], "write recording.transactions"),
        (lambda: ROWS[["unit", "status"]], 'select("unit", "status")'),
        (lambda: ROWS.select(["unit", "status"]), 'select("unit", "status")'),
        (lambda: decode(b"")[0], "recording.transactions[0]"),
        (lambda: decode(b"", profiles=[1]), '["1=mightyzap"'),
        (lambda: decode(b"", timeout="500ms"), "seconds such as 0.5"),
        (lambda: decode(b"", ports=502), "[502, 1502]"),
        (lambda: decode(b"", channels="RX"), '["RX", "TX"]'),
        (lambda: decode(b"", functions="huawei"), "not a name"),
        (lambda: decode(HEX).response_times(every=3600), "'15min'"),
        (lambda: modlens.tap(3), '"/dev/ttyUSB0"'),  # type: ignore[arg-type]
    ],
)
def test_a_mistake_says_what_to_write(mistake: Callable[[], Any], instead: str) -> None:
    with pytest.raises(modlens.ModlensError) as caught:
        mistake()
    assert instead in str(caught.value)


@pytest.mark.parametrize(
    ("name", "instead"),
    [("unit", 'select("unit")'), ("groupby", "to_pandas()"), ("_repr_svg_", "no '_repr_svg_'")],
)
def test_an_attribute_of_a_frame_says_what_to_write(name: str, instead: str) -> None:
    """As an `AttributeError`, so that `hasattr` works."""
    with pytest.raises(AttributeError) as caught:
        getattr(ROWS, name)
    assert instead in str(caught.value)
    with pytest.raises(AttributeError, match=r"recording\.transactions\.to_pandas"):
        decode(b"").to_pandas()


@pytest.mark.parametrize("call", ["to_arrow", "to_polars", "to_pandas"])
def test_a_library_hides_no_error_of_ours(call: str) -> None:
    """An empty recording is reported as everywhere else."""
    with pytest.raises(modlens.SourceError, match="empty"):
        getattr(decode(b"").transactions, call)()


def test_errors_have_the_name_that_programs_import() -> None:
    assert modlens.UsageError.__module__ == "modlens"


def test_the_version_is_that_of_the_core() -> None:
    assert modlens.__version__ == _modlens.__version__
