//! Framers: where frames begin and end. One per framing, behind one trait.
//!
//! A framer sees the unframed bytes of one line and says what the first of them are. It must say the same for every
//! chunking of the same bytes and times: decision points are bytes, byte times and the end, never calls.

pub mod ascii;
pub mod auto;
pub mod fixed;
pub mod line_framer;
pub mod rtu;
pub mod silence;
pub mod tcp;

use crate::damage::kind::DamageKind;
use crate::input::Input;
use modlens_protocol::direction::{Asked, Direction, Pause};
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

/// A noise row ends after so many bytes at the latest.
pub const NOISE_LIMIT: usize = 4096;

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

/// What the first bytes of the input are.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    /// How many bytes.
    pub length: usize,
    /// What they are worth.
    pub verdict: Verdict,
    /// What ended them.
    pub cut_by: CutBy,
    /// Who sent them, where the framer knows.
    pub direction: Direction,
    /// Bits between this reading and its rival, at most 60.
    pub confidence: u8,
    /// Checksum right, but isolated in noise and from a unit not yet seen in a paired transaction.
    pub tentative: bool,
    /// Transaction identifier of the MBAP header.
    pub mbap_id: Option<u16>,
    /// A rule of its framing that it breaks.
    pub fault: Option<FramingFault>,
    /// What happened to a frame that did not arrive whole.
    pub damage: Option<DamageKind>,
}

impl Cut {
    /// Bytes that are no frame.
    pub fn noise(length: usize, cut_by: CutBy) -> Self {
        Self {
            length,
            verdict: Verdict::Noise,
            cut_by,
            direction: Direction::Unknown,
            confidence: 0,
            tentative: false,
            mbap_id: None,
            fault: None,
            damage: None,
        }
    }
}

/// What the rest of the session knows: evidence for the framer.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// The table.
    pub functions: &'a Functions,
    /// The request that waits for its answer.
    pub asked: Option<Asked<'a>>,
    /// A recording: more bytes may be waited for without keeping anybody waiting.
    pub ahead: bool,
    /// The request may have come on another line than the answer.
    pub shared: bool,
    /// Who speaks on this line, where each side has its own.
    pub speaker: Option<Direction>,
    /// Who speaks on this line for certain: the side of a connection.
    pub certain: Option<Direction>,
    /// Units that took part in a good frame.
    pub known_units: &'a [bool; 256],
    /// Units that took part in a paired transaction.
    pub paired_units: &'a [bool; 256],
    /// Turns a silence into evidence.
    pub pause: &'a dyn Fn(Option<Ns>) -> Pause,
    /// Turns a record's words into a direction.
    pub said: &'a dyn Fn(modlens_readers::chunk::Side) -> Direction,
}

impl Context<'_> {
    /// What the recording says of the direction of the frame at `index`.
    pub fn said_at(&self, input: &Input, index: usize) -> Option<Direction> {
        self.certain.or(self.speaker).or_else(|| input.read(index).and_then(|read| read.side).map(|side| (self.said)(side)))
    }
}

/// Says what the first unframed bytes are.
pub trait Framer: Send + Sync {
    /// The first frame or noise row, once it is certain; `adu` gets the unit and the PDU of a frame in binary.
    ///
    /// `None` means: more bytes, a silence or the end are needed. When `input.closed`, all bytes are given out.
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut>;

    /// The framing.
    fn mode(&self) -> Mode;

    /// Another framer has told the bytes in front of this offset of the stream.
    fn jump(&mut self, _offset: u64) {}

    /// Whether nothing is open: the frame at this stream offset is what its own bytes say.
    fn settled(&self, _offset: u64) -> bool {
        false
    }

    /// The silence that ends every frame.
    fn break_ns(&self, line: Option<&LineSettings>) -> Ns;
}
