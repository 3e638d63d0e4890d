//! The short way of a line that looks like nearly all lines of a log in plain hex: who sent it and when, if it says so, and a
//! whole frame as pairs of digits with a blank between them, to the end of the line.
//!
//! The general way is the oracle: what it would decide of such a line is known without it, so the entries are the same (see
//! the test below). That depends on what it has found in the lines before, which is looked at whenever it has read one.

use std::sync::Arc;

use memchr::memchr;

use crate::text::dialect::Dialect;
use crate::text::encapsulation::V5_START;
use crate::text::frame_evidence::check_first;
use crate::text::notation::spaced_pairs;
use crate::text::prefix::parse_prefix;
use crate::text::reader::{proved_lines, NextLine, Reader};

/// A longer line is no regular one: no frame has so many bytes.
const MAX_LINE_CHARS: usize = 1024;

impl Reader {
    /// Whether the next line may be a regular one, now that `row` has read one in the general way: the row has no other rule,
    /// and it would read the next line as well, because nothing that was found before concerns that line.
    pub(super) fn may_expect_regular_lines(&self, row: &Arc<Dialect>) -> bool {
        row.is_plain_hex
            && self.dialects.first().is_some_and(|first| Arc::ptr_eq(first, row))
            && self.dialects.iter().all(|row| !row.has_deltas)
            && self.voices.last == Some(Arc::as_ptr(row).addr() as u64)
            && self.unread.is_empty()
            && self.label.is_none()
            && !self.is_quoted_mail
            && !self.is_continued
            && self.assembler.expects_nothing()
    }

