"""A small form of `make growth`: what every command takes, as its recording grows."""

from __future__ import annotations

import sys

import pytest

from analyzer.cli import COMMANDS as NAMES
from tests.faults.growth import COMMANDS, OTHERS, grown, write_files

if sys.platform != "linux":
    pytest.skip("peaks are those of wait4(2) on Linux", allow_module_level=True)

SIZES = (200_000, 600_000, 1_800_000)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    """The same traffic at three sizes, each three times the one before."""
    folder = tmp_path_factory.mktemp("growth")
    return [write_files(folder, size) for size in SIZES]


def test_every_command_is_measured_or_has_a_reason() -> None:
    measured = {words[0] for words in COMMANDS.values()}
    assert measured | set(OTHERS) == set(NAMES)
    assert not measured & set(OTHERS)


@pytest.mark.parametrize("name", COMMANDS)
def test_memory_is_bounded_and_time_grows_in_proportion(
    name: str, files: list[dict[str, str]]
) -> None:
    """256 MiB, and no more time for each megabyte than before."""
    assert grown(name, files).wrong is None
