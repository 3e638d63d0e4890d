//! What a framer returns about bytes, and what it knows beside them.

use crate::input::Input;
pub use crate::rtu_model::damage_kind::DamageKind;
use crate::weights;
use modlens_protocol::direction::{Direction, RequestRef, TimeoutLogOdds};
use modlens_protocol::framing::{DelimitedBy, Verdict};
use modlens_protocol::functions::Functions;
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
    /// The CRC is valid, but the frame is alone in noise, and its unit has not been seen in a paired transaction.
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
        Self::new(Verdict::Noise, length, delimited_by)
    }

    /// Bytes with this verdict and evidence for their end, of which nothing else is known.
    pub fn new(verdict: Verdict, length: usize, delimited_by: DelimitedBy) -> Self {
        Self {
            length,
            verdict,
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

/// What the silence before a frame reports about it, as log-odds in bits; 0 without a clock.
#[derive(Clone, Copy, Debug, Default)]
pub struct PauseEvidence {
    /// That the master has given up waiting, against a response.
    pub timeout: TimeoutLogOdds,
    /// That the master begins a new exchange, against a response.
    pub poll: f32,
    /// What a response and a new request cost for coming at once.
    pub too_soon_bits: [f32; 2],
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
    /// The longest silence that is too short to be between two frames, if the clock is fine enough to tell.
    pub immediate_ns: Option<Ns>,
    /// The log-odds of a silence: the master's pause before a new request against response.
    pub poll_log_odds: &'a dyn Fn(Option<Ns>) -> f32,
    /// The direction that a word of the recording means.
    pub declared_direction: &'a dyn Fn(modlens_readers::chunk::Side) -> Direction,
}

impl<'a> FramerContext<'a> {
    /// That of a recording of a single line without a clock, of which these units are known and nothing else.
    pub fn without_clock(functions: &'a Functions, units: &'a [bool; 256]) -> Self {
        Self {
            functions,
            outstanding_request: None,
            may_look_ahead: true,
            is_multi_line: false,
            line_direction: None,
            connection_side: None,
            known_units: units,
            paired_units: units,
            timeout_log_odds: &|_| 0.0,
            immediate_ns: None,
            poll_log_odds: &|_| 0.0,
            declared_direction: &|_| Direction::Unknown,
        }
    }
}

impl FramerContext<'_> {
    /// What a silence reports about the frame after it.
    pub fn pause_evidence(&self, silence: Option<Ns>) -> PauseEvidence {
        PauseEvidence { timeout: (self.timeout_log_odds)(silence), poll: (self.poll_log_odds)(silence), too_soon_bits: [0.0; 2] }
    }

    /// What the silence before the byte at this index reports about a frame that begins there.
    pub fn pause_evidence_at(&self, input: &Input, index: usize) -> PauseEvidence {
        let too_soon_bits = self.too_soon_bits(input, index);
        PauseEvidence { too_soon_bits, ..self.pause_evidence(input.pause_before(index)) }
    }

    /// What a response and a new request cost, in bits, for following the byte before them at once, as far as the clock is fine
    /// enough to tell. An echo comes at once.
    fn too_soon_bits(&self, input: &Input, index: usize) -> [f32; 2] {
        let Some(least) = self.immediate_ns.filter(|_| input.has_times) else { return [0.0; 2] };
        if !input.starts_read(index) {
            return [0.0, weights::TOO_SOON_IN_READ_BITS];
        }
        if input.pause_before(index).is_some_and(|pause| pause < least) {
            [weights::TOO_SOON_FOR_FRAME_BITS; 2]
        } else {
            [0.0; 2]
        }
    }

    /// Whether a frame at this index follows the byte before it too soon for a response, by the clock.
    pub fn comes_at_once(&self, input: &Input, index: usize) -> bool {
        self.too_soon_bits(input, index)[0] > 0.0
    }

    /// The direction of the frame at this index as the connection, the line or the recording declares it.
    pub fn declared_direction_at(&self, input: &Input, index: usize) -> Option<Direction> {
        let by_recording = || input.read(index).and_then(|read| read.side).map(|side| (self.declared_direction)(side));
        self.connection_side.or(self.line_direction).or_else(by_recording)
    }
}
