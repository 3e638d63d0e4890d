//! Parses modlens' own chunk log, one JSON object per read, such as `{"t": 12.5, "hex": "0503", "line": "A"}`, and those of
//! others, which call the time and the bytes otherwise, such as `{"timestamp": "2026-11-24T12:30:05.250Z", "data": "05 03"}`.

use memchr::memchr;
use serde_json::Value as Json;

use crate::text::json_times;
use crate::text::timestamps::TimestampParser;
use modlens_protocol::hex::decode_pairs;
use modlens_protocol::Ns;

/// What others call the bytes of a read. An object with another key beside these and its time says more than bytes, such as
/// who sent them, which is not for this parser.
const OTHER_NAMES: [&str; 4] = ["data", "bytes", "payload", "raw"];

/// Parses one line of a chunk log and appends its bytes to `out`.
///
/// Returns the time (`None` for a read without one) and the line of a two-line tap (0 for the only line, 1 for A, 2 for B).
/// Returns `None` for a line that is no such object; `out` is then unchanged.
pub(super) fn parse(line: &[u8], timestamps: &mut TimestampParser, out: &mut Vec<u8>) -> Option<(Option<Ns>, u8)> {
    if line.first() != Some(&b'{') {
        return None;
    }
    if let Some((time, hex, line)) = split_own_form(line) {
        let before = out.len();
        let time = if time == b"null" { Some(None) } else { timestamps.seconds(time).map(Some) };
        if let Some(time) = time.filter(|_| decode_pairs(hex, out)) {
            return Some((time, line));
        }
        out.truncate(before);
    }
    let Ok(Json::Object(object)) = serde_json::from_slice::<Json>(line) else { return None };
    if !object.contains_key("hex") {
        return other(line, &object, timestamps, out);
    }
    let bytes = object.get("hex").and_then(Json::as_str).and_then(modlens_protocol::hex::parse_hex)?;
    let time = match object.get("t") {
        Some(Json::Number(_)) => Some(json_times::number(line).and_then(|text| timestamps.seconds(text))?),
        None | Some(Json::Null) => None,
        Some(_) => return None,
    };
    let line = match object.get("line").and_then(Json::as_str) {
        None => 0,
        Some("A") => 1,
        Some("B") => 2,
        Some(_) => return None,
    };
    out.extend(bytes);
    Some((time, line))
}

/// Splits an object that has exactly the form which modlens writes into the texts of its time, its hex digits and the
/// number of its line. This avoids the JSON parser for nearly all lines; `None` means that the parser has to read it.
fn split_own_form(line: &[u8]) -> Option<(&[u8], &[u8], u8)> {
    let rest = line.strip_prefix(b"{\"t\":")?.trim_ascii_start();
    let (time, rest) = rest.split_at(memchr(b',', rest)?);
    let rest = rest[1..].trim_ascii_start().strip_prefix(b"\"hex\":")?.trim_ascii_start().strip_prefix(b"\"")?;
    let (hex, rest) = rest.split_at(memchr(b'"', rest)?);
    let line = match rest[1..].trim_ascii_end() {
        b"}" => 0,
        b",\"line\":\"A\"}" | b", \"line\": \"A\"}" => 1,
        b",\"line\":\"B\"}" | b", \"line\": \"B\"}" => 2,
        _ => return None,
    };
    let plain = time.iter().all(|b| b.is_ascii_digit() || matches!(b, b'.' | b'-')) || time == b"null";
    (plain && hex.len() % 2 == 0).then_some((time, hex, line))
}

/// Parses an object of somebody else's, of which each line has a time and bytes and nothing more.
fn other(
    line: &[u8],
    object: &serde_json::Map<String, Json>,
    timestamps: &mut TimestampParser,
    out: &mut Vec<u8>,
) -> Option<(Option<Ns>, u8)> {
    let mut bytes = None;
    let mut time = None;
    for (key, value) in object {
        match value {
            Json::String(text) if OTHER_NAMES.contains(&key.as_str()) && bytes.is_none() => {
                bytes = Some(modlens_protocol::hex::parse_hex(text)?);
            }
            Json::String(text) if json_times::KEYS.contains(&key.as_str()) => time = Some(timestamps.find(text.as_bytes())?),
            Json::Number(_) if json_times::KEYS.contains(&key.as_str()) => {
                time = Some(timestamps.number_of_time(json_times::number(line)?)?);
            }
            _ => return None,
        }
    }
    out.extend(bytes?);
    Some((Some(time?), 0))
}
