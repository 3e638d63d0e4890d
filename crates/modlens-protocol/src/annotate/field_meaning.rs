//! The meaning of one field of a PDU in words.
//!
//! It follows from the field's name in the table and from other fields: registers get their numbers from the request's
//! address, a byte count is compared with the bytes that follow. What the specification does not permit is described and
//! marked as invalid.

use super::context::{Block, Context};
use super::named_values;
use super::part::{Part, EXTRA};
use super::piece::{counted, Meaning};
use super::violations::violations;
use crate::functions::FieldType;
use crate::register_type::{Space, LAST_ADDRESS};

const BITS: u32 = 8;

/// The meaning of an item of a list of numbers, or of a byte of packed bits.
pub fn item_meaning(part: &Part<'_>, context: &Context<'_>, index: u32, number: u32) -> Meaning {
    match part.field_type {
        FieldType::Bits => bits(context.block(part.name), index, number),
        _ if part.name == "events" => Meaning::valid(named_values::event(number)),
        FieldType::U16List => Meaning::valid(register(context.block(part.name), index, number)),
        _ => Meaning::valid(format!("0x{number:02X}")),
    }
}

/// The meaning of any other field.
pub fn field_meaning(part: &Part<'_>, context: &Context<'_>) -> Meaning {
    let Some(value) = part.number() else {
        return if part.name == EXTRA { extra(context) } else { Meaning::valid(text(part)) };
    };
    let mut texts = vec![number(part, value, context)];
    let wrong = violations(part, value, context);
    let is_valid = wrong.is_empty();
    texts.extend(wrong);
    texts.retain(|text| !text.is_empty());
    Meaning { text: texts.join("; "), is_valid }
}

/// The meaning of a number: length, named value, address, quantity, register value, or hex.
fn number(part: &Part<'_>, value: u32, context: &Context<'_>) -> String {
    if matches!(part.field_type, FieldType::Len8 | FieldType::Len16) {
        return length(part, value, context);
    }
    if part.name == "exception_code" {
        return named_values::exception(value);
    }
    let is_public = context.pdu.row.is_some_and(|row| row.vendor().is_none());
    let named = if is_public { named_values::text_of(context.pdu.function, part.name, value) } else { None };
    if let Some(text) = named {
        return text;
    }
    if matches!(part.field_type, FieldType::Count8 | FieldType::Count16) {
        return format!("{} in the list", counted(value, "item"));
    }
    let block = context.block(part.name);
    let last_word = part.name.rsplit('_').next().unwrap_or_default();
    match (block.space, last_word) {
        (Some(space), "address") => format!("{value} = 0x{value:04X}, {}", space.both_notations(value)),
        (Some(space), "quantity") => quantity(value, space, block.start),
        (Some(Space::Coil), "value") => coil(value, block.start),
        (Some(_), "value") => register(context.block("value"), 0, value),
        _ => {
            let width = 2 * part.bytes.len();
            format!("0x{value:0width$X}")
        }
    }
}

/// The value of a function that writes a single coil.
fn coil(value: u32, start: Option<u32>) -> String {
    let state = match value {
        0xFF00 => "on",
        0x0000 => "off",
        _ => "neither on (0xFF00) nor off (0x0000)",
    };
    start.map_or_else(|| state.to_owned(), |start| format!("coil {} {state}", start + 1))
}

fn length(part: &Part<'_>, value: u32, context: &Context<'_>) -> String {
    let bytes = counted(value, "byte");
    match context.bytes_after(part) {
        Some(follow) if follow != value as usize => format!("says {bytes}, but {follow} follow"),
        _ => format!("{bytes} {}", if value == 1 { "follows" } else { "follow" }),
    }
}

fn quantity(value: u32, space: Space, start: Option<u32>) -> String {
    let counted = counted(value, space.noun());
    let Some(first) = start.filter(|_| value > 0) else { return counted };
    let last = first + value - 1;
    let first_text = space.six_digit(first);
    if last > LAST_ADDRESS {
        return format!("{counted} from {first_text}");
    }
    if value == 1 {
        return format!("{counted}, {first_text}");
    }
    format!("{counted}, {first_text} to {}", space.six_digit(last))
}

/// A register as unsigned, signed and hex, in front of it its number.
fn register(block: Block, index: u32, number: u32) -> String {
    let signed = number as u16 as i16;
    let text = format!("u16 {number}, s16 {signed}, 0x{number:04X}");
    match (block.space, block.start.map(|start| start + index)) {
        (Some(space), Some(address)) if address <= LAST_ADDRESS => format!("{}: {text}", space.six_digit(address)),
        _ => text,
    }
}

/// Eight bits by number, lowest first; those beyond the quantity are padding (section 6.1).
fn bits(block: Block, index: u32, byte: u32) -> Meaning {
    let first = BITS * index;
    let count = block.quantity.map_or(BITS, |quantity| quantity.saturating_sub(first).min(BITS));
    let (noun, base) = match block.space.zip(block.start) {
        Some((space, start)) => (space.noun(), start + first + 1),
        None => ("bit", first),
    };
    let state = |bit: u32| format!("{} {}", base + bit, if byte >> bit & 1 == 1 { "on" } else { "off" });
    let states: Vec<String> = (0..count).map(state).collect();
    let text = if states.is_empty() { String::new() } else { format!("{noun} {}", states.join(", ")) };
    if count == BITS {
        return Meaning::valid(text);
    }
    let is_valid = byte >> count == 0;
    let padding = counted(BITS - count, "padding bit");
    let ending = if is_valid { padding } else { format!("{padding} that should be 0") };
    Meaning { text: if text.is_empty() { ending } else { format!("{text}; {ending}") }, is_valid }
}

fn text(part: &Part<'_>) -> String {
    match part.bytes {
        [] => "empty".to_owned(),
        [id @ .., state @ (0xFF | 0x00)] if part.name == "server_id" => {
            let state = format!("run indicator {}", if *state == 0 { "off" } else { "on" });
            let id = quoted(id);
            if id.is_empty() {
                state
            } else {
                format!("{id}, {state}")
            }
        }
        bytes => quoted(bytes),
    }
}

/// The text, if it is one; control characters never reach a screen.
fn quoted(bytes: &[u8]) -> String {
    let is_text = !bytes.is_empty() && bytes.iter().all(|byte| (b' '..=b'~').contains(byte));
    if is_text {
        format!("\"{}\"", String::from_utf8_lossy(bytes))
    } else {
        String::new()
    }
}

fn extra(context: &Context<'_>) -> Meaning {
    if context.pdu.exception.is_some() {
        return Meaning::wrong("an exception response has only one byte");
    }
    if !context.pdu.is_complete {
        return Meaning::wrong("part of a value whose other bytes are missing");
    }
    if !context.has_layout() {
        return Meaning::valid("no layout is known for this content");
    }
    Meaning::wrong("extra bytes, not part of this function")
}
