//! Finds text in registers that never change.

use std::collections::BTreeMap;

/// Consecutive registers that hold a text.
pub struct TextRun {
    /// Address of the first register.
    pub address: u16,
    /// The number of registers.
    pub count: u16,
    /// The text, without padding.
    pub text: String,
    /// Whether the low byte of a register comes first.
    pub swapped: bool,
}

/// The least number of letters in a text; half of them suffice if there are `LONG_TEXT_BYTES` characters. Fewer may be
/// numbers.
const MIN_LETTERS: usize = 4;
const LONG_TEXT_BYTES: usize = 8;

/// Finds the texts among constant registers, given by address.
pub fn runs(constant: &BTreeMap<u16, u16>) -> Vec<TextRun> {
    let mut found = Vec::new();
    let mut run: Vec<(u16, u16)> = Vec::new();
    for (&address, &word) in constant {
        let is_adjacent = run.last().is_none_or(|(last, _)| u32::from(*last) + 1 == u32::from(address));
        let ended = run.last().is_some_and(|(_, last)| last.to_be_bytes().contains(&0));
        if !(is_adjacent && !ended && holds_letters(word)) {
            found.extend(finish(&run, Some(word).filter(|_| is_adjacent)));
            run.clear();
        }
        if holds_letters(word) {
            run.push((address, word));
        }
    }
    found.extend(finish(&run, None));
    found
}

/// Whether a register may belong to a text: two printable bytes, or one and the zero that ends the text.
fn holds_letters(word: u16) -> bool {
    let [high, low] = word.to_be_bytes();
    let printable = |byte: u8| (0x20..0x7F).contains(&byte);
    (printable(high) && (printable(low) || low == 0)) || (high == 0 && printable(low) && low.is_ascii_alphanumeric())
}

/// The text of a run of registers, if it looks like one, in the byte order that makes it look more like a text.
fn finish(run: &[(u16, u16)], next: Option<u16>) -> Option<TextRun> {
    let is_ended = next == Some(0) || run.last().is_some_and(|(_, word)| word.to_be_bytes().contains(&0));
    let run = &run[run.iter().position(|(_, word)| !word.to_be_bytes().contains(&0))?..];
    let straight: Vec<u8> = run.iter().flat_map(|(_, word)| word.to_be_bytes()).collect();
    let swapped: Vec<u8> = run.iter().flat_map(|(_, word)| word.to_le_bytes()).collect();
    // Most devices store the first character in the high byte.
    let is_swapped = disorder(&swapped) + 1 < disorder(&straight);
    let bytes = if is_swapped { &swapped } else { &straight };
    let letters = bytes.iter().filter(|byte| byte.is_ascii_alphabetic()).count();
    let printable_bytes = bytes.iter().filter(|byte| byte.is_ascii_alphanumeric() || b" -_./\0".contains(byte)).count();
    let is_long_text = letters * 2 >= MIN_LETTERS && bytes.len() >= LONG_TEXT_BYTES && printable_bytes == bytes.len();
    // A short one, such as the number of a version, ends with zeros.
    let digits = bytes.iter().filter(|byte| byte.is_ascii_alphanumeric()).count();
    let least = if is_swapped { 4 } else { 3 };
    let is_short_text = is_ended && printable_bytes == bytes.len() && digits >= least && bytes.len() >= 4;
    if !(letters >= MIN_LETTERS || is_long_text || is_short_text) || printable_bytes * 10 < bytes.len() * 9 {
        return None;
    }
    let text = String::from_utf8_lossy(bytes).trim_end_matches(['\0', ' ']).to_owned();
    Some(TextRun { address: run[0].0, count: run.len() as u16, text, swapped: is_swapped })
}

/// How little the bytes look like a text: counts changes between capitals, small letters, digits and other characters,
/// and zeros before the end.
fn disorder(bytes: &[u8]) -> usize {
    let class = |byte: u8| match byte {
        b'A'..=b'Z' => 1,
        b'a'..=b'z' => 2,
        b'0'..=b'9' => 3,
        0 => 4,
        b' ' => 5,
        _ => 6,
    };
    let changes = bytes.windows(2).filter(|pair| class(pair[0]) != class(pair[1]) && (class(pair[0]), class(pair[1])) != (1, 2));
    let early_zeros = bytes.windows(2).filter(|pair| pair[0] == 0 && pair[1] != 0).count();
    changes.count() + 8 * early_zeros
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(text: &[u8]) -> Option<(String, bool)> {
        let words = text.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]]));
        let constant = words.enumerate().map(|(i, word)| (10 + i as u16, word)).collect();
        runs(&constant).pop().map(|run| (run.text, run.swapped))
    }

    #[test]
    fn texts_in_either_order() {
        assert_eq!(run(b"Pump-4711A\0"), None.or(Some(("Pump-4711A".into(), false))));
        assert_eq!(run(b"uPpm4-17A1\0B"), Some(("Pump-4711AB".into(), true)));
        assert_eq!(run(&[0, 200, 3, 232, 0x30, 0x39]), None);
    }
}
