"""The settings of a line, found by listening at it; the line is made of bits, in invented time."""

from __future__ import annotations

import random

import pytest

from analyzer.line import parse_line
from tests.support.settings_search import (
    ASCII,
    BAUDS,
    MAX_S,
    RTU,
    Chunk,
    SettingsSearch,
    polls,
    search_settings,
    traffic,
)


def cases() -> list[tuple[str, str]]:
    """Every rate with the default, every shape with some rates."""
    found = [(f"{baud}-8E1", "rtu") for baud in BAUDS]
    for baud in (1200, 9600, 19200, 115200, 921600):
        found += [(f"{baud}-{shape}", "rtu") for shape in RTU if shape != "8E1"]
    for baud in (1200, 9600, 57600):
        found += [(f"{baud}-{shape}", "ascii") for shape in ASCII]
    return found


@pytest.mark.parametrize(("settings", "mode"), cases())
def test_the_settings_are_found(settings: str, mode: str) -> None:
    """The right ones, in under ten seconds of traffic, and what they rest on is said."""
    line = parse_line(settings)
    search = SettingsSearch()
    seconds = search_settings(search, traffic(line, mode, seed=line.baud))
    assert search.found is not None
    assert (str(search.found.line), search.found.mode) == (settings, mode)
    assert "valid frame" in search.found.evidence
    assert seconds < MAX_S


@pytest.mark.parametrize(
    "settings", ["1200-7E1", "2400-7E1", "2400-7O1", "1200-7N2", "2400-7N2", "4800-8N1"]
)
def test_who_begins_to_listen_within_a_burst_waits_for_the_next(settings: str) -> None:
    """The first characters are nonsense at any settings; `make settings` tries all of them."""
    search = SettingsSearch()
    seconds = search_settings(search, traffic(parse_line(settings), "ascii", 1))
    assert search.found is not None
    assert (str(search.found.line), search.found.mode) == (settings, "ascii")
    assert seconds < MAX_S


@pytest.mark.parametrize("settings", ["9600-8E1", "9600-8O1", "19200-8N1", "38400-8N2", "1200-8E1"])
@pytest.mark.parametrize("resync", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_other_receivers_find_them_too(settings: str, resync: bool, seed: int) -> None:
    """One that waits for the line to rise after a missing stop bit; other traffic."""
    search = SettingsSearch()
    seconds = search_settings(search, traffic(parse_line(settings), "rtu", seed), resync=resync)
    assert search.found is not None
    assert str(search.found.line) == settings
    assert seconds < MAX_S


@pytest.mark.parametrize(("settings", "said"), [("9600-8E2", "9600-8E1"), ("9600-8O2", "9600-8O1")])
def test_a_second_stop_bit_behind_parity_is_received_as_silence(settings: str, said: str) -> None:
    """Characters of twelve bits: receivers look at one stop bit, and read them whole."""
    search = SettingsSearch()
    seconds = search_settings(search, traffic(parse_line(settings), "rtu", 8))
    assert search.found is not None
    assert str(search.found.line) == said
    assert seconds < MAX_S


@pytest.mark.parametrize("settings", ["9600-8E1", "9600-8O1", "19200-8N1", "19200-8N2"])
def test_marks_of_whole_packets_are_enough(settings: str) -> None:
    """As FTDI's driver gives them: 62 bytes at a time or after 16 ms, all marked or none."""
    search = SettingsSearch()
    seconds = search_settings(search, traffic(parse_line(settings), "rtu", 3), coarse=62)
    assert search.found is not None
    assert str(search.found.line) == settings
    assert seconds < MAX_S


@pytest.mark.parametrize(
    ("settings", "said"),
    [("9600-8E1", "9600-8E1"), ("9600-8O1", "9600-8E1"), ("19200-8N1", "19200-8N1")],
)
def test_without_marks_parity_stays_open_and_is_reported(settings: str, said: str) -> None:
    """The rate and the number of bits are found; frames come through."""
    search = SettingsSearch(marks_errors=False)
    seconds = search_settings(search, traffic(parse_line(settings), "rtu", 4), marks_errors=False)
    assert search.found is not None
    assert str(search.found.line) == said
    assert ("not reported by the port" in search.found.evidence) == ("E" in said)
    assert seconds < MAX_S


def test_swapped_wires_are_suspected() -> None:
    """No settings, but a word of what is wrong; a sound line at the same rate gets none."""
    said: list[str] = []
    search = SettingsSearch(said.append)
    search_settings(search, traffic(parse_line("19200-8E1"), "rtu", 5, inverted=True))
    assert search.found is None
    assert any("swapped" in line for line in said)
    for settings in ("19200-8E1", "57600-8N1", "1200-8E1"):
        said.clear()
        search_settings(SettingsSearch(said.append), traffic(parse_line(settings), "rtu", 5))
        assert not any("swapped" in line for line in said)


def test_noise_is_no_evidence() -> None:
    """Any bytes at any settings: nothing is found in two hundred thousand of them."""
    rng = random.Random(6)
    search, now = SettingsSearch(), 0
    for _ in range(4000):
        now += 20_000_000
        search.feed(0, Chunk(rng.randbytes(50), now))
    assert search.found is None


def test_what_was_received_with_the_right_settings_is_kept() -> None:
    """The frames that were the evidence are the first of the tap."""
    search = SettingsSearch()
    search_settings(search, traffic(parse_line("9600-8E1"), "rtu", 7))
    assert search.found is not None
    data = b"".join(chunk.data for _, chunk in search.found.chunks)
    requests = polls("rtu", 7)
    assert any(request in data for request, _ in (next(requests) for _ in range(40)))


@pytest.mark.parametrize("settings", ["1200-8O1", "9600-8N1"])
def test_no_read_is_kept_twice(settings: str) -> None:
    """Silences while the character format is searched add nothing to what was read."""
    search = SettingsSearch()
    search_settings(search, traffic(parse_line(settings), "rtu", 7))
    assert search.found is not None
    times = [chunk.time_ns for _, chunk in search.found.chunks]
    assert times == sorted(set(times))
