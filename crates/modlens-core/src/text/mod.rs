//! Recordings in text: lines in, bytes with times out. Knows nothing of Modbus but its checksum.
//!
//! A line that is no record is counted, and the first three are kept; nothing is dropped in silence.

pub mod detect;
mod dump;
mod hex;
mod log;
mod stamp;

use memchr::memchr;

use crate::chunk::Side;
use crate::records::Clock;
use crate::Ns;

/// The forms of text that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Hex bytes in lines, maybe behind a time and a word of direction.
    Hex,
    /// `hexdump -C`.
    Hexdump,
    /// `xxd`.
    Xxd,
    /// The chunk log of records.md.
    Chunks,
}

impl Format {
    /// All of them, with their names and a sample line each.
    pub const ALL: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Hex, "hex", "12:30:05.250 Tx: 11 03 00 6B 00 03 76 87"),
        (Self::Hexdump, "hexdump", "00000000  11 03 00 6b 00 03 76 87                           |...k..v.|"),
        (Self::Xxd, "xxd", "00000000: 1103 006b 0003 7687                      ...k..v."),
        (Self::Chunks, "chunks", "{\"t\": 1697041234.123456, \"hex\": \"1103006b00037687\"}"),
    ];

    /// The format of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, known, _)| *known == name).map(|(format, ..)| *format)
    }
}

/// What one line said.
#[derive(Clone, Copy, Debug, Default)]
pub struct Record {
    /// When.
    pub time: Option<Ns>,
    /// Who.
    pub side: Option<Side>,
    /// Which line of a two-line tap.
    pub line: u8,
    /// A frame is not expected to reach across its start.
    pub record: bool,
    /// Bytes are missing before it.
    pub hole: bool,
    /// Line number in the file, from 1.
    pub number: u64,
    /// The clock, as far as the lines up to this one have shown it.
    pub clock: Clock,
}

/// What a line is.
enum Line {
    /// Bytes, in the reader's buffer.
    Bytes(Record),
    /// A comment, a blank line, a mark of the format.
    Nothing,
    /// Not understood.
    Unparsed,
}

/// Unparsed lines that are kept to be shown.
const SHOWN: usize = 3;

/// Characters of an unparsed line that are kept.
const SHOWN_LENGTH: usize = 120;

/// A line longer than this is given up: it is no text.
const LONGEST_LINE: usize = 1 << 24;

/// Reads the text of one recording, in pieces of any size.
#[derive(Debug)]
pub struct Reader {
    format: Format,
    buffer: Vec<u8>,
    at: usize,
    number: u64,
    /// The bytes of the current record.
    bytes: Vec<u8>,
    stamps: stamp::Stamps,
    dump: dump::Dump,
    closed_line: bool,
    /// Records found.
    pub records: u64,
    /// Lines not understood.
    pub unparsed: u64,
    /// The first of them.
    pub first_unparsed: Vec<(u64, String)>,
}

impl Reader {
    /// A reader for this format.
    pub fn new(format: Format) -> Self {
        Self {
            format,
            buffer: Vec::new(),
            at: 0,
            number: 0,
            bytes: Vec::new(),
            stamps: stamp::Stamps::default(),
            dump: dump::Dump::default(),
            closed_line: true,
            records: 0,
            unparsed: 0,
            first_unparsed: Vec::new(),
        }
    }

    /// Takes more text.
    pub fn push(&mut self, data: &[u8]) {
        if self.at > 0 {
            self.buffer.drain(..self.at);
            self.at = 0;
        }
        self.buffer.extend_from_slice(data);
    }

    /// The next record and its bytes; with `last`, a line without line end is one, too.
    pub fn next(&mut self, last: bool) -> Option<(Record, &[u8])> {
        loop {
            let rest = &self.buffer[self.at..];
            let (length, skip) = match memchr(b'\n', rest) {
                Some(end) => (end, end + 1),
                None if rest.is_empty() || !(last || rest.len() > LONGEST_LINE) => return None,
                None => (rest.len(), rest.len()),
            };
            self.number += 1;
            let start = self.at;
            self.at += skip;
            let line = self.buffer[start..start + length].to_vec();
            let line = line.strip_suffix(b"\r").unwrap_or(&line);
            let line = if self.number == 1 { line.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(line) } else { line };
            self.bytes.clear();
            match self.parse(line) {
                Line::Bytes(record) => {
                    self.records += 1;
                    let record = Record { number: self.number, clock: self.stamps.clock(), ..record };
                    return Some((record, &self.bytes));
                }
                Line::Nothing => {}
                Line::Unparsed => self.note_unparsed(line),
            }
        }
    }

    fn parse(&mut self, line: &[u8]) -> Line {
        if line.iter().all(u8::is_ascii_whitespace) {
            return Line::Nothing;
        }
        match self.format {
            Format::Hex => {
                let parsed = hex::parse(line, &mut self.stamps, &mut self.bytes);
                self.mark_records(parsed)
            }
            Format::Hexdump => self.dump.parse(line, dump::Style::Hexdump, &mut self.bytes),
            Format::Xxd => self.dump.parse(line, dump::Style::Xxd, &mut self.bytes),
            Format::Chunks => log::parse(line, &mut self.stamps, &mut self.bytes),
        }
    }

