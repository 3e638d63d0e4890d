//! Which framing is it? Decided once, on the first bytes, by the checksums that fit.
//!
//! The decision is taken at fixed numbers of bytes, at a silence or at the end, so that chunk sizes change nothing.

use crate::framer::fixed::FixedFramer;
use crate::framer::silence::Rule;
use crate::framer::{Context, Cut, Framer};
use crate::input::Input;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::recognize::{evidence, looks_like};
use modlens_protocol::Ns;

/// Without a single good frame in so many bytes, the look of the bytes decides.
const ENOUGH: usize = 4096;

/// The first number of bytes worth a look.
const FIRST_LOOK: usize = 8;

/// Waits for evidence, then is the framer it points to.
pub struct Auto {
    line: Option<LineSettings>,
    rule: Option<Rule>,
    next_look: usize,
    chosen: Option<FixedFramer>,
    /// The framer of records that prove another framing: RTU out and MBAP in are seen in the logs of gateways.
    other: Option<FixedFramer>,
    /// The last frame was the other one's.
    aside: bool,
}

impl Auto {
    /// A framer for a line with these settings; RTU goes by the rule of silence where there is one.
    pub fn new(line: Option<LineSettings>, rule: Option<Rule>) -> Self {
        Self { line, rule, next_look: FIRST_LOOK, chosen: None, other: None, aside: false }
    }

    /// The framer that the next bytes are for, once it is chosen; `None` while a record proves another framing.
    #[inline]
    pub fn active_mut(&mut self) -> Option<&mut FixedFramer> {
        self.chosen.as_mut().filter(|_| !self.aside)
    }

    fn choose(&mut self, input: &Input, functions: &Functions) -> bool {
        let bytes = input.bytes();
        if let Some(mode) = input.read(0).and_then(|read| read.framing) {
            return self.become_mode(mode);
        }
        if input.read(0).is_some_and(|read| read.no_checksum) && bytes.first() != Some(&b':') {
            self.chosen = Some(FixedFramer::new(Mode::Rtu, self.line.as_ref(), self.rule));
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
            other => other.insert(FixedFramer::new(mode, self.line.as_ref(), self.rule)),
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
        self.chosen = Some(FixedFramer::new(mode, self.line.as_ref(), self.rule));
        true
    }
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

    fn mode(&self) -> Mode {
        let framer = if self.aside { &self.other } else { &self.chosen };
        framer.as_ref().map_or(Mode::Rtu, Framer::mode)
    }

    fn break_ns(&self, line: Option<&LineSettings>) -> Ns {
        self.chosen
            .as_ref()
            .map_or_else(|| FixedFramer::new(Mode::Rtu, line, self.rule).break_ns(line), |framer| framer.break_ns(line))
    }
}
