"""`modlens show`, `explain`, `craft`, `stats` and `formats`: what people look up."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

from analyzer import decode
from analyzer.hex_text import parse_hex
from analyzer.sources import all_formats
from dissectors.explain import known_words
from tests.conftest import CAPTURES, ROOT, Modlens, command, environment

SEED = CAPTURES / "seed_rtu" / "recording.hex"
POLLS = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
REQUEST = "01 03 00 6B 00 03 74 17"


@pytest.mark.parametrize(
    "text",
    [REQUEST, "0103006b00037417", "0x01,0x03,0x00,0x6B,0x00,0x03,0x74,0x17", "1 3 0 6b 0 3 74 17",
     r"\x01\x03\x00\x6b\x00\x03\x74\x17", "01-03-00-6B-00-03-74-17", "01:03:00:6B:00:03:74:17",
     "[01][03][00][6B][00][03][74][17]"],
)  # fmt: skip
def test_hex_is_taken_in_any_spacing(text: str, modlens: Modlens) -> None:
    """Hex digits are accepted in the spellings of other programs."""
    assert parse_hex(text) == bytes.fromhex(REQUEST)
    done = modlens("show", text)
    assert done.status == 0
    assert "request, rtu, ok" in done.out
    assert "CRC OK" in done.out


def test_a_picture_for_a_ticket_stands_between_fences(modlens: Modlens) -> None:
    """--to md prints the same between fences, which keep the columns."""
    shown = modlens("show", REQUEST).out
    assert modlens("show", REQUEST, "--to", "md").out == f"```text\n{shown}```\n"


def test_words_may_come_one_by_one(modlens: Modlens) -> None:
    """Hex digits may be separate arguments."""
    assert modlens("show", *REQUEST.split()).out == modlens("show", REQUEST).out


def test_a_wrong_checksum_is_reported(modlens: Modlens) -> None:
    """Expected and found, and the finding with what to check."""
    done = modlens("show", "01 03 00 6B 00 03 74 18")
    assert "CRC error: 0x1774 expected, 0x1874 found" in done.out
    assert "error: bad_checksum" in done.out


def test_a_checksum_of_another_frame_is_reported(modlens: Modlens) -> None:
    """A handbook's example with the checksum of the example before it (01 83 04)."""
    assert "checksum_of_another_frame" in modlens("show", "01 86 04 40 F3").out


def test_a_request_and_its_response(modlens: Modlens) -> None:
    """Pasted one after the other: the registers get their numbers."""
    done = modlens("show", "11 03 006B 0003 7687 11 03 06 022B 0000 0064 C8BA")
    assert done.status == 0
    assert "frame 2: response" in done.out
    assert "registers[2]" in done.out
    assert "400110" in done.out


def test_ascii_and_tcp_frames(modlens: Modlens) -> None:
    """ASCII and TCP frames are recognized without `--mode`."""
    assert "LRC OK" in modlens("show", ":010300000001FB").out
    done = modlens("show", "00 01 00 00 00 06 11 03 00 6B 00 03")
    assert "mbap_id" in done.out
    assert "request, tcp" in done.out


def test_a_bare_pdu(modlens: Modlens) -> None:
    """The direction is found by the layout, or given."""
    assert "request by its layout" in modlens("show", "--pdu", "03 006B 0003").out
    done = modlens("show", "--pdu", "--direction", "response", "03 06 022B 0000 0064")
    assert "6 bytes follow" in done.out


def test_a_frame_of_a_recording(modlens: Modlens) -> None:
    """A frame of a recording is shown with its findings."""
    done = modlens("show", POLLS, "--frame", "4")
    assert done.status == 0
    assert done.out.startswith("frame 4: response, rtu, bad_checksum, 2026-11-21T11:12:56.")
    assert "error: bad_checksum" in done.out


def test_a_transaction_of_a_recording(modlens: Modlens) -> None:
    """A transaction is shown as both frames with the response time between them."""
    done = modlens("show", POLLS, "--txn", "1")
    lines = done.out.splitlines()
    assert lines[0].startswith("transaction 1: rtu, ok, 2026-11-21T")
    assert "request, frame 1" in lines
    assert "response, frame 2" in lines
    assert any(line.startswith("... ") and line.endswith(" ms later") for line in lines)
    assert "registers[9]" in done.out
    assert max(map(len, lines)) <= 80


def test_a_request_without_an_answer(modlens: Modlens) -> None:
    """The missing response is reported in its place; without a clock it may have been missed."""
    done = modlens("show", SEED, "--txn", "8")
    assert "request, frame 15" in done.out
    assert "\nresponse not seen\n" in done.out
    assert "response, frame" not in done.out


