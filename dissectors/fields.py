"""scapy fields for the field types of the table of functions.

Imports scapy: import this module only when scapy is wanted. It has what scapy's own fields lack: a
length of everything after it, a count of the next list, a quantity that follows from a list, bits
with the lowest first, and lists that leave an incomplete item at their end to the next layer.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, cast

from scapy.fields import (
    AnyField,
    ByteEnumField,
    ByteField,
    Field,
    PacketListField,
    ShortEnumField,
    ShortField,
)
from scapy.packet import Packet

from dissectors import table

__all__ = ["BitsField", "BytesField", "CountField", "LengthField", "NumbersField", "build_fields"]

SizeOf = Callable[[Packet], int]

FORMATS = {1: ">B", 2: ">H"}
MAX_GROUP_ITEMS = 256
"""More items than a count of one byte can announce, and than a PDU can hold."""


class LengthField(Field[int | None, int]):
    """The number of bytes that follow in this body or group; None is computed on building."""

    __slots__ = ()

    def __init__(self, name: str, width: int) -> None:
        super().__init__(name, None, FORMATS[width])

    def addfield(self, pkt: Packet, s: bytes, val: int | None) -> bytes:
        """`s` with the value after it."""
        if val is None:
            following = _fields_after(pkt, self.name)
            built = (field.addfield(pkt, b"", pkt.getfieldval(field.name)) for field in following)
            val = sum(map(len, built))
        return s + struct.pack(self.fmt, val)


class CountField(Field[int | None, int]):
    """The number of items of a list in the same packet; None is computed on building."""

    __slots__ = ("counted",)

    def __init__(self, name: str, width: int, *, counted: str) -> None:
        super().__init__(name, None, FORMATS[width])
        self.counted = counted

    def addfield(self, pkt: Packet, s: bytes, val: int | None) -> bytes:
        """`s` with the value after it."""
        if val is None:
            val = len(pkt.getfieldval(self.counted))
        return s + struct.pack(self.fmt, val)


class NumbersField(Field[list[int], bytes]):
    """A list of numbers of one or two bytes."""

    __slots__ = ("size", "width")
    islist = 1

    def __init__(self, name: str, width: int, *, size: SizeOf) -> None:
        super().__init__(name, [], "s")
        self.width = width
        self.size = size

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, list[int]]:
        """The bytes after the value, and the value."""
        whole = min(len(s), self.size(pkt)) // self.width * self.width
        items = (s[at : at + self.width] for at in range(0, whole, self.width))
        return s[whole:], [int.from_bytes(item, "big") for item in items]

    def addfield(self, pkt: Packet, s: bytes, val: list[int] | None) -> bytes:
        """`s` with the value after it."""
        return s + b"".join(number.to_bytes(self.width, "big") for number in val or ())


class BitsField(Field[list[int], bytes]):
    """Packed bits as a list of 0 and 1, lowest bit of the first byte first, padded with 0."""

    __slots__ = ("size",)
    islist = 1

    def __init__(self, name: str, *, size: SizeOf) -> None:
        super().__init__(name, [], "s")
        self.size = size

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, list[int]]:
        """The bytes after the value, and the value."""
        taken = max(0, min(len(s), self.size(pkt)))
        return s[taken:], [byte >> bit & 1 for byte in s[:taken] for bit in range(8)]

    def addfield(self, pkt: Packet, s: bytes, val: list[int] | None) -> bytes:
        """`s` with the value after it."""
        packed = bytearray((len(val or ()) + 7) // 8)
        for index, bit in enumerate(val or ()):
            packed[index // 8] |= (1 if bit else 0) << index % 8
        return s + bytes(packed)


class BytesField(Field[bytes, bytes]):
    """Text or binary up to the end of its length or body."""

    __slots__ = ("size",)

    def __init__(self, name: str, *, size: SizeOf) -> None:
        super().__init__(name, b"", "s")
        self.size = size

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, bytes]:
        """The bytes after the value, and the value."""
        taken = max(0, min(len(s), self.size(pkt)))
        return s[taken:], s[:taken]

    def addfield(self, pkt: Packet, s: bytes, val: bytes | None) -> bytes:
        """`s` with the value after it."""
        return s + bytes(val or b"")


class GroupsField(PacketListField):
    """The items of a group; an item may be a mapping: `groups=[{"file": 4, "record": 7}]`."""

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """The items as packets."""
        items = x if isinstance(x, list) else [x]
        return super().any2i(pkt, [self._item(item) for item in items])

    def _item(self, item: Any) -> Any:
        if not isinstance(item, Mapping):
            return item
        # The cast is for mypy, which takes the arguments of scapy's metaclass for those of the
        # packet.
        made = cast("Callable[[], Packet]", self.cls)()
        for name, value in item.items():
            made.setfieldval(name, value)
        return made


def build_fields(
    body: Sequence[table.Field],
    *,
    derived: Mapping[str, str],
    defaults: Mapping[str, int],
    named: Mapping[str, Mapping[int, str]],
    group: Callable[[table.Field], type[Packet]],
) -> list[AnyField]:
    """The scapy fields of a body.

    `derived`: quantity -> list that it counts; `defaults`: numbers that have a default other than
    0; `named`: numbers whose values have names; `group` makes the packet class of a group's items.
    """
    found: list[AnyField] = []
    for item, size, count in _with_sizes(body):
        width = table.NUMBER_BYTES.get(item.field_type, 0)
        if item.field_type.startswith("len"):
            found.append(LengthField(item.name, width))
        elif item.field_type.startswith("count"):
            found.append(CountField(item.name, width, counted=_next_list(body, item)))
        elif item.name in derived:
            found.append(CountField(item.name, width, counted=derived[item.name]))
        elif width:
            found.append(_number(item, width, defaults.get(item.name, 0), named.get(item.name)))
        elif item.field_type == "group":
            found.append(_groups(item, group(item), size, count))
        else:
            found.append(_list(item, size))
    return found


def safe_name(name: str) -> str:
    """A field's name for scapy: names that its packets use themselves get an underscore.

    >>> safe_name("payload"), safe_name("address")
    ('payload_', 'address')
    """
    return f"{name}_" if hasattr(Packet, name) else name


def _number(
    item: table.Field, width: int, default: int, names: Mapping[int, str] | None
) -> AnyField:
    if names:
        kind = ByteEnumField if width == 1 else ShortEnumField
        return kind(item.name, default, dict(names))
    return ByteField(item.name, default) if width == 1 else ShortField(item.name, default)


def _list(item: table.Field, size: SizeOf) -> AnyField:
    if item.field_type == "bits":
        return BitsField(item.name, size=size)
    if item.field_type == "bytes":
        return BytesField(item.name, size=size)
    return NumbersField(item.name, table.LIST_ITEM_BYTES[item.field_type], size=size)


def _groups(item: table.Field, packet: type[Packet], size: SizeOf, count: str | None) -> AnyField:
    if count is None:
        return GroupsField(item.name, [], packet, length_from=size, max_count=MAX_GROUP_ITEMS)

    def counted(pkt: Packet) -> int:
        return int(pkt.getfieldval(count))

    return GroupsField(item.name, [], packet, count_from=counted, max_count=MAX_GROUP_ITEMS)


def _with_sizes(
    body: Sequence[table.Field],
) -> Iterator[tuple[table.Field, SizeOf, str | None]]:
    """Each field with the most bytes it may take, and the count field before it, if any."""
    length: str | None = None
    bytes_since_length = 0
    count: str | None = None
    for item in body:
        yield item, _size_of(item, length, bytes_since_length, count), count
        width = table.NUMBER_BYTES.get(item.field_type, 0)
        count = item.name if item.field_type.startswith("count") else None
        if item.field_type.startswith("len"):
            length, bytes_since_length = item.name, 0
        else:
            bytes_since_length += width


def _size_of(
    item: table.Field, length: str | None, bytes_since_length: int, count: str | None
) -> SizeOf:
    """A function of the packet that gives the bytes of a field, by its length or count.

    Without either, the field takes all bytes that are left, as in the core.
    """

    def size(pkt: Packet) -> int:
        most = (
            0x10000 if length is None else max(0, int(pkt.getfieldval(length)) - bytes_since_length)
        )
        if count is None:
            return most
        items = int(pkt.getfieldval(count))
        counted = (
            -(-items // 8)
            if item.field_type == "bits"
            else items * table.LIST_ITEM_BYTES.get(item.field_type, 1)
        )
        return min(most, counted)

    return size


def _next_list(body: Sequence[table.Field], count: table.Field) -> str:
    following = body[body.index(count) + 1 :]
    return next(item.name for item in following if item.field_type not in table.NUMBER_BYTES)


def _fields_after(pkt: Packet, name: str) -> list[AnyField]:
    names = [field.name for field in pkt.fields_desc]
    return list(pkt.fields_desc)[names.index(name) + 1 :]
