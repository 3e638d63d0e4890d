"""Which format a recording has."""

from __future__ import annotations

import pytest

from _modlens import Dialects, is_text
from analyzer.sources import BINARY, all_formats
from analyzer.sources.detect import detect_format

REQUEST, RESPONSE = "0103006b00037417", "010306022b0000006405 7a".replace(" ", "")

SAMPLES = {
    "raw": bytes.fromhex(REQUEST + RESPONSE) * 4,
    "hex": f"{REQUEST}\n{RESPONSE}\n".encode() * 4,
}


@pytest.mark.parametrize("name", SAMPLES)
def test_each_format_is_found_by_its_content(name: str) -> None:
    """Each format is detected by its content, whatever the file's name is."""
    found = detect_format(SAMPLES[name], "recording")
    assert (found.format, found.forced) == (name, False)
    assert 0 < found.confidence <= 1
    assert found.reason


@pytest.mark.parametrize(
    "text",
    [
        f"{REQUEST}\n",
        "01 03 00 6B 00 03 74 17\n",
        "01,03,00,6B,00,03,74,17\n",
        "0x01 0x03 0x00 0x6B 0x00 0x03 0x74 0x17\n",
        "01-03-00-6B-00-03-74-17\r\n",
        "12:00:01.250 Tx: 01 03 00 6B 00 03 74 17\n12:00:01.275 Rx: 01 83 02 C0 F1\n",
    ],
)
def test_hex_is_found_in_any_dress(text: str) -> None:
    """Plain, separated, with 0x, with times and words in front."""
    assert detect_format(text.encode(), "bus.log").format == "hex"


def test_a_time_in_front_of_hex_is_no_offset() -> None:
    """Seconds since 1970 look like the offsets of a dump, but they do not count bytes."""
    exchanges = ["01 03 02 8a 00 04 64 5b", "01 03 08 03 33 c7 27 00 00 00 00 f2 71"] * 20
    lines = [f"{1697041234 + i}.{i:03}000 {text}" for i, text in enumerate(exchanges)]
    assert detect_format("\n".join(lines).encode(), "bus.hex").format == "hex"


def test_modbus_ascii_as_it_was_on_the_line_is_raw() -> None:
    """Colons and hex digits are what the bytes look like, not a text of them."""
    assert detect_format(b":010300000001FB\r\n:0103020007F3\r\n", "bus.bin").format == "raw"


def test_an_order_is_followed() -> None:
    """Even where the detection would not have thought of it."""
    found = detect_format(SAMPLES["hex"], "bus.hex", "hexdump")
    assert (found.format, found.forced) == ("hexdump", True)


@pytest.mark.parametrize(
    ("sample", "text"),
    [
        (b"", True),
        (b"12:00 Rx: 01 03\r\n", True),
        ("Zähler läuft\n".encode(), True),
        (bytes(range(256)), False),
        (bytes.fromhex(REQUEST), False),
        (b"\xff" * 10, False),
    ],
)
def test_text_has_no_control_characters(sample: bytes, text: bool) -> None:
    """Text has no control characters, and few bytes beyond ASCII."""
    assert is_text(sample) is text


@pytest.mark.parametrize("name", all_formats())
def test_the_core_knows_every_format_that_is_listed(name: str) -> None:
    """The registry of binary formats is here, the decision in the core: no order is unknown there.

    A binary format takes any bytes, a text refuses those that can be none.
    """
    if name in BINARY:
        assert Dialects().decide(bytes(range(64)), "recording", name)[0] == name
    else:
        with pytest.raises(ValueError, match="binary data, not"):
            Dialects().decide(bytes(range(64)), "recording", name)
