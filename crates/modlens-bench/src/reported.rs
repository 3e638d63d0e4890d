//! The frames that an algorithm reports, in a form common to all algorithms, and the trait that algorithms implement.

use crate::model::{Direction, Labels};
use crate::sim::case::Case;

/// A frame that an algorithm reports. Noise is not reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReportedFrame {
    /// Offset of the first byte in its line's stream.
    pub start: u64,
    /// Offset after the last byte.
    pub end: u64,
    /// Request or response.
    pub direction: Direction,
    /// The algorithm claims that the frame is whole and undamaged.
    pub is_whole: bool,
    /// The claim is marked as unconfirmed.
    pub unconfirmed: bool,
    /// Stated odds that the report is right, as log2.
    pub confidence: u8,
    /// Number of the transaction, which a request and its response share.
    pub txn: Option<u64>,
    /// 0 for the only line; 1 and 2 for the lines A and B of a two-line tap.
    pub line: u8,
    /// In live runs the time at which it was reported, in ns of the recording's clock.
    pub emitted_ns: Option<i64>,
    /// The labels that the algorithm gives it.
    pub labels: Labels,
    /// What its transaction claims, and how certain it is, in bits: on the response, or on the request without one.
    pub transaction: Option<(TransactionClaim, u8)>,
}

/// What a transaction claims about its request and its response.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TransactionClaim {
    /// This response answers this request.
    Answered,
    /// The request had no response.
    Silent,
    /// This response answers this request, too late.
    Late,
    /// Nobody asked for the response.
    Unasked,
}

impl TransactionClaim {
    /// Its name in tables.
    pub fn text(self) -> &'static str {
        match self {
            Self::Answered => "answered",
            Self::Silent => "no response",
            Self::Late => "late response",
            Self::Unasked => "unsolicited",
        }
    }
}

impl ReportedFrame {
    /// A frame of unknown direction, without transaction and labels.
    pub fn new(line: u8, start: u64, end: u64, is_whole: bool) -> Self {
        Self {
            start,
            end,
            direction: Direction::Unknown,
            is_whole,
            unconfirmed: false,
            confidence: 0,
            txn: None,
            line,
            emitted_ns: None,
            labels: Labels::default(),
            transaction: None,
        }
    }
}

/// Something that finds frames.
pub trait Algorithm {
    /// Its name in tables.
    fn name(&self) -> &'static str;

    /// Finds the frames of a case.
    fn run(&mut self, case: &Case) -> Vec<ReportedFrame>;

    /// Whether the result depends on the times of the reads. If not, one run stands for all tap modes.
    fn uses_times(&self) -> bool {
        true
    }

    /// Whether the algorithm can process this case at all.
    fn reads(&self, _case: &Case) -> bool {
        true
    }

    /// Whether the algorithm gives labels.
    fn labels(&self) -> bool {
        false
    }
}
