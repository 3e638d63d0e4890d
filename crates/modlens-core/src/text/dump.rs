//! `hexdump -C` and `xxd`: an offset, bytes, their characters.

use crate::text::{Line, Record};

/// Which of the two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// `00000000  11 03 .. |..|`, with `*` for repeated lines.
    Hexdump,
    /// `00000000: 1103 ..  ..`
    Xxd,
}

/// State from line to line.
#[derive(Debug, Default)]
pub struct Dump {
    /// The offset that the next line should have.
    expected: Option<u64>,
    last: Vec<u8>,
    repeat: bool,
}

/// A star stands for as many lines as the offsets say; more than this is a broken file.
const REPEAT_LIMIT: u64 = 1 << 28;

impl Dump {
    /// Parses a line; its bytes go to `out`.
    pub fn parse(&mut self, line: &[u8], style: Style, out: &mut Vec<u8>) -> Line {
        let line = line.trim_ascii();
        if line == b"*" {
            self.repeat = true;
            return Line::Nothing;
        }
        let digits = line.iter().take_while(|b| b.is_ascii_hexdigit()).count();
        let offset = std::str::from_utf8(&line[..digits]).ok().filter(|_| (8..=16).contains(&digits));
        let Some(offset) = offset.and_then(|text| u64::from_str_radix(text, 16).ok()) else { return Line::Unparsed };
        let rest = &line[digits..];
        let body = match style {
            Style::Xxd => match rest.strip_prefix(b": ") {
                Some(body) => characters_off(body),
                None => return Line::Unparsed,
            },
            // Two blanks: a line of bytes without separators must not lose its first ones as an offset.
            Style::Hexdump if !rest.is_empty() && !rest.starts_with(b"  ") => return Line::Unparsed,
            Style::Hexdump => rest.split(|&b| b == b'|').next().unwrap_or(rest),
        };
        let mut record = Record { record: offset == 0, ..Record::default() };
        if self.repeat {
            self.fill(offset, out);
        } else {
            record.hole = self.expected.is_some_and(|expected| offset != 0 && expected != offset);
        }
        self.repeat = false;
        let before = out.len();
        if !body.trim_ascii().is_empty() && !hex(body, out) {
            out.clear();
            return Line::Unparsed;
        }
        self.last = out[before..].to_vec();
        self.expected = Some(offset + (out.len() - before) as u64);
        if out.is_empty() {
            Line::Nothing
        } else {
            Line::Bytes(record)
        }
    }

    fn fill(&self, offset: u64, out: &mut Vec<u8>) {
        let missing = self.expected.map_or(0, |expected| offset.saturating_sub(expected)).min(REPEAT_LIMIT);
        out.extend(self.last.iter().copied().cycle().take(if self.last.is_empty() { 0 } else { missing as usize }));
    }
}

/// xxd sets the characters off by two blanks; they may look like hex.
fn characters_off(body: &[u8]) -> &[u8] {
    let end = body.windows(2).position(|pair| pair == b"  ").unwrap_or(body.len());
    &body[..end]
}

fn hex(text: &[u8], out: &mut Vec<u8>) -> bool {
    text.split(u8::is_ascii_whitespace).filter(|token| !token.is_empty()).all(|token| {
        token.len() % 2 == 0
            && token.chunks_exact(2).all(|pair| {
                let digit = |b: u8| (b as char).to_digit(16).map(|d| d as u8);
                digit(pair[0]).zip(digit(pair[1])).map(|(high, low)| out.push(high << 4 | low)).is_some()
            })
    })
}
