"""An example of each finding, to be put between ten plain exchanges; see `test_ordinary_traffic`.

A new finding needs a line here. Messages are those of `tests.support.ordinary_traffic`; the master
asks units 0x11 and 2.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from tests.support.ordinary_traffic import RECORDINGS, framed

__all__ = ["EXAMPLES", "NOT_BETWEEN_EXCHANGES", "Example"]

EVERYWHERE = tuple(RECORDINGS)
SERIAL = ("raw", "log")
WITHOUT_IDENTIFIER = ("raw", "ascii", "log")
TIMED = ("log", "capture")

ASK, ANSWER = "> 11 03 00 6B 00 02", "< 11 03 04 02 2B 00 64"
ASK_OTHER, ANSWER_OTHER = "> 02 04 00 07 00 01", "< 02 04 02 43 21"
ASK_WIRE, WIRE = (framed(bytes.fromhex(message[2:])).hex(" ") for message in (ASK, ANSWER))
"""Both with their checksums."""
WIRE_WITH_XOFF = framed(bytes.fromhex("11 03 04 02 13 00 64")).hex(" ")
UNKNOWN_WIRE = framed(bytes.fromhex("63 2B 0E 01 00")).hex(" ")
OTHER_WIRE = framed(bytes.fromhex("05 03 02 00 07")).hex(" ")

PROFILE = """
profile = 1
[device]
functions = [1, 3, 5, 6]
[[registers]]
at = "hr:0x200"
name = "voltage"
type = "f32"
unit = "V"
"""


@dataclass(frozen=True, slots=True)
class Example:
    """Messages that show a finding, and the recordings in which they do."""

    messages: tuple[str, ...]
    recordings: tuple[str, ...] = EVERYWHERE
    profile: str | None = None


def _exchanges_with_unit_5(response: str) -> tuple[str, ...]:
    return ("> 05 03 00 00 00 01", response) * 30


def _floats() -> tuple[str, ...]:
    """Voltages whose second register comes first."""
    answers = (struct.pack(">f", 230.1 + turn / 7) for turn in range(30))
    return tuple(
        message
        for answer in answers
        for message in ("> 11 03 02 00 00 02", f"< 11 03 04 {(answer[2:] + answer[:2]).hex(' ')}")
    )


EXAMPLES = {
    # The bytes of one frame. What TCP delivers is not damaged.
    "bad_checksum": Example((ASK, f"<! 11 03 04 7F 2B 81{WIRE[17:]}"), SERIAL),
    "incomplete": Example((ASK, f"<! {WIRE[:14]}"), SERIAL),
    "bit_flip": Example((ASK, f"<! 11 03 04 02 2A{WIRE[14:]}"), SERIAL),
    "lost_bytes": Example((ASK, f"<! {WIRE[3:]}"), SERIAL),
    "flow_control": Example((ASK, f"<! {WIRE_WITH_XOFF.replace(' 13', '')}"), SERIAL),
    "duplicate_byte": Example((f">! 11 03 00 6B {ASK_WIRE[9:]}", ANSWER), SERIAL),
    "collision": Example((">! 11 03 00 02 00 00 35 42", ANSWER), SERIAL),
    "stray_bytes": Example((ASK, f"<! FF FF {WIRE}"), SERIAL),
    "checksum_of_another_frame": Example((ASK, f"<! 12{WIRE[2:]}"), SERIAL),
    "lower_case_hex": Example((f"<! {b':110300030002e7'.hex()} 0D 0A",), ("ascii",)),
    "bare_line_feed": Example((f"<! {b':110300030002E7'.hex()} 0A",), ("ascii",)),
    "mbap_length": Example(("<! 00 63 00 00 00 03 11 03 04 02 2B 00 64",), ("capture",)),
    "line_error": Example((ASK, "<x 11 03 04 02 2B 00 64"), ("tap",)),
    # The content of one frame.
    "length_mismatch": Example(("> 11 10 00 01 00 02 02 00 0A", "< 11 90 03")),
    "quantity_limit": Example(("> 11 03 00 6B 00 7E", "< 11 83 03")),
    "reserved_unit": Example(("> F8 03 00 6B 00 01", "< F8 03 02 00 05"), WITHOUT_IDENTIFIER),
    "unknown_function": Example(("> 11 64 00 01", "< 11 64 00 01")),
    # A request and its response.
    "exception": Example((ASK, "< 11 83 02")),
    "echo_mismatch": Example(("> 11 06 00 01 00 03", "< 11 06 00 01 00 04")),
    "response_length": Example((ASK, "< 11 03 02 02 2B")),
    "padding_bits": Example(("> 11 01 00 13 00 0A", "< 11 01 02 CD FB")),
    "wrong_function": Example((ASK, "< 11 04 04 02 2B 00 64")),
    "wrong_unit": Example((ASK, "< 02 03 04 02 2B 00 64", "wait 1500", ASK, ANSWER), TIMED),
    "transaction_id_mismatch": Example((ASK, f"<~{ANSWER[1:]}"), ("capture",)),
    # The order of frames.
    "no_response": Example((ASK, "wait 1500"), TIMED),
    "retry": Example((ASK, "wait 1500", ASK, ANSWER), TIMED),
    "late_response": Example(
        (ASK, "wait 40000", ASK_OTHER, f"<^{ANSWER[1:]}", ANSWER_OTHER), TIMED
    ),
    "unsolicited": Example(("wait 3000", "< 02 03 06 00 01 00 02 00 03")),
    "duplicate_response": Example((ASK, ANSWER, ANSWER)),
    "conflicting_response": Example((ASK, ANSWER, "< 11 03 04 02 2B 00 65"), ("capture",)),
    "broadcast_read": Example(("> 00 03 00 6B 00 02",), WITHOUT_IDENTIFIER),
    "local_echo": Example((ASK, "wait -9", f"<{ASK[1:]}", ANSWER) * 6, ("log",)),
    "two_masters": Example(
        (
            *(ASK, "wait -22", ASK_OTHER, ANSWER, ANSWER_OTHER),
            *(ASK_OTHER, "wait -22", ASK, ANSWER, ANSWER_OTHER),
        ),
        ("log",),
    ),
    "unconfirmed": Example((f"<! 9A 33 7C 5D {UNKNOWN_WIRE} 77 C3 19 E8 5A",), SERIAL),
    # All responses of a unit.
    "swapped_checksum": Example(
        _exchanges_with_unit_5(f"<! {OTHER_WIRE[:14]}{OTHER_WIRE[17:]}{OTHER_WIRE[14:17]}"), SERIAL
    ),
    "missing_checksum": Example(_exchanges_with_unit_5("<! 05 03 02 00 07"), SERIAL),
    "padded_responses": Example(_exchanges_with_unit_5(f"<! {OTHER_WIRE} 00 00"), SERIAL),
    "answers_as_other_unit": Example(_exchanges_with_unit_5("< 06 03 02 00 07"), SERIAL),
    # Silences, and the clock.
    "short_silence": Example((ASK, "wait -5", ANSWER), ("tap",)),
    "gap_in_frame": Example((ASK, "<_ 11 03 04 02 2B 00 64"), ("tap",)),
    "clock_jumped": Example(("wait -5000", ASK, ANSWER), ("log",)),
    # The profile of unit 0x11.
    "order_mismatch": Example(_floats(), profile=PROFILE),
    "unsupported_function": Example(("> 11 04 00 00 00 01", "< 11 84 01"), profile=PROFILE),
    # Packets.
    "missing_segment": Example((ASK, "lost 11 03 04 02 2B 00 64"), ("capture",)),
    "tcp_retransmission": Example((ASK, ANSWER, "again"), ("capture",)),
    "conflicting_segment": Example((ASK, ANSWER, "changed"), ("capture",)),
    "duplicate_packet": Example((ASK, "twice", ANSWER), ("capture",)),
    "connection_closed": Example((ASK, "reset"), ("capture",)),
}

NOT_BETWEEN_EXCHANGES = {
    "one_side_only": "the recording has requests alone, or responses alone",
    "no_valid_frame": "no frame of the recording is valid",
    "faster_than_line": "most frames of the recording come faster than its line settings permit",
    "overfull_line": "all bytes of the recording take longer than it lasts",
    "errors_on_valid_frames": "the receiver marks nearly all frames of the recording",
}
