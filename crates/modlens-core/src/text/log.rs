//! The chunk log of records.md: one JSON object a read.

use serde_json::Value as Json;

use crate::text::stamp::Stamps;
use crate::text::{Line, Record};

/// Parses a line; its bytes go to `out`.
pub fn parse(line: &[u8], stamps: &mut Stamps, out: &mut Vec<u8>) -> Line {
    let Ok(Json::Object(object)) = serde_json::from_slice::<Json>(line) else { return Line::Unparsed };
    let Some(bytes) = object.get("hex").and_then(Json::as_str).and_then(crate::pdu::parse_hex) else { return Line::Unparsed };
    let time = match object.get("t") {
        Some(Json::Number(_)) => match number_text(line).and_then(|text| stamps.seconds(text)) {
            Some(time) => Some(time),
            None => return Line::Unparsed,
        },
        None | Some(Json::Null) => None,
        Some(_) => return Line::Unparsed,
    };
    let line = match object.get("line").and_then(Json::as_str) {
        None => 0,
        Some("A") => 1,
        Some("B") => 2,
        Some(_) => return Line::Unparsed,
    };
    out.extend(bytes);
    if out.is_empty() {
        Line::Nothing
    } else {
        Line::Bytes(Record { time, line, ..Record::default() })
    }
}

/// The digits of `t` as they stand: a float would lose nanoseconds.
fn number_text(line: &[u8]) -> Option<&[u8]> {
    let at = line.windows(3).position(|key| key == b"\"t\"")? + 3;
    let rest = line[at..].trim_ascii_start().strip_prefix(b":")?.trim_ascii_start();
    let length = rest.iter().take_while(|b| !matches!(b, b',' | b'}' | b' ')).count();
    Some(&rest[..length])
}