    /// Lines of plain hex may be frames, or one long stream that was wrapped. A line whose checksum closes is a frame;
    /// so a record begins with it, and another one behind it. Lines with a time or a direction are always records.
    fn mark_records(&mut self, parsed: Line) -> Line {
        let Line::Bytes(mut record) = parsed else { return parsed };
        let closes = crate::checksum::crc_valid(&self.bytes) || record.time.is_some() || record.side.is_some();
        record.record = closes || self.closed_line;
        self.closed_line = closes;
        Line::Bytes(record)
    }

    fn note_unparsed(&mut self, line: &[u8]) {
        self.unparsed += 1;
        if self.first_unparsed.len() < SHOWN {
            let text: String = String::from_utf8_lossy(line).chars().take(SHOWN_LENGTH).collect();
            self.first_unparsed.push((self.number, text));
        }
    }

    /// Lines so far.
    pub fn lines(&self) -> u64 {
        self.number
    }

    /// The clock, as far as the lines have shown it.
    pub fn clock(&self) -> Clock {
        self.stamps.clock()
    }

    /// The smallest difference that the stamps can express.
    pub fn resolution(&self) -> Option<Ns> {
        self.stamps.resolution()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(format: Format, text: &str, piece: usize) -> (Vec<(Record, Vec<u8>)>, u64) {
        let mut reader = Reader::new(format);
        let mut records = Vec::new();
        for part in text.as_bytes().chunks(piece) {
            reader.push(part);
            while let Some((record, bytes)) = reader.next(false) {
                records.push((record, bytes.to_vec()));
            }
        }
        while let Some((record, bytes)) = reader.next(true) {
            records.push((record, bytes.to_vec()));
        }
        (records, reader.unparsed)
    }

    const FRAME: [u8; 8] = [0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87];

    #[test]
    fn spellings_of_hex() {
        for text in [
            "11 03 00 6B 00 03 76 87",
            "1103006b00037687",
            "11:03:00:6b:00:03:76:87",
            "11-03-00-6B-00-03-76-87",
            "11,03,00,6B,00,03,76,87",
            "0x11 0x03 0x00 0x6b 0x00 0x03 0x76 0x87",
            "0x11, 0x3, 0x0, 0x6b, 0x0, 0x3, 0x76, 0x87",
            "[0x11, 0x03, 0x00, 0x6b, 0x00, 0x03, 0x76, 0x87]",
            "Tx: 11 03 00 6B 00 03 76 87",
            "12:30:05.250 TX 11 03 00 6B 00 03 76 87",
            "[12:30:05.250] >> 11 03 00 6B 00 03 76 87",
            "2023-10-11 16:20:34.123 Rx 11 03 00 6B 00 03 76 87",
            "1697041234.123456: 11 03 00 6B 00 03 76 87",
            "\u{feff}11 03 00 6B 00 03 76 87\r",
        ] {
            for piece in [1, 7, 1000] {
                let (records, unparsed) = read(Format::Hex, text, piece);
                assert_eq!((records.len(), unparsed), (1, 0), "{text}");
                assert_eq!(records[0].1, FRAME, "{text}");
            }
        }
    }

    #[test]
    fn samples_of_all_formats() {
        for (format, name, sample) in Format::ALL {
            let (records, unparsed) = read(*format, sample, 5);
            assert_eq!((records.len(), unparsed), (1, 0), "{name}");
            assert_eq!(records[0].1, FRAME, "{name}");
        }
    }

    #[test]
    fn what_is_not_hex_is_counted() {
        let (records, unparsed) = read(Format::Hex, "hello world\n# a comment\n\n11 03 00 6B\nabc\n", 3);
        assert_eq!((records.len(), unparsed), (1, 2));
        assert_eq!(records[0].0.number, 4);
    }

    #[test]
    fn a_star_repeats_the_line_before() {
        let text = "00000000  00 01 02 03 04 05 06 07  08 09 0a 0b 0c 0d 0e 0f  |................|\n*\n00000030  aa bb  |..|\n00000032\n";
        let (records, unparsed) = read(Format::Hexdump, text, 9);
        let all: Vec<u8> = records.into_iter().flat_map(|(_, bytes)| bytes).collect();
        assert_eq!((all.len(), unparsed), (50, 0));
        assert_eq!(all[32..36], [0, 1, 2, 3]);
        assert_eq!(all[48..], [0xAA, 0xBB]);
    }

    #[test]
    fn times_are_exact() {
        let (records, _) = read(Format::Chunks, "{\"t\": 1697041234.123456789, \"hex\": \"01\"}\n{\"t\": 0.5, \"hex\": \"01\", \"line\": \"B\"}\n{\"t\": null, \"hex\": \"01\"}", 11);
        let seen: Vec<_> = records.iter().map(|(record, _)| (record.time, record.line)).collect();
        assert_eq!(seen, [(Some(1_697_041_234_123_456_789), 0), (Some(500_000_000), 2), (None, 0)]);
        let (records, _) = read(Format::Hex, "23:59:59.900 Tx 01 02\n00:00:00.100 Rx 01 02", 100);
        assert_eq!(records[1].0.time.unwrap() - records[0].0.time.unwrap(), 200_000_000);
    }
}
