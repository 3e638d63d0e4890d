"""What a program is warned of: calls that are valid, but can hardly be meant so."""

from __future__ import annotations

import warnings
from typing import Any

import pytest

import modlens
from tests.conftest import CAPTURES

TYPES = CAPTURES / "pymodbus_types"
RECORDING = TYPES / "recording.jsonl"


def warnings_of(recordings: Any, **options: Any) -> list[str]:
    """The warnings of a whole pass, all at the line of the caller."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        for _ in modlens.decode(recordings, **options).transactions:
            pass
    assert all(one.filename == __file__ for one in found)
    return [str(one.message) for one in found]


def test_a_file_named_twice_is_read_once() -> None:
    with pytest.warns(UserWarning, match="named twice, read once"):
        assert (
            len(modlens.decode([str(RECORDING), f"{TYPES}/./recording.jsonl"]).transactions) == 140
        )


def test_a_profile_of_a_unit_that_was_not_heard() -> None:
    assert warnings_of(RECORDING, profiles=["5=mightyzap"]) == []
    (found,) = warnings_of(RECORDING, profiles=["8-9=mightyzap"])
    assert found == "profile mightyzap is for unit 8, 9, which was not heard; there are 5"


def test_a_folder_with_one_traffic_twice() -> None:
    """Its frames as text lie beside the recording."""
    (found,) = warnings_of(TYPES)
    assert "perhaps one traffic, counted twice" in found
    assert warnings_of([RECORDING, CAPTURES / "pymodbus_plant" / "recording.jsonl"]) == []


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"baud": 9600, "parity": "even"}, "decode has no 'baud'; write line=\"9600-8E1\""),
        ({"bytesize": 7}, "decode has no 'bytesize'; write line=\"19200-7N1\""),
        ({"profile": "a"}, "decode has no 'profile'; write profiles="),
        ({"slave": 3}, "decode has no 'slave'; write .where("),
        ({"timezones": "UTC"}, "decode has no 'timezones'; did you mean 'timezone'?"),
    ],
)
def test_a_keyword_of_other_programs(given: dict[str, Any], message: str) -> None:
    with pytest.raises(modlens.UsageError) as raised:
        modlens.decode(RECORDING, **given)
    assert str(raised.value).startswith(message)


def test_a_tap_has_the_same_settings() -> None:
    with pytest.raises(modlens.UsageError, match="tap has no 'baudrate'; write line=\"19200-8N1\""):
        modlens.tap("/dev/null", baudrate=19200)  # type: ignore[arg-type]
