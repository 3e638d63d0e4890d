//! The texts of numbers that have a meaning of their own: sub-functions, counters, masks, events.

use super::names::{entry_of, Entry};
use super::piece::counted;

/// The text of a number in the field `name` of a function of the specification; `None` where it is a number only.
pub fn text_of(function: u8, name: &str, value: u32) -> Option<String> {
    Some(match (function, name) {
        (0x07, "status") => format!("bits set: {}", set_bits(value)),
        (0x08, "sub_function") => with_meaning("diagnostic", value),
        (0x08, "data") => format!("{value} = 0x{value:04X}"),
        (0x0B | 0x0C, "status") => match value {
            0x0000 => "ready".to_owned(),
            0xFFFF => "busy with an earlier command".to_owned(),
            _ => format!("0x{value:04X}"),
        },
        (0x0B | 0x0C, "event_count") => format!("{value} messages completed without error"),
        (0x0C, "message_count") => format!("{value} messages seen"),
        (0x14 | 0x15, "reference_type") => match value {
            0x06 => "file record".to_owned(),
            _ => format!("0x{value:02X}"),
        },
        (0x14 | 0x15, "file") => format!("file {value}"),
        (0x14 | 0x15, "record") => format!("record {value}"),
        (0x14 | 0x15, "length") => counted(value, "register"),
        (0x16, "and_mask") => format!("0x{value:04X}, bits kept: {}", set_bits(value)),
        (0x16, "or_mask") => format!("0x{value:04X}, bits set where not kept: {}", set_bits(value)),
        (0x18, "address") => format!("queue at {value} = 0x{value:04X}"),
        (0x18, "fifo_count") => format!("{} in the queue", counted(value, "register")),
        (0x2B, "mei_type") => name_alone("mei_type", value),
        (0x2B, "read_device_id_code") => with_meaning("read_device_id_code", value),
        (0x2B, "conformity_level") => name_alone("conformity_level", value),
        (0x2B, "more_follows") => match value {
            0x00 => "no more objects".to_owned(),
            0xFF => "more objects follow: request again from the next object id".to_owned(),
            _ => format!("0x{value:02X}"),
        },
        (0x2B, "object_id") => name_alone("object_id", value),
        (0x2B, "number_of_objects") => counted(value, "object"),
        _ => return None,
    })
}

/// The text of an exception code.
pub fn exception(code: u32) -> String {
    entry_of("exception", code).map_or_else(
        || format!("exception {code}: not in the specification; defined by the vendor"),
        |entry| format!("{}: {}", entry.name, entry.meaning),
    )
}

/// The text of a byte of the event log (application protocol, 6.10).
pub fn event(event: u32) -> String {
    let (kind, flags): (&str, &[(u32, &str)]) = match event {
        0x00 => return "communication restarted".to_owned(),
        // The text of 6.10 has 0x04 for this, its example 0x20.
        0x04 | 0x20 => return "entered Listen Only Mode".to_owned(),
        _ if event & 0x80 != 0 => {
            ("received", &[(1, "communication error"), (4, "character overrun"), (5, "listen only"), (6, "broadcast")])
        }
        _ if event & 0x40 != 0 => (
            "sent",
            &[
                (0, "exception 1 to 3"),
                (1, "exception 4"),
                (2, "exception 5 or 6"),
                (3, "exception 7"),
                (4, "write timeout"),
                (5, "listen only"),
            ],
        ),
        _ => return format!("0x{event:02X}, not in the specification"),
    };
    let set = flags.iter().filter(|(bit, _)| event >> bit & 1 == 1).map(|(_, text)| *text);
    [kind].into_iter().chain(set).collect::<Vec<_>>().join(", ")
}

fn name_alone(part: &str, code: u32) -> String {
    entry_of(part, code).map_or_else(|| "not in the specification".to_owned(), |entry| entry.name.clone())
}

fn with_meaning(part: &str, code: u32) -> String {
    let text = |entry: &Entry| format!("{}: {}", entry.name, entry.meaning);
    entry_of(part, code).map_or_else(|| "not in the specification".to_owned(), text)
}

fn set_bits(value: u32) -> String {
    let bits: Vec<String> = (0..16).filter(|bit| value >> bit & 1 == 1).map(|bit| bit.to_string()).collect();
    if bits.is_empty() {
        "none".to_owned()
    } else {
        bits.join(", ")
    }
}
