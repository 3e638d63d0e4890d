//! The values of a log's fields, and how they are written.

use modlens_protocol::decimal::push_int;
use modlens_protocol::Ns;

/// The value of one field of a log.
pub(super) enum LogValue {
    Unset,
    Count(i64),
    Time(Ns),
    Text(String),
    Yes(bool),
    Counts(Vec<i32>),
}

/// Bytes as Zeek prints them: `\xNN` for everything that is not printable ASCII.
pub(super) fn escaped_bytes(bytes: &[u8]) -> String {
    let escape = |&byte: &u8| match byte {
        b'\\' => String::from("\\\\"),
        b' '..=b'~' => (byte as char).to_string(),
        _ => format!("\\x{byte:02x}"),
    };
    bytes.iter().map(escape).collect()
}

/// Appends a time as seconds since 1970 with six decimals.
pub(super) fn push_epoch(ns: Ns, out: &mut Vec<u8>) {
    push_int(ns.div_euclid(1_000_000_000), out);
    out.extend_from_slice(format!(".{:06}", ns.rem_euclid(1_000_000_000) / 1000).as_bytes());
}

/// Appends numbers separated by commas.
pub(super) fn push_counts(values: &[i32], out: &mut Vec<u8>) {
    for (i, value) in values.iter().enumerate() {
        if i > 0 {
            out.push(b',');
        }
        push_int(i64::from(*value), out);
    }
}

/// Appends a value for a tab-separated log.
pub(super) fn push_text(value: &LogValue, out: &mut Vec<u8>) {
    match value {
        LogValue::Unset => out.push(b'-'),
        LogValue::Count(count) => push_int(*count, out),
        LogValue::Time(ns) => push_epoch(*ns, out),
        LogValue::Text(text) => out.extend_from_slice(text.as_bytes()),
        LogValue::Yes(yes) => out.push(if *yes { b'T' } else { b'F' }),
        LogValue::Counts(values) if values.is_empty() => out.extend_from_slice(b"(empty)"),
        LogValue::Counts(values) => push_counts(values, out),
    }
}

/// Appends a value as JSON.
pub(super) fn push_json(value: &LogValue, out: &mut Vec<u8>) {
    match value {
        LogValue::Text(text) => out.extend_from_slice(serde_json::Value::from(text.as_str()).to_string().as_bytes()),
        LogValue::Yes(yes) => out.extend_from_slice(if *yes { b"true" } else { b"false" }),
        LogValue::Counts(values) => {
            out.push(b'[');
            push_counts(values, out);
            out.push(b']');
        }
        other => push_text(other, out),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_escaped_as_in_zeek() {
        assert_eq!(escaped_bytes(b"\x00A\\"), "\\x00A\\\\");
    }
}