@pytest.mark.parametrize(
    ("words", "title"),
    [
        (["3"], "Read Holding Registers"),
        (["exception", "2"], "Illegal Data Address"),
        (["0x83", "2"], "Illegal Data Address"),
        (["retry"], "retry"),
    ],
)
def test_words_are_explained(words: list[str], title: str, modlens: Modlens) -> None:
    """With the section of the specification, within the width."""
    done = modlens("explain", *words)
    assert done.status == 0
    assert title in done.out.splitlines()[0]
    assert "section" in done.out.splitlines()[1]
    assert max(map(len, done.out.splitlines())) <= 80


@pytest.mark.parametrize(
    ("words", "frame"),
    [
        (["read-holding-registers", "unit=1", "address=107", "quantity=3"], REQUEST),
        (["3", "--response", "unit=17", "exception=2"], "11 83 02 C1 34"),
        (["3", "address=0", "quantity=1", "--mode", "ascii"], ":010300000001FB"),
        (["3", "address=0", "quantity=1", "--mode", "pdu"], "03 00 00 00 01"),
        (["7", "mbap_id=5", "--mode", "tcp"], "00 05 00 00 00 02 01 07"),
    ],
)
def test_frames_are_crafted(words: list[str], frame: str, modlens: Modlens) -> None:
    """`craft` prints frames that `show` decodes."""
    done = modlens("craft", *words)
    assert done.out.strip() == frame
    if "pdu" not in words:
        assert modlens("show", frame).status == 0


@pytest.mark.parametrize(
    ("words", "frame", "fault"),
    [
        # Limits of the application protocol specification, sections 6.1, 6.3, 6.5, 6.12, 6.17.
        (["1", "address=0", "quantity=2000"], "01 01 00 00 07 D0 3F A6", ""),
        (["1", "address=0", "quantity=2001"], "01 01 00 00 07 D1 FE 66", "permits 1 to 2000"),
        (["3", "address=107", "quantity=125"], "01 03 00 6B 00 7D F4 37", ""),
        (["3", "address=107", "quantity=126"], "01 03 00 6B 00 7E B4 36", "permits 1 to 125"),
        (["3", "address=107", "quantity=0"], "01 03 00 6B 00 00 34 16", "permits 1 to 125"),
        (["3", "address=0", "quantity=126", "--mode", "pdu"], "03 00 00 00 7E", "1 to 125"),
        (["3", "address=0", "quantity=126", "--mode", "ascii"], ":01030000007E7E", "1 to 125"),
        (["5", "address=1", "value=on"], "01 05 00 01 FF 00 DD FA", ""),
        (["5", "address=1", "value=1"], "01 05 00 01 00 01 5D CA", "0x0000 or 0xFF00"),
        (["16", "address=1", "registers="], "01 10 00 01 00 00 00 08 AC", "permits 1 to 123"),
        (["16", "address=1", "quantity=9", "registers=1,2"],
         "01 10 00 01 00 09 04 00 01 00 02 E3 19", "a quantity of 9 takes 18"),
        (["3", "address=65535", "quantity=3"], "01 03 FF FF 00 03 05 EF", "beyond address 65535"),
        (["3", "unit=250", "address=1", "quantity=1"], "FA 03 00 01 00 01 C0 41", "reserved"),
        (["3", "unit=0", "address=1", "quantity=1"], "00 03 00 01 00 01 D4 1B", "by broadcast"),
        (["6", "unit=0", "address=1", "value=1"], "00 06 00 01 00 01 18 1B", ""),
        (["3", "unit=0", "address=0", "quantity=1", "--mode", "tcp"],
         "00 01 00 00 00 06 00 03 00 00 00 01", ""),
    ],
)  # fmt: skip
def test_what_is_not_permitted_is_crafted_and_told(
    words: list[str], frame: str, fault: str, modlens: Modlens
) -> None:
    """The frame is made all the same, for tests of devices; standard error says what is illegal."""
    done = modlens("craft", *words)
    assert done.status == 0
    assert done.out.strip() == frame
    assert fault in done.err
    assert ("not permitted" in done.err) == bool(fault)
    assert len(done.err.splitlines()) == bool(fault)


def test_crafted_bytes_can_be_decoded(modlens: Modlens) -> None:
    """`modlens craft --to raw | modlens decode -`: the ends of the program meet."""
    words = ("craft", "3", "address=107", "quantity=3", "--to", "raw")
    raw = subprocess.run(
        command(*words), env=environment(), cwd=ROOT, capture_output=True, check=True, timeout=60
    ).stdout
    assert raw == bytes.fromhex(REQUEST)
    assert "107-109" in modlens("decode", "-", "--from", "raw", stdin=raw).out