    /// Reads the next line of the buffer if it is a regular one; changes nothing if it is not.
    pub(super) fn read_regular_line(&mut self) -> NextLine {
        let rest = &self.buffer[self.at..];
        let Some(end) = memchr(b'\n', &rest[..rest.len().min(MAX_LINE_CHARS)]) else { return NextLine::Irregular };
        let line = rest[..end].strip_suffix(b"\r").unwrap_or(&rest[..end]);
        if line.first().is_none_or(u8::is_ascii_whitespace) {
            return NextLine::Irregular;
        }
        let saved_state = self.timestamps.state;
        let (time, side, first) = if let Some((time, first)) = self.timestamps.leading_seconds(line) {
            (Some(time), None, first)
        } else {
            let (time, side, behind) = parse_prefix(line, &mut self.timestamps);
            (time, side, line.len() - behind.len())
        };
        let framing = spaced_pairs(&line[first..], &mut self.frame[..]).and_then(|length| {
            // Where a line says neither when nor who, or its bytes are no frame, other frames may be looked for in it.
            let may_lack_something = time.is_none() && side.is_none() && proved_lines::is_long(line, 4, length);
            let (is_whole_frame, framing) = check_first(&self.frame[..], length);
            let is_regular = is_whole_frame && !may_lack_something && self.frame[0] != V5_START;
            is_regular.then_some((length, framing))
        });
        let Some((length, framing)) = framing else {
            self.timestamps.state = saved_state;
            return NextLine::Irregular;
        };
        self.at += end + 1;
        self.number += 1;
        self.assembler.number = self.number;
        self.frame_length = length;
        let entry = self.assembler.take_frame(&self.frame[..length], framing, (time, side), &self.timestamps);
        self.voices.note(self.voices.last);
        if self.may_be_quoted() {
            self.prose.remember(&self.frame[..length]);
        }
        entry.map_or(NextLine::Printed, NextLine::Entry)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use modlens_protocol::checksum::crc16;
    use modlens_protocol::hex::hex;
    use proptest::prelude::*;

    use crate::text::reader::Reader;
    use crate::text::Dialects;

    /// Frames of RTU, one of them as Modbus/TCP, a damaged one, bytes that are none, and one that begins as Solarman V5 does.
    fn frame(kind: usize) -> Vec<u8> {
        let with_crc = |adu: &[u8]| [adu, &crc16(adu).to_le_bytes()].concat();
        match kind {
            0 => with_crc(&[1, 3, 0, 0, 0, 10]),
            1 => with_crc(&[&[1, 3, 20][..], &[7; 20]].concat()),
            2 => with_crc(&[1, 0x83, 2]),
            3 => with_crc(&[1, 6, 0, 1, 0, 3]),
            4 => vec![0, 1, 0, 0, 0, 6, 1, 6, 0, 1, 0, 3],
            5 => vec![1, 3, 0, 0, 0, 10, 0, 0],
            6 => vec![0x55],
            7 => with_crc(&[0xA5, 3, 0, 0, 0, 10]),
            _ => with_crc(&[&[1, 3, 250][..], &[9; 250]].concat()),
        }
    }

    /// Bytes as text: as regular lines have them, or otherwise.
    fn digits(bytes: &[u8], how: usize) -> String {
        let pairs: Vec<String> = bytes.iter().map(|byte| hex(&[*byte])).collect();
        match how {
            0..5 => pairs.join(" "),
            5 => pairs.join(" ").to_uppercase(),
            6 => pairs.concat(),
            7 => pairs.join("  "),
            8 => pairs.join(" ") + " ",
            _ => pairs.join(" ") + "  # and a word",
        }
    }

    /// What is in front of the bytes of line `at`.
    fn front(kind: usize, at: usize) -> String {
        match kind {
            0..3 => format!("{}.{:06} ", 1_697_041_234 + at / 4, at * 1234 % 1_000_000),
            3 => format!("{at}.5 "),
            4 => format!("12345678901.{at} "),
            5 => format!("2026-11-21 12:30:{:02}.{:03} ", at % 60, at),
            6 => format!("12:30:{:02} Rx: ", at % 60),
            7 => format!("[12:30:{:02}] >> ", at % 60),
            8 => format!(" {at}.25 "),
            9 => format!("{at}.250 Tx "),
            10 => String::from("---------------------- "),
            _ => String::new(),
        }
    }

    /// All that the reader gives for a text that comes in blocks of this size.
    fn read(text: &str, rows: &str, is_general: bool, piece: usize) -> Vec<String> {
        let table = Arc::new(Dialects::embedded().clone());
        let mut reader = Reader::new(table.named(rows).unwrap(), Some(table), Arc::default());
        reader.is_general = is_general;
        reader.look_ahead(text.as_bytes());
        let mut all = Vec::new();
        for (at, part) in text.as_bytes().chunks(piece).enumerate() {
            reader.push(part);
            let is_last = (at + 1) * piece >= text.len();
            while let Some((entry, bytes)) = reader.next(is_last) {
                all.push(format!("{entry:?} {bytes:?}"));
                let unread = reader.unread_lines();
                all.push(format!("{:?} {:?} {}", reader.resolution(), unread, reader.lines()));
            }
        }
        let names: Vec<&str> = reader.dialects().iter().map(|row| row.name.as_str()).collect();
        all.push(format!("{names:?} {:?} {:?} {}", reader.skipped(), reader.clock_kind(), reader.records()));
        all
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 600, ..ProptestConfig::default() })]

        #[test]
        fn regular_lines_are_read_as_the_general_way_reads_them(
            lines in prop::collection::vec((0usize..14, 0usize..12, 0usize..10, 0usize..40), 1..40),
            usual in 0usize..12,
            piece in 1usize..300,
        ) {
            let mut text = String::new();
            for (at, (kind, start, how, other)) in lines.into_iter().enumerate() {
                // Most lines look like the one before, or nothing would be regular.
                let start = if other < 30 { usual } else { start };
                match other {
                    32 => text += "what comes back should be:",
                    33 => text += &["can it be that the second one (", &digits(&frame(kind), 0), ") is the answer to this line"].concat(),
                    35 => text += "\n",
                    36 => text += "a line of words: cache holds 7 of 4096 entries",
                    37 => text += "# a comment",
                    38 => text += "[01][03][00][00][00][0A][C5][CD]",
                    39 => text += "\u{1b}[0;36m01 03 00 00 00 0a c5 cd\u{1b}[0m",
                    _ => text += &(front(start, at) + &digits(&frame(kind), how)),
                }
                text += if other == 34 { "\r\n" } else { "\n" };
            }
            for rows in ["hex", "hex+proved"] {
                prop_assert_eq!(read(&text, rows, false, piece), read(&text, rows, true, text.len()), "{}", rows);
            }
        }
    }

    /// Lines of plain hex with times.
    fn plain_lines(count: usize) -> String {
        (0..count).map(|at| front(0, at) + &digits(&frame(at % 4), 0) + "\n").collect()
    }

    /// How many lines of a text in plain hex are regular.
    fn regular_lines(text: &str) -> usize {
        let mut reader = Reader::new(Dialects::embedded().named("hex").unwrap(), None, Arc::default());
        reader.push(text.as_bytes());
        let mut regular = 0;
        while let Some(entry) = reader.advance(true) {
            regular += usize::from(reader.frame_length > 0);
            assert!(entry.time.is_some());
        }
        regular
    }

    #[test]
    fn most_lines_of_plain_hex_are_regular() {
        assert_eq!(regular_lines(&plain_lines(100)), 99);
    }

    #[test]
    fn lines_are_regular_again_where_a_text_is_a_log_whatever_was_announced() {
        let text = plain_lines(1) + "what comes back should be:\n" + &plain_lines(998);
        // Lines 3 to 500 are left out as announced.
        assert_eq!(regular_lines(&text), 500);
    }
}
