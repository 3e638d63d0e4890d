//! Which framing is it? Decided once, on the first bytes, by the checksums that fit.
//!
//! The decision is taken at fixed numbers of bytes, at a silence or at the end, so that chunk sizes change nothing.

use crate::checksum::{crc_valid, lrc};
use crate::framer::ascii::Ascii;
use crate::framer::rtu::Rtu;
use crate::framer::silence::{Rule, Silence};
use crate::framer::tcp::{announced, layout_fits, natural, Tcp};
use crate::framer::{Context, Cut, Framer, Mode};
use crate::functions::{Extent, Functions, EXCEPTION_BIT};
use crate::input::Input;
use crate::line::Line;
use crate::Ns;

/// Without a single good frame in so many bytes, the look of the bytes decides.
const ENOUGH: usize = 4096;

/// The first number of bytes worth a look.
const FIRST_LOOK: usize = 8;

/// Waits for evidence, then is the framer it points to.
pub struct Auto {
    line: Option<Line>,
    rule: Option<Rule>,
    next_look: usize,
    chosen: Option<Box<dyn Framer>>,
    /// The framer of records that prove another framing: RTU out and MBAP in are seen in the logs of gateways.
    other: Option<Box<dyn Framer>>,
    /// The last frame was the other one's.
    aside: bool,
}

impl Auto {
    /// A framer for a line with these settings; RTU goes by the rule of silence where there is one.
    pub fn new(line: Option<Line>, rule: Option<Rule>) -> Self {
        Self { line, rule, next_look: FIRST_LOOK, chosen: None, other: None, aside: false }
    }

    fn choose(&mut self, input: &Input, functions: &Functions) -> bool {
        let bytes = input.bytes();
        if let Some(mode) = input.read(0).and_then(|read| read.framing) {
            return self.become_mode(mode);
        }
        if input.read(0).is_some_and(|read| read.no_checksum) && bytes.first() != Some(&b':') {
            self.chosen = Some(make(Mode::Rtu, self.line.as_ref(), self.rule));
            return true;
        }
        while self.next_look <= bytes.len().min(ENOUGH) {
            if let Some(mode) = evidence(functions, &bytes[..self.next_look]) {
                return self.become_mode(mode);
            }
            self.next_look *= 2;
        }
        if !input.closed && bytes.len() < ENOUGH {
            return false;
        }
        let there = &bytes[..bytes.len().min(ENOUGH)];
        let mode = evidence(functions, there).unwrap_or_else(|| looks_like(functions, there));
        self.become_mode(mode)
    }

    /// A record that proves another framing than the chosen one.
    fn strange(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        let read = input.read(0)?;
        let mode = read.framing.filter(|mode| self.chosen.as_ref().is_some_and(|framer| framer.mode() != *mode))?;
        let length = (read.end - input.offset()) as usize;
        if !input.starts_read(0) {
            return None;
        }
        let framer = match &mut self.other {
            Some(framer) if framer.mode() == mode => framer,
            other => other.insert(make(mode, self.line.as_ref(), self.rule)),
        };
        framer.jump(input.offset());
        let cut = framer.next(input, context, adu).filter(|cut| cut.length == length)?;
        self.aside = true;
        if let Some(framer) = &mut self.chosen {
            framer.jump(input.offset() + length as u64);
        }
        Some(cut)
    }

    fn become_mode(&mut self, mode: Mode) -> bool {
        self.chosen = Some(make(mode, self.line.as_ref(), self.rule));
        true
    }
}

/// The framer of a framing; RTU goes by the rule of silence where there is one, else by evidence.
pub fn make(mode: Mode, line: Option<&Line>, rule: Option<Rule>) -> Box<dyn Framer> {
    match (mode, rule) {
        (Mode::Rtu, Some(rule)) => Box::new(Silence::new(rule)),
        (Mode::Rtu, None) => Box::new(Rtu::new(line)),
        (Mode::Ascii, _) => Box::new(Ascii::default()),
        (Mode::Tcp, _) => Box::new(Tcp::default()),
    }
}

/// The framing under which most bytes are in good frames.
pub fn evidence(functions: &Functions, bytes: &[u8]) -> Option<Mode> {
    let scores =
        [(rtu_bytes(functions, bytes), Mode::Rtu), (ascii_bytes(bytes), Mode::Ascii), (tcp_bytes(functions, bytes), Mode::Tcp)];
    // Equal scores: the first, which has the strongest checksum.
    scores.into_iter().rev().max_by_key(|(score, _)| *score).filter(|(score, _)| *score > 0).map(|(_, mode)| mode)
}

