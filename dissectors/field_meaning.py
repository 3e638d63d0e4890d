"""The meaning of one field of a PDU in words: the texts of `dissectors.describe`.

It follows from the field's name in the table and from other fields: registers get their numbers
from the request's address, a byte count is compared with the bytes that follow. What the
specification does not permit is described and marked as invalid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from dissectors import address, vocabulary
from dissectors.context import LAST_ADDRESS, Context, Meaning
from dissectors.pdu import DecodedField
from dissectors.table import LIST_ITEM_BYTES
from dissectors.validation import violations

__all__ = ["field_meaning"]

DIAGNOSTICS = 0x08
ENCAPSULATED = 0x2B
BITS = 8
PRINTABLE = range(0x20, 0x7F)


def field_meaning(
    part: DecodedField, context: Context, *, index: int = 0, number: int | None = None
) -> Meaning:
    """The meaning of a field; `index` and `number` are those of one item of a list."""
    if part.field_type == "bits":
        return _bits(part, context, index, number or 0)
    if part.field_type in LIST_ITEM_BYTES:
        return Meaning(_item(part, context, index, number or 0))
    if isinstance(part.value, bytes):
        return _extra(context) if part.name == "extra" else Meaning(_text(part, part.value))
    value = part.value if isinstance(part.value, int) else 0
    text = _number(part, value, context)
    wrong = violations(part, value, context)
    return Meaning("; ".join(filter(None, (text, *wrong))), is_valid=not wrong)


def _number(part: DecodedField, value: int, context: Context) -> str:
    """The meaning of a number: length, named value, address, quantity, register value, or hex."""
    if part.field_type.startswith("len"):
        return _length(part, value, context)
    named = _named(part, context)
    if named is not None:
        return named(value)
    kind, start, _ = context.register_block(part.name)
    last_word = part.name.rpartition("_")[2]
    if kind is None or last_word not in ("value", "address", "quantity"):
        return f"0x{value:0{2 * part.length}X}"
    if last_word == "address":
        return f"{value} = 0x{value:04X}, {address.modicon_address(value, kind)}"
    if last_word == "quantity":
        return _quantity(value, kind, start)
    return _single(value, kind, start, context)


def _single(value: int, kind: str, start: int | None, context: Context) -> str:
    """The value of a function that writes a single coil or register."""
    if kind != "coil":
        return _register(context, "value", 0, value)
    state = {0xFF00: "on", 0x0000: "off"}.get(value, "neither on (0xFF00) nor off (0x0000)")
    return state if start is None else f"coil {start + 1} {state}"


def _length(part: DecodedField, value: int, context: Context) -> str:
    follow = context.bytes_after(part)
    if follow not in (None, value):
        return f"says {value} {_plural('byte', value)}, but {follow} follow"
    return f"{value} {_plural('byte', value)} {'follows' if value == 1 else 'follow'}"


def _named(part: DecodedField, context: Context) -> Callable[[int], str] | None:
    """The function that makes the text of this field; None where there is no special one."""
    if part.name == "exception_code":
        return _exception
    found = _TEXTS.get((context.pdu.function, part.name))
    if found is not None and context.row is not None and context.row.vendor is None:
        return found
    return _counted if part.field_type.startswith("count") else None


def _counted(value: int) -> str:
    return f"{value} {_plural('item', value)} in the list"


def _exception(code: int) -> str:
    entry = vocabulary.exception(code)
    if entry is None:
        return f"exception {code}: not in the specification; defined by the vendor"
    return f"{entry.name}: {entry.meaning}"


def _entry(
    look_up: Callable[[int], vocabulary.Name | None], *, meaning: bool
) -> Callable[[int], str]:
    def text(code: int) -> str:
        entry = look_up(code)
        if entry is None:
            return "not in the specification"
        return f"{entry.name}: {entry.meaning}" if meaning else entry.name

    return text


def _set_bits(value: int) -> str:
    bits = [str(bit) for bit in range(16) if value >> bit & 1]
    return ", ".join(bits) or "none"


_BUSY = {0x0000: "ready", 0xFFFF: "busy with an earlier command"}
_REFERENCES = {0x06: "file record"}
_MORE = {
    0x00: "no more objects",
    0xFF: "more objects follow: request again from the next object id",
}

_TEXTS: Mapping[tuple[int, str], Callable[[int], str]] = {
    (0x07, "status"): lambda value: f"bits set: {_set_bits(value)}",
    (DIAGNOSTICS, "sub_function"): _entry(vocabulary.diagnostic, meaning=True),
    (DIAGNOSTICS, "data"): lambda value: f"{value} = 0x{value:04X}",
    (0x0B, "status"): lambda value: _BUSY.get(value, f"0x{value:04X}"),
    (0x0B, "event_count"): lambda value: f"{value} messages completed without error",
    (0x0C, "status"): lambda value: _BUSY.get(value, f"0x{value:04X}"),
    (0x0C, "event_count"): lambda value: f"{value} messages completed without error",
    (0x0C, "message_count"): lambda value: f"{value} messages seen",
    (0x14, "reference_type"): lambda value: _REFERENCES.get(value, f"0x{value:02X}"),
    (0x14, "file"): lambda value: f"file {value}",
    (0x14, "record"): lambda value: f"record {value}",
    (0x14, "length"): lambda value: f"{value} {_plural('register', value)}",
    (0x15, "reference_type"): lambda value: _REFERENCES.get(value, f"0x{value:02X}"),
    (0x15, "file"): lambda value: f"file {value}",
    (0x15, "record"): lambda value: f"record {value}",
    (0x15, "length"): lambda value: f"{value} {_plural('register', value)}",
    (0x16, "and_mask"): lambda value: f"0x{value:04X}, bits kept: {_set_bits(value)}",
    (0x16, "or_mask"): lambda value: f"0x{value:04X}, bits set where not kept: {_set_bits(value)}",
    (0x18, "address"): lambda value: f"queue at {value} = 0x{value:04X}",
    (0x18, "fifo_count"): lambda value: f"{value} {_plural('register', value)} in the queue",
    (ENCAPSULATED, "mei_type"): _entry(vocabulary.mei_type, meaning=False),
    (ENCAPSULATED, "read_device_id_code"): _entry(vocabulary.read_device_id_code, meaning=True),
    (ENCAPSULATED, "conformity_level"): _entry(vocabulary.conformity_level, meaning=False),
    (ENCAPSULATED, "more_follows"): lambda value: _MORE.get(value, f"0x{value:02X}"),
    (ENCAPSULATED, "object_id"): _entry(vocabulary.object_id, meaning=False),
    (ENCAPSULATED, "number_of_objects"): lambda value: f"{value} {_plural('object', value)}",
}


def _quantity(value: int, kind: str, start: int | None) -> str:
    counted = f"{value} {_plural(address.NOUNS[kind], value)}"
    if start is None or not value:
        return counted
    first, last = start, start + value - 1
    if last > LAST_ADDRESS:
        return f"{counted} from {address.six_digit(first, kind)}"
    if value == 1:
        return f"{counted}, {address.six_digit(first, kind)}"
    return f"{counted}, {address.six_digit(first, kind)} to {address.six_digit(last, kind)}"


def _item(part: DecodedField, context: Context, index: int, number: int) -> str:
    if part.name == "events":
        return _event(number)
    if part.field_type == "u16[]":
        return _register(context, part.name, index, number)
    return f"0x{number:02X}"


def _register(context: Context, name: str, index: int, number: int) -> str:
    """A register as unsigned, signed and hex, in front of it its number."""
    kind, start, _ = context.register_block(name)
    signed = number - 0x10000 if number & 0x8000 else number
    text = f"u16 {number}, s16 {signed}, 0x{number:04X}"
    if kind is None or start is None or start + index > LAST_ADDRESS:
        return text
    return f"{address.six_digit(start + index, kind)}: {text}"


def _bits(part: DecodedField, context: Context, index: int, byte: int) -> Meaning:
    """Eight bits by number, lowest first; those beyond the quantity are padding (section 6.1)."""
    kind, start, quantity = context.register_block(part.name)
    first = BITS * index
    count = BITS if quantity is None else max(0, min(BITS, quantity - first))
    noun = "bit" if kind is None or start is None else address.NOUNS[kind]
    base = first if start is None else start + first + 1
    states = (f"{base + bit} {'on' if byte >> bit & 1 else 'off'}" for bit in range(count))
    text = ", ".join(states)
    text = f"{noun} {text}" if text else ""
    if count == BITS:
        return Meaning(text)
    clean = byte >> count == 0
    padding = f"{BITS - count} padding {_plural('bit', BITS - count)}"
    ending = padding if clean else f"{padding} that should be 0"
    return Meaning(f"{text}; {ending}" if text else ending, is_valid=clean)


def _event(event: int) -> str:
    """One byte of the event log (application protocol, 6.10)."""
    if event == 0x00:
        return "communication restarted"
    # The text of 6.10 has 0x04 for this, its example 0x20.
    if event in (0x04, 0x20):
        return "entered Listen Only Mode"
    if event & 0x80:
        flags = {1: "communication error", 4: "character overrun", 5: "listen only", 6: "broadcast"}
        kind = "received"
    elif event & 0x40:
        flags = {
            0: "exception 1 to 3", 1: "exception 4", 2: "exception 5 or 6", 3: "exception 7",
            4: "write timeout", 5: "listen only",
        }  # fmt: skip
        kind = "sent"
    else:
        return f"0x{event:02X}, not in the specification"
    return ", ".join([kind, *(text for bit, text in flags.items() if event >> bit & 1)])


def _text(part: DecodedField, value: bytes) -> str:
    if part.name == "server_id" and value[-1:] in (b"\xff", b"\x00"):
        state = "on" if value[-1] else "off"
        return f"{_quoted(value[:-1])}, run indicator {state}".lstrip(", ")
    return _quoted(value) if value else "empty"


def _quoted(value: bytes) -> str:
    """The text, if it is one; control characters never reach a screen."""
    printable = bool(value) and all(byte in PRINTABLE for byte in value)
    return f'"{value.decode("ascii")}"' if printable else ""


def _extra(context: Context) -> Meaning:
    if context.pdu.exception is not None:
        return Meaning("an exception response has only one byte", is_valid=False)
    if not context.pdu.complete:
        return Meaning("part of a value whose other bytes are missing", is_valid=False)
    if context.row is None or not context.row.has_layout(context.direction):
        return Meaning("no layout is known for this content")
    return Meaning("extra bytes, not part of this function", is_valid=False)


def _plural(noun: str, count: int) -> str:
    return noun if count == 1 else f"{noun}s"
