//! What a text without a proven frame says all the same: what is odd about its bytes, or what the program itself reports.

use crate::text::proved::longest_hex;
use modlens_protocol::oddity::Oddity;

/// Lines that are looked at.
const MOST_LINES: usize = 2000;

/// What programs report, in lower case, with what it means and what to do: exceptions by name and number (application protocol,
/// 7), wrong checksums, timeouts.
const REPORTS: [(&[&str], &str); 9] = [
    (
        &["illegal function", "exception 1", "exception: 1", "exception code 1", "exception code: 1", "exception = 1"],
        "exception 1 (illegal function): the unit does not know the function; try input registers (4) for holding registers (3), or \
         a write by another function",
    ),
    (
        &["illegal data address", "exception 2", "exception: 2", "exception code 2", "exception code: 2", "exception = 2"],
        "exception 2 (illegal data address): the unit does not have the address, or not the whole block; check whether the address \
         counts from 0 or 1, and the function",
    ),
    (
        &["illegal data value", "exception 3", "exception: 3", "exception code 3", "exception code: 3", "exception = 3"],
        "exception 3 (illegal data value): the unit takes neither this quantity nor this value; ask for fewer registers",
    ),
    (
        &["slave device failure", "server device failure", "exception 4", "exception: 4", "exception code 4", "exception code: 4"],
        "exception 4 (device failure): the unit, or a gateway that cannot reach it, has failed",
    ),
    (
        &["target device failed to respond", "exception 11", "exception: 11", "exception code 11", "exception code: 11"],
        "exception 11: the gateway gets no answer of the unit; check its wires, rate and address",
    ),
    (
        &["cleanup recv buffer"],
        "bytes left over before a request: the rest of an answer that came after the client had given up; raise its timeout",
    ),
    (
        &["connection refused", "connection reset", "broken pipe"],
        "a connection that the other side refused or closed: its port and service, and how many clients it takes",
    ),
    (
        &["checksum error", "crc error", "crc check error", "crccheckerror", "crc mismatch", "crcmismatch", "invalid crc", "wrong crc", "crc check failed", "bad crc"],
        "a wrong checksum: bits changed on the line, other line settings, or bytes lost by a program; a recording of the bytes shows which",
    ),
    (
        &["timed out", "timeout", "no response", "no answer"],
        "that no answer came in time: power, wires, rate and address of the unit, and whether anything comes back at all",
    ),
];

/// What the bytes of a text show, or what it reports in words; `None` if neither says anything.
pub(super) fn named(text: &[u8]) -> Option<String> {
    let lines = || text.split(|&byte| byte == b'\n').take(MOST_LINES);
    let odd = lines().enumerate().find_map(|(at, line)| Some((at + 1, Oddity::of(&longest_hex(&without_emphasis(line))?)?)));
    if let Some((number, oddity)) = odd {
        return Some(format!("in line {number} {}", oddity.words()));
    }
    reported(lines())
}

/// What most lines report.
fn reported<'a>(lines: impl Iterator<Item = &'a [u8]>) -> Option<String> {
    let mut counts = [0; REPORTS.len()];
    for line in lines {
        let line = String::from_utf8_lossy(line).to_ascii_lowercase();
        let says = |word: &&str| {
            line.match_indices(*word).any(|(at, _)| !line[at + word.len()..].starts_with(|c: char| c.is_ascii_digit()))
        };
        if let Some(found) = REPORTS.iter().position(|(words, _)| words.iter().any(&says)) {
            counts[found] += 1;
        }
    }
    let (most, times) = counts.iter().enumerate().max_by_key(|(at, count)| (**count, usize::MAX - at))?;
    let lines = if *times == 1 { String::from("a line reports") } else { format!("{times} lines report") };
    (*times > 0).then(|| format!("{lines} {}", REPORTS[most].1))
}

/// A line without the marks by which people emphasize a byte: `00 **06** 31`.
fn without_emphasis(line: &[u8]) -> Vec<u8> {
    line.iter().copied().filter(|byte| !matches!(byte, b'*' | b'_')).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_bytes_come_before_words() {
        let swapped = named(b"what is this?\nRx: 11 03 00 6B 00 03 87 76\n").expect("a reason");
        assert!(swapped.starts_with("in line 2 the checksum is right"), "{swapped}");
        let said = named(b"[W] Modbus error function code: 0x84 exception: 2\n").expect("a reason");
        assert!(said.starts_with("a line reports exception 2 (illegal data address)"), "{said}");
        let digits =
            named(b"data <Buffer 30 31 30 33 30 39 30 31 30 33 30 34 37 46 46 46 46 46 46 46 64 32 36 37 34 63 35 61>\n");
        assert!(digits.is_some_and(|words| words.contains("sent as characters")));
        assert_eq!(named(b"nothing to be seen\n"), None);
        assert_eq!(named(b"exception: 25 of 30\n"), None);
    }
}
