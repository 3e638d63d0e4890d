//! What all bytes of a text show together where no line is a frame, and strings in Latin-1, as programs print what they received.

use crate::text::proved::hex_beside_dates;
use modlens_protocol::oddity::Oddity;

/// So many lines with bytes are more than a few words that look like hex.
const LEAST_LINES: usize = 6;

/// A line with so many bytes counts by itself.
const LEAST_BYTES: usize = 12;

/// A shorter string is a word.
const LEAST_LATIN: usize = 8;

/// What the bytes of all lines show; `None` where they show nothing.
pub(super) fn named<'a>(lines: impl Iterator<Item = &'a [u8]>) -> Option<String> {
    let bytes: Vec<Vec<u8>> = lines.filter_map(|line| latin_bytes(line).or_else(|| hex_beside_dates(line))).collect();
    let long: Vec<u8> = bytes.iter().filter(|bytes| bytes.len() >= LEAST_BYTES).flatten().copied().collect();
    let all = || Oddity::of_signal(&bytes.concat()).filter(|_| bytes.len() >= LEAST_LINES);
    let (oddity, lines) = Oddity::of_signal(&long).map(|oddity| (oddity, 1)).or_else(|| Some((all()?, bytes.len())))?;
    Some(if lines > 1 { format!("in {lines} lines, {}", oddity.words()) } else { oddity.words() })
}

/// The bytes of the longest string of Python with an escape sequence, in which other letters stand for their numbers in Latin-1;
/// `None` where there is no such letter, or mostly words.
pub(super) fn latin_bytes(line: &[u8]) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(line).ok().filter(|text| !text.is_ascii() && text.contains("\\x"))?;
    let starts = text.match_indices(['\'', '"']).map(|(at, quote)| (&text[at + 1..], quote));
    let strings = starts.map(|(rest, quote)| decoded(rest.split(quote).next().unwrap_or_default()));
    let is_word = |byte: &&u8| byte.is_ascii_alphanumeric() || **byte == b' ';
    let are_bytes = |bytes: &Vec<u8>| {
        let is_odd = bytes.iter().any(|byte| *byte > 0x7F) && 2 * bytes.iter().filter(is_word).count() < bytes.len();
        is_odd && bytes.len() >= LEAST_LATIN
    };
    strings.filter(are_bytes).max_by_key(Vec::len)
}

/// The bytes of a string, up to a character that is none.
fn decoded(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = text;
    while let Some(next) = rest.chars().next() {
        let escaped = rest.strip_prefix("\\x").and_then(|digits| u8::from_str_radix(digits.get(..2)?, 16).ok());
        let short = rest.strip_prefix('\\').and_then(|rest| match rest.chars().next()? {
            'n' => Some(b'\n'),
            'r' => Some(b'\r'),
            't' => Some(b'\t'),
            '\\' => Some(b'\\'),
            _ => None,
        });
        let (byte, length) = match (escaped, short) {
            (Some(byte), _) => (Some(byte), 4),
            (None, Some(byte)) => (Some(byte), 2),
            (None, None) => (u8::try_from(u32::from(next)).ok(), next.len_utf8()),
        };
        let Some(byte) = byte else { break };
        bytes.push(byte);
        rest = &rest[length..];
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_string_in_latin_1_is_bytes() {
        let line = "Error: '\\x18þ' came. The response is: '`à`\\x18þ`\\x18þ`\\x00ÿ`".as_bytes();
        let bytes = [0x60, 0xE0, 0x60, 0x18, 0xFE, 0x60, 0x18, 0xFE, 0x60, 0, 0xFF, 0x60];
        assert_eq!(latin_bytes(line), Some(bytes.to_vec()));
        for words in ["'Grüße aus Köln\\x0a'", "it's \\x01 für mich", "'\\x01\\x03\\x00\\x00\\x00\\x02\\xc4\\x0b'"] {
            assert_eq!(latin_bytes(words.as_bytes()), None, "{words}");
        }
    }

    #[test]
    fn short_bursts_are_judged_together() {
        let bursts =
            ["2026-03-04T05:06:07.089;F=00", "F=00-00-FE", "F=00-00", "F=FF", "2026-03-04T05:06:08;F=00-F8-00", "F=00-00-00"];
        let said = named(bursts.iter().map(|line| line.as_bytes())).expect("levels");
        assert!(said.starts_with("in 6 lines, nearly all bytes are 00, FF"), "{said}");
        let constant = named([&b"<<< 00 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9 A9"[..]].into_iter());
        assert!(constant.is_some_and(|said| said.starts_with("20 of 21 bytes are A9")));
        let answer = named([&b"01 03 14 00 05 00 05 00 05 00 05 00 05 00 05 00 05 00 05 00 05 00 05 11 22"[..]].into_iter());
        assert_eq!(answer, None);
    }
}
