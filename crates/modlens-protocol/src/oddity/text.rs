//! Bytes that are characters: text of other protocols, and Modbus ASCII.

use crate::checksum::lrc;
use crate::functions::{Functions, EXCEPTION_BIT};
use crate::hex::parse_hex;

/// Openings of protocols in which text and numbers are mixed.
const OPENINGS: [&[u8]; 6] = [b"FINS", b"HTTP", b"GET ", b"POST", b"SSH-", b"AT+"];

/// Fewer letters say nothing.
pub(super) const LEAST_LETTERS: usize = 6;

/// Unit, function and LRC.
const LEAST_BYTES: usize = 3;

/// Whether these are a colon and hex digits, as a frame of Modbus ASCII is sent, whole or not.
fn is_ascii(characters: &[u8]) -> bool {
    characters.strip_prefix(b":").is_some_and(|digits| digits.trim_ascii_end().iter().all(u8::is_ascii_hexdigit))
}

/// The checksum of a frame of Modbus ASCII, and the one that belongs to it, where the two differ.
pub(super) fn wrong_lrc(characters: &[u8]) -> Option<[u8; 2]> {
    let digits = Some(characters).filter(|characters| is_ascii(characters))?[1..].trim_ascii_end();
    let bytes = parse_hex(std::str::from_utf8(digits).ok()?)?;
    let is_known = |bytes: &[u8]| Functions::embedded().name(bytes[1] & !EXCEPTION_BIT).is_some();
    let (there, body) = bytes.split_last().filter(|_| bytes.len() >= LEAST_BYTES && is_known(&bytes))?;
    // With its LRC, the sum of a frame is 0.
    let due = lrc(body);
    (*there != due).then_some([*there, due])
}

/// Whether bytes are text, or begin as protocols do that mix it with numbers.
pub fn is_text(bytes: &[u8]) -> bool {
    let printable = bytes.iter().filter(|byte| matches!(byte, b' '..=b'~' | b'\r' | b'\n')).count();
    // Registers are often printable by chance, and then mostly signs.
    let letters = bytes.iter().filter(|byte| byte.is_ascii_alphanumeric()).count();
    let are_letters = letters * 2 > bytes.len() && bytes.len() >= LEAST_LETTERS && printable * 5 >= bytes.len() * 4;
    are_letters && !is_ascii(bytes) || OPENINGS.iter().any(|opening| bytes.starts_with(opening))
}

/// The beginning of a text, for a sentence.
pub fn opening(bytes: &[u8]) -> String {
    let printable = bytes.trim_ascii_start().iter().take_while(|byte| matches!(byte, b' '..=b'~')).take(20);
    printable.map(|byte| char::from(*byte)).collect::<String>().trim_end().to_owned()
}
