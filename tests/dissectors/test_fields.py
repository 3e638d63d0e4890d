"""scapy fields of our own."""

from __future__ import annotations

from scapy.packet import Packet

from dissectors.fields import build_fields, safe_name
from dissectors.table import Field


def packet_of(*fields: str) -> type[Packet]:
    """Return a packet class with these fields and no names or defaults."""
    body = [Field.parse(text) for text in fields]
    built = build_fields(body, derived={}, defaults={}, named={}, group=lambda _: Packet)
    return type(Packet)("Own", (Packet,), {"name": "own", "fields_desc": built})  # type: ignore[no-any-return, misc]


def test_a_length_counts_everything_behind_it() -> None:
    """A length counts all numbers and lists after it, unless it is given."""
    cls = packet_of("kind:u8", "size:len8", "first:u16", "rest:u8[]")
    assert bytes(cls(first=1, rest=[2, 3])).hex() == "000400010203"
    assert bytes(cls(size=9, rest=[2])).hex() == "0009000002"
    packet = cls(bytes.fromhex("00 04 0001 0203 FF"))
    assert (packet.first, packet.rest) == (1, [2, 3])
    assert bytes(packet.payload) == b"\xff"


def test_a_count_ends_its_list() -> None:
    """Bits by number of bits, numbers by number of items."""
    cls = packet_of("many:count8", "states:bits", "tail:u8")
    assert bytes(cls(states=[1, 0, 1], tail=7)).hex() == "030507"
    assert cls(bytes.fromhex("09 0501 07")).tail == 7
    words = packet_of("many:count16", "items:u16[]", "tail:bytes")
    packet = words(bytes.fromhex("0001 0102 4142"))
    assert (packet.items, packet.tail) == ([0x0102], b"AB")


def test_half_a_value_is_left_for_the_next_layer() -> None:
    """An odd byte at the end of a list of registers is left to the next layer."""
    packet = packet_of("items:u16[]")(bytes.fromhex("0001 02"))
    assert packet.items == [1]
    assert bytes(packet.payload) == b"\x02"


def test_names_that_scapy_uses_get_an_underscore() -> None:
    """Fields with names that scapy's packets use get an underscore."""
    assert safe_name("time") == "time_"
    assert safe_name("registers") == "registers"
