"""What a program is warned of: calls that are valid, but can hardly be meant so."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import pytest
from scapy.layers.inet import IP, TCP
from scapy.layers.l2 import Ether

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
    heard = warnings_of(RECORDING, profiles=["5=mightyzap"])
    assert not [text for text in heard if "not heard" in text]
    (found,) = warnings_of(RECORDING, profiles=["8-9=mightyzap"])
    assert found == "profile mightyzap is for unit 8, 9, which was not heard; there are 5"


def test_a_profile_that_names_nothing_of_what_was_read() -> None:
    """The profile has input registers; the recording reads holding registers of unit 5."""
    (found,) = warnings_of(RECORDING, profiles=["5=carlo-gavazzi-em24"])
    assert found.startswith(
        "profile carlo-gavazzi-em24 names nothing of what was read: it has ir 0-"
    )
    assert "and unit 5 was asked for hr 0-" in found


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


REQUEST, ANSWER = "01 03 00 00 00 01 84 0A", "01 03 02 00 07 F9 86"
"""The first register of unit 1 is 7."""

MBAP = "0001 0000 0006 01 03 0000 0001"


def test_lines_that_were_not_read_are_notes_and_those_with_bytes_a_warning() -> None:
    """As the command says on standard error; a warning once, in however many passes."""
    log = f"12:00:01 Tx: {REQUEST}\n12:00:01 Rx: {ANSWER}\nrestart\n".encode()
    assert warnings_of(log) == []
    assert modlens.decode(log).notes == (
        "memory-1: 1 of 3 lines could not be parsed; line 3: restart",
    )
    recording = modlens.decode(log + b"value <<0x12, 0x34, 0x56, 0x78, 0x9a>>\n")
    with pytest.warns(modlens.ModlensWarning, match=r"2 of 4 lines could not be parsed; 1 of"):
        recording.stats()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording.doctor()
        (note,) = recording.notes
    assert "hold" in note


def test_a_capture_of_another_port_says_what_to_write(tmp_path: Path) -> None:
    """No packet of it is on port 502, so a program gets no rows, and has to hear why."""
    path = tmp_path / "other.pcap"
    head = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1)
    packet = Ether() / IP() / TCP(sport=40000, dport=1502) / bytes.fromhex(MBAP)
    data = bytes(packet)
    path.write_bytes(head + struct.pack("<IIII", 1_800_000_000, 0, len(data), len(data)) + data)
    (found,) = warnings_of(path)
    assert found.endswith('1 skipped: packets of other protocols or ports (try ports="any")')


def test_the_bytes_of_a_transaction_are_text() -> None:
    recording = modlens.decode(bytes.fromhex(REQUEST + ANSWER))
    shown = recording.show(1, width=70).splitlines()
    assert shown[0] == "transaction 1: rtu, ok"
    assert "registers[0]  7" in recording.show(frame=2)
    assert recording.show(recording.transactions[0], width=70).splitlines() == shown
    assert recording.show(recording.frames[1]) == recording.show(frame=2)
    for number, text in ((2, "there is no transaction 2"), ("1", "such as 3, not '1'")):
        with pytest.raises(modlens.UsageError, match=text):
            recording.show(number)  # type: ignore[arg-type]
    with pytest.raises(modlens.UsageError, match=r"show\(frame=5\) for a frame"):
        recording.show()


def test_what_people_look_for_is_named() -> None:
    recording = modlens.decode(bytes.fromhex(REQUEST + ANSWER))
    for name, instead in (("df", r"recording\.transactions\.to_pandas"), ("verdict", "doctor")):
        with pytest.raises(AttributeError, match=f"write .*{instead}"):
            getattr(recording, name)
    with pytest.raises(AttributeError, match=r"write modlens\.decode"):
        modlens.read  # type: ignore[attr-defined]  # noqa: B018