/// How many of the bytes are in good frames of a serial line.
pub fn evidence_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    rtu_bytes(functions, bytes).max(ascii_bytes(bytes))
}

/// How many of the bytes are in good RTU frames.
pub fn rtu_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    let mut at = 0;
    let mut good = 0;
    while bytes.len() - at >= 4 {
        let length = rtu_frame(functions, &bytes[at..]);
        good += length;
        at += length.max(1);
    }
    good
}

fn rtu_frame(functions: &Functions, bytes: &[u8]) -> usize {
    let fits = |length: usize| bytes.get(..length + 4).is_some_and(crc_valid);
    let (code, body) = (bytes[1], &bytes[2..]);
    if code & EXCEPTION_BIT != 0 {
        return if bytes[2] != 0 && fits(1) { 5 } else { 0 };
    }
    let Some(row) = functions.row(code, body) else { return 0 };
    [&row.request, &row.response]
        .into_iter()
        .find_map(|layout| match layout.extent(body) {
            Extent::Exactly(length) if fits(length) => Some(length + 4),
            _ => None,
        })
        .unwrap_or(0)
}

fn ascii_bytes(bytes: &[u8]) -> usize {
    let mut good = 0;
    for line in bytes.split_inclusive(|&b| b == b'\n') {
        let Some(colon) = line.iter().rposition(|&b| b == b':') else { continue };
        let text = line[colon + 1..].trim_ascii_end();
        let ended = colon + 1 + text.len() < line.len();
        let hex: Option<Vec<u8>> = std::str::from_utf8(text).ok().and_then(crate::pdu::parse_hex);
        if ended && hex.is_some_and(|hex| hex.len() >= 3 && lrc(&hex) == 0) {
            good += line.len() - colon;
        }
    }
    good
}

fn tcp_bytes(functions: &Functions, bytes: &[u8]) -> usize {
    let mut at = 0;
    while let Some(length) = announced(&bytes[at..]) {
        match bytes.get(at + 7..at + length) {
            Some(pdu) if layout_fits(functions, pdu) => at += length,
            _ => break,
        }
    }
    at
}

/// The framing of bytes without any good frame.
fn looks_like(functions: &Functions, bytes: &[u8]) -> Mode {
    // A header of MBAP whose length lies, before a PDU that is whole by its layout.
    let whole = |length: &usize| *length <= bytes.len();
    let mbap = announced(bytes).is_some() && natural(functions, bytes).iter().flatten().any(whole);
    match (looks_like_text(bytes), mbap) {
        (true, _) => Mode::Ascii,
        (false, true) => Mode::Tcp,
        (false, false) => Mode::Rtu,
    }
}

fn looks_like_text(bytes: &[u8]) -> bool {
    let text = bytes.iter().filter(|b| matches!(b, b'0'..=b'9' | b'A'..=b'F' | b'a'..=b'f' | b':' | b'\r' | b'\n')).count();
    bytes.contains(&b':') && text * 10 >= bytes.len() * 9
}

impl Framer for Auto {
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        if self.chosen.is_none() && (input.bytes().is_empty() || !self.choose(input, context.functions)) {
            return None;
        }
        if let Some(cut) = self.strange(input, context, adu) {
            return Some(cut);
        }
        self.aside = false;
        self.chosen.as_mut()?.next(input, context, adu)
    }

    fn settled(&self, offset: u64) -> bool {
        !self.aside && self.chosen.as_ref().is_some_and(|framer| framer.settled(offset))
    }

    fn routine(&mut self) -> Option<&mut Rtu> {
        self.chosen.as_mut().filter(|_| !self.aside)?.routine()
    }

    fn mode(&self) -> Mode {
        let framer = if self.aside { &self.other } else { &self.chosen };
        framer.as_ref().map_or(Mode::Rtu, |framer| framer.mode())
    }

    fn break_ns(&self, line: Option<&Line>) -> Ns {
        self.chosen.as_ref().map_or_else(|| make(Mode::Rtu, line, self.rule).break_ns(line), |framer| framer.break_ns(line))
    }
}