def test_exceptions_are_counted_by_code(modlens: Modlens) -> None:
    """As often as the transactions have them, the most frequent first, by unit and function."""
    recording = str(CAPTURES / "pymodbus_exceptions" / "recording.jsonl")
    done = modlens("stats", recording, "--line", "19200-8E1")
    counts = Counter(row.exception for row in decode(recording, line="19200-8E1") if row.exception)
    assert len(counts) > 5
    lines = (done.out + done.err).splitlines()
    start = lines.index("exceptions by code (modlens explain exception CODE)") + 1
    block = lines[start : lines.index("", start)]
    shown = [line.split() for line in block if line[:9].strip()]
    assert {int(words[1]): int(words[0]) for words in shown} == counts
    assert [int(words[0]) for words in shown] == sorted(counts.values(), reverse=True)
    assert shown[0][2:] == ["Illegal", "Data", "Address"]
    assert block[1].split() == "unit 1: function 1 (1), 3 (2), 6 (2), 43 (1)".split()


def test_one_is_singular(modlens: Modlens, tmp_path: Path) -> None:
    """One frame, one transaction, one line: without the s of the plural."""
    path = tmp_path / "one.hex"
    path.write_text(f"{REQUEST}\n")
    done = modlens("decode", str(path), "--where", "txn == 1")
    assert "1 frame (8 bytes): ok 1 (8)" in done.err
    assert "standard output: 1 transaction written\n" in done.err
    detected, *summary = done.err.splitlines()
    assert "hex (100 % certain" in detected
    assert not [line for line in summary if re.search(r"\b1 [a-z]+s\b", line)]


def test_statistics(modlens: Modlens) -> None:
    """`stats` has tables of buses, of units and functions, and of findings."""
    done = modlens("stats", POLLS, "--line", "19200-8E1")
    assert done.status == 0
    assert "Read Holding Registers" in done.out
    assert "bad_checksum" in done.out
    assert modlens("stats", POLLS, "--strict").status == 1


def test_formats_are_listed_with_samples(modlens: Modlens) -> None:
    """`formats` lists every format with a sample."""
    done = modlens("formats")
    assert done.status == 0
    for kind in all_formats().values():
        assert kind.name in done.out
        assert kind.sample[0] in done.out


def test_several_names_are_explained_one_after_the_other(modlens: Modlens) -> None:
    """Unless they are one name together; where one of them is unknown, nothing is explained."""
    done = modlens("explain", "retry", "bad_checksum")
    heads = [line for line in done.out.splitlines() if "(finding," in line]
    assert [head.split()[0] for head in heads] == ["retry", "bad_checksum"]
    assert modlens("explain", "no", "response").out.startswith("no_response")
    assert modlens("explain", "retry", "xyzzy").status == 2


def test_the_advice_on_an_exception_names_its_code(modlens: Modlens, tmp_path: Path) -> None:
    """A refusal by exception 2, of which `show` and `stats` say how to look it up."""
    path = tmp_path / "refused.hex"
    path.write_text("01 03 00 00 00 0A C5 CD\n01 83 02 C0 F1\n", encoding="utf-8")
    for words in (("show", path, "--txn", "1"), ("stats", path)):
        done = modlens(*words)
        assert "modlens explain exception 2." in " ".join((done.out + done.err).split())


def test_columns_are_explained(modlens: Modlens) -> None:
    """A column by its name, in each table that has it; a finding goes first."""
    done = modlens("explain", "response_time_us")
    assert done.status == 0
    assert "response_time_us (column)" in done.out
    assert "transactions: " in done.out


def test_explain_lists_its_words(modlens: Modlens) -> None:
    """`explain list` prints the names in groups, each with a line on what it is."""
    out = modlens("explain", "list").out
    for word in known_words():
        assert re.search(rf"^{re.escape(word)}( |$)", out, re.MULTILINE), word
    assert "\nfindings\n" in out
    assert re.search("^response_time_us +.*response", out, re.MULTILINE)


@pytest.mark.parametrize(
    ("word", "related"),
    [("timeout", "late_response"), ("crc", "bad_checksum"), ("retries", "retry")],
)
def test_a_word_that_is_no_name_leads_to_names(word: str, related: str, modlens: Modlens) -> None:
    done = modlens("explain", word)
    assert done.status == 2
    assert related in done.err
