//! Framers: where frames begin and end. One per framing, behind one trait.
//!
//! A framer sees the unframed bytes of one line and says what the first of them are. It must say the same for every chunking
//! of the same bytes and times: it decides at bytes, at times of bytes and at the end, never at calls.

pub mod ascii;
pub mod auto;
pub mod fixed;
pub mod line_framer;
pub mod rtu;
pub mod silence;
pub mod tcp;

use crate::damage::kind::DamageKind;
use crate::input::Input;
use modlens_protocol::direction::{Direction, RequestRef, TimeoutLogOdds};
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// A noise row has at most this many bytes.
pub const MAX_NOISE_ROW_BYTES: usize = 4096;

/// A rule of its framing that a frame breaks, although it can be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FramingFault {
    /// An ASCII frame ends with LF instead of CR LF (serial line specification, 2.5.2.1).
    BareLineFeed,
    /// An ASCII frame has hex digits in lower case (serial line specification, 2.5.2).
    LowerCaseHex,
    /// The length in the MBAP header is not that of the PDU (messaging on TCP/IP, 3.1.3).
    MbapLength,
}

/// What the first bytes of the input are: a frame or noise.
#[derive(Clone, Copy, Debug)]
pub struct FrameResult {
    /// How many bytes.
    pub length: usize,
    /// Whether they are a frame, and a sound one.
    pub verdict: Verdict,
    /// The evidence for their end.
    pub delimited_by: DelimitedBy,
    /// Who sent them, where the framer knows.
    pub direction: Direction,
    /// The log2 odds that the row is right, as `confidence` counts them.
    pub confidence: u8,
    /// The CRC is valid, but the frame stands alone in noise, and its unit has not been seen in a paired transaction.
    pub unconfirmed: bool,
    /// Transaction identifier of the MBAP header.
    pub mbap_id: Option<u16>,
    /// A rule of its framing that it breaks.
    pub fault: Option<FramingFault>,
    /// What happened to a frame that did not arrive whole.
    pub damage: Option<DamageKind>,
}

impl FrameResult {
    /// Bytes that belong to no frame.
    pub fn noise(length: usize, delimited_by: DelimitedBy) -> Self {
        Self {
            length,
            verdict: Verdict::Noise,
            delimited_by,
            direction: Direction::Unknown,
            confidence: 0,
            unconfirmed: false,
            mbap_id: None,
            fault: None,
            damage: None,
        }
    }
}

/// What the session knows beside the bytes of this line: evidence for the framer.
#[derive(Clone, Copy)]
pub struct FramerContext<'a> {
    /// The table of functions.
    pub functions: &'a Functions,
    /// The outstanding request.
    pub outstanding_request: Option<RequestRef<'a>>,
    /// The input is a recording: more bytes may be awaited before anything is decided, because nobody waits for the result.
    pub may_look_ahead: bool,
    /// The bus is tapped on two lines: the outstanding request may have come on the other one.
    pub is_multi_line: bool,
    /// The direction that this line carries, where each direction has its own line, as far as it was learned.
    pub line_direction: Option<Direction>,
    /// The direction that this line carries for certain: the side of a TCP connection.
    pub connection_side: Option<Direction>,
    /// Units that took part in a sound frame.
    pub known_units: &'a [bool; 256],
    /// Units that took part in a paired transaction.
    pub paired_units: &'a [bool; 256],
    /// The log-odds of a silence: timeout against response.
    pub timeout_log_odds: &'a dyn Fn(Option<Ns>) -> TimeoutLogOdds,
    /// The direction that a word of the recording means.
    pub declared_direction: &'a dyn Fn(modlens_readers::chunk::Side) -> Direction,
}

impl FramerContext<'_> {
    /// The direction of the frame at this index as the connection, the line or the recording declares it.
    pub fn declared_direction_at(&self, input: &Input, index: usize) -> Option<Direction> {
        let by_recording = || input.read(index).and_then(|read| read.side).map(|side| (self.declared_direction)(side));
        self.connection_side.or(self.line_direction).or_else(by_recording)
    }
}

/// Says what the first unframed bytes are.
pub trait Framer: Send + Sync {
    /// The first frame or noise row, once it is final; `adu` gets the unit and the PDU of a frame in binary.
    ///
    /// `None` means that more bytes, a silence or the end are needed. When `input.is_closed`, no bytes are kept.
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult>;

    /// The framing.
    fn mode(&self) -> Mode;

    /// Skips the bytes before this stream offset: another framer has framed them.
    fn skip_to(&mut self, _offset: u64) {}

    /// Whether nothing is outstanding or undecided, so that the frame at this stream offset is what its own bytes say.
    fn is_settled_at(&self, _offset: u64) -> bool {
        false
    }

    /// The silence that ends every frame, in nanoseconds.
    fn break_ns(&self, line: Option<&LineSettings>) -> Ns;
}
