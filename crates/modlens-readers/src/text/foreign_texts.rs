//! Recognises texts that hold hex and are no recording of Modbus by how their lines are built.

use crate::text::proved::hex_bytes;
use modlens_protocol::hex::parse_hex;

/// What such a file is, in words.
pub(super) const INTEL_HEX: &str = "Intel HEX, a file for memory: a colon, a length, an address, a type and a sum in each line";

/// So many lines are looked at.
const MOST_LINES: usize = 500;

/// Fewer lines of a kind may be something else.
const LEAST_LINES: usize = 2;

/// A record of Intel HEX has a length, two bytes of an address, a type and a sum besides its data.
const RECORD_BYTES: usize = 5;
const MOST_TYPE: u8 = 5;
const END_OF_FILE: [u8; 5] = [0, 0, 0, 1, 0xFF];

fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(|&b| b == b'\n').map(<[u8]>::trim_ascii).filter(|line| !line.is_empty()).take(MOST_LINES)
}

/// Whether the lines with a colon in front are records of Intel HEX, and not frames of Modbus ASCII, which have the same checksum: each
/// begins with the number of its data, and the last one has none, or the address of one counts on from the one before.
pub(super) fn is_intel_hex(text: &[u8]) -> bool {
    let digits = |line: &[u8]| line.strip_prefix(b":").map(<[u8]>::to_vec);
    let marked: Vec<Vec<u8>> = lines(text).filter_map(digits).collect();
    let records: Vec<Vec<u8>> = marked.iter().filter_map(|digits| record(digits)).collect();
    let counts_on = |two: &[Vec<u8>]| {
        let address = |record: &[u8]| u16::from_be_bytes([record[1], record[2]]);
        two[0][0] > 0 && address(&two[0]).wrapping_add(two[0][0].into()) == address(&two[1])
    };
    let is_file = records.last().is_some_and(|last| *last == END_OF_FILE) || records.windows(2).any(counts_on);
    records.len() >= LEAST_LINES && records.len() == marked.len() && is_file
}

/// The bytes of a record.
fn record(digits: &[u8]) -> Option<Vec<u8>> {
    let bytes = std::str::from_utf8(digits).ok().and_then(parse_hex)?;
    let is_record = bytes.len() >= RECORD_BYTES
        && usize::from(bytes[0]) + RECORD_BYTES == bytes.len()
        && bytes[3] <= MOST_TYPE
        && bytes.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)) == 0;
    is_record.then_some(bytes)
}

/// A sentence for a text that prints frames of CAN as `candump` does; `None` for another text.
pub(super) fn of_can(text: &[u8]) -> Option<String> {
    let with_hex = lines(text).filter(|line| hex_bytes(line) > 0).count();
    let frames = lines(text).filter(|line| is_can_frame(line)).count();
    (frames >= LEAST_LINES && 2 * frames >= with_hex)
        .then(|| format!("it looks like frames of a CAN bus: an identifier, a length in brackets and data in {frames} lines"))
}

/// The digits of an identifier, standard and extended.
const IDENTIFIERS: [usize; 2] = [3, 8];

/// Whether a line is an interface, an identifier, a length in brackets and as many bytes: `can0  18FF50E5   [8]  01 02 ..`.
fn is_can_frame(line: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(line) else { return false };
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    let Some(at) = words.iter().position(|word| word.starts_with('[') && word.ends_with(']')) else { return false };
    let length = words[at].trim_matches(['[', ']']).parse::<usize>().ok();
    let is_hex = |word: &str| word.bytes().all(|b| b.is_ascii_hexdigit());
    let is_identifier = at > 1 && IDENTIFIERS.contains(&words[at - 1].len()) && is_hex(words[at - 1]);
    let data = words[at + 1..].iter().take_while(|word| word.len() == 2 && is_hex(word)).count();
    is_identifier && length == Some(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_for_memory_are_no_modbus_ascii() {
        // The sums make each line 0: 04 00 10 00 01 02 03 04 has E2.
        assert!(!is_intel_hex(b":0400100001020304E2\n:040014000506070"));
        assert!(is_intel_hex(b"my firmware:\n:0400100001020304E2\n:00000001FF\n"));
        assert!(is_intel_hex(b":0400100001020304E2\n:0400140005060708CE\n"));
        // A request to unit 2 is a record as well, but its answer is none: 02 03 04 00 00 00 00 has the LRC F7.
        assert!(record(b"02030000000AF1").is_some());
        assert!(!is_intel_hex(b":02030000000AF1\n:02030400000000F7\n"));
        assert!(!is_intel_hex(b":02030000000AF1\n:02030000000AF1\n"));
    }

    #[test]
    fn frames_of_can_are_known_by_their_length() {
        let said = of_can(b"  can0  18FF50E5   [8]  01 03 10 27 C4 09 00 00\n  can0  123   [2]  01 03\n");
        assert!(said.is_some_and(|said| said.contains("CAN bus")));
        assert_eq!(of_can(b"can0  123   [3]  01 03\ncan0  123   [8]  01 03\n"), None);
        assert_eq!(of_can(b"[8] 01 03 00 00 00 02 C4 0B\n[8] 01 03 00 00 00 02 C4 0B\n"), None);
    }
}
