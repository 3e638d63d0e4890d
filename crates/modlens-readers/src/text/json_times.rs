//! Times that are numbers in JSON objects, such as `{"ts": 1697041234.123456, "dir": "tx", ...`.

/// What programs call the time of an object.
pub(super) const KEYS: [&str; 4] = ["t", "ts", "time", "timestamp"];

/// The digits of an object's time as they are in the text, because a float would lose nanoseconds.
pub(super) fn number(text: &[u8]) -> Option<&[u8]> {
    let mut behind = text.split(|b| *b == b'"').skip(1);
    while let (Some(key), Some(rest)) = (behind.next(), behind.next()) {
        let is_time = KEYS.iter().any(|name| name.as_bytes() == key);
        if let Some(rest) = rest.trim_ascii_start().strip_prefix(b":").filter(|_| is_time) {
            let rest = rest.trim_ascii_start();
            let length = rest.iter().take_while(|b| b.is_ascii_digit() || matches!(b, b'.' | b'-')).count();
            return Some(&rest[..length]).filter(|text| !text.is_empty());
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_behind_a_key_of_time_is_a_time() {
        assert_eq!(number(br#"{"t": 1697041234.25, "dir": "tx", "data": ""#), Some(&b"1697041234.25"[..]));
        assert_eq!(number(br#"{"dir":"tx","timestamp":1697041234250,"raw":""#), Some(&b"1697041234250"[..]));
        assert_eq!(number(br#"{"size": 8, "data": ""#), None);
        assert_eq!(number(br#"{"time": "12:30:05", "data": ""#), None);
    }
}
