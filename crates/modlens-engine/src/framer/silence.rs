//! The textbook rule: a frame ends where the line is silent for t3.5, and nowhere else (serial line specification,
//! 2.5.1.1).
//!
//! For exact clocks and for teaching. Adapters that hold bytes back, masters that leave no gap and devices that pause
//! inside a frame all break it; `rtu` is what goes by evidence.

use crate::framer::{Context, Cut, Framer, NOISE_LIMIT};
use crate::input::Input;
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::direction::{judge, Direction};
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// Unit, function code and checksum.
const SHORTEST: usize = 4;

/// The two silences of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rule {
    /// The shortest silence between frames.
    pub t35_ns: Ns,
    /// The longest one inside a frame; a longer one is a finding.
    pub t15_ns: Ns,
}

/// The framer of an RTU line that goes by the rule.
#[derive(Clone, Copy, Debug)]
pub struct Silence {
    rule: Rule,
}

impl Silence {
    /// A framer with these silences.
    pub fn new(rule: Rule) -> Self {
        Self { rule }
    }

    fn end(&self, input: &Input) -> Option<(usize, CutBy)> {
        let there = input.bytes().len().min(NOISE_LIMIT);
        match input.edge_after(0, there, self.rule.t35_ns) {
            Some(end) if input.read(end).is_some_and(|read| read.record) => Some((end, CutBy::Record)),
            Some(end) => Some((end, CutBy::Silence)),
            None if there == NOISE_LIMIT => Some((there, CutBy::Limit)),
            None if input.closed => Some((there, if input.ended { CutBy::End } else { CutBy::Silence })),
            None => None,
        }
    }
}

impl Framer for Silence {
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        adu.clear();
        if input.bytes().is_empty() {
            return None;
        }
        let (length, cut_by) = self.end(input)?;
        let bytes = &input.bytes()[..length];
        if length < SHORTEST || cut_by == CutBy::Limit {
            return Some(Cut::noise(length, cut_by));
        }
        let whole = input.read(0).is_some_and(|read| read.no_checksum);
        adu.extend_from_slice(if whole { bytes } else { &bytes[..length - 2] });
        let verdict = match crc_valid(bytes) {
            _ if whole => Verdict::NoChecksum,
            true => Verdict::Ok,
            false => Verdict::BadChecksum,
        };
        let direction = if verdict.good() {
            let pause = (context.pause)(input.pause_before(0));
            judge(context.functions, context.asked, adu[0], &adu[1..], context.said_at(input, 0), pause)
        } else {
            Direction::Unknown
        };
        // Sixteen bits of checksum, and nothing else was weighed.
        Some(Cut { verdict, direction, confidence: 16, ..Cut::noise(length, cut_by) })
    }

    fn mode(&self) -> Mode {
        Mode::Rtu
    }

    fn break_ns(&self, _line: Option<&LineSettings>) -> Ns {
        self.rule.t35_ns
    }
}
