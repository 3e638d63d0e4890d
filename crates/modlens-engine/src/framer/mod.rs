//! Framers: where frames begin and end. One per framing, after one trait.
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

use crate::input::Input;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

pub use crate::frame_result::{FrameResult, FramerContext, FramingFault, PauseEvidence, MAX_NOISE_ROW_BYTES};

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
