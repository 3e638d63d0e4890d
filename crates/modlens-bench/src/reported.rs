//! What an algorithm says of a case, in neutral words, and the trait that makes algorithms comparable.

use crate::model::{Direction, Labels};
use crate::sim::case::Case;

/// A frame that an algorithm reports. Noise is not reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reported {
    /// Offset of the first byte in its line's stream.
    pub start: u64,
    /// Offset behind the last byte.
    pub end: u64,
    /// Who sent it.
    pub direction: Direction,
    /// Believed to be whole.
    pub crc_ok: bool,
    /// Whole, but not sold as a fact.
    pub tentative: bool,
    /// What request and response share.
    pub txn: Option<u64>,
    /// 0 for the only line; 1 and 2 for the lines A and B of a two-line tap.
    pub line: u8,
    /// Live: when it was reported, in ns of the recording's clock.
    pub t_emit: Option<i64>,
    /// What it says of the frame.
    pub labels: Labels,
}

impl Reported {
    /// A frame without anything said about it.
    pub fn new(line: u8, start: u64, end: u64, crc_ok: bool) -> Self {
        Self {
            start,
            end,
            direction: Direction::Unknown,
            crc_ok,
            tentative: false,
            txn: None,
            line,
            t_emit: None,
            labels: Labels::default(),
        }
    }
}

/// Something that finds frames.
pub trait Algorithm {
    /// Its name in tables.
    fn name(&self) -> &'static str;

    /// The frames of this case.
    fn run(&mut self, case: &Case) -> Vec<Reported>;

    /// Whether times make a difference; where not, one run stands for all tap modes.
    fn uses_times(&self) -> bool {
        true
    }

    /// Whether it can read this case at all.
    fn reads(&self, _case: &Case) -> bool {
        true
    }

    /// Whether it says what people act on.
    fn labels(&self) -> bool {
        false
    }
}
