//! A region of unframed bytes with its context, and the damaged frames that are found in one.

use crate::frame_result::FramerContext;
use crate::input::Input;
use crate::rtu_model::announced_length::ENVELOPE_BYTES;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::traffic_model::TrafficModel;
use crate::weights::COARSE_FRAME_GAP_NS;
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::Ns;

/// Bytes between two frames that no valid frame claims, and what is known about them.
pub struct UnframedRegion<'a, 'c> {
    /// Statistics of the line.
    pub model: &'a TrafficModel,
    /// What the session knows, the outstanding request in front of the region among it.
    pub context: &'a FramerContext<'c>,
    /// The input, whose first byte is the first one of the region.
    pub input: &'a Input,
    /// Length of the region in bytes.
    pub length: usize,
    /// The frame that follows the region.
    pub next_frame: Option<(&'a [u8], Direction)>,
    /// A damaged frame was reported right in front of the region.
    pub follows_damaged_frame: bool,
    /// The shortest pause between two frames.
    pub frame_gap_ns: Ns,
    /// The region ends at the length that a header announces, and not where another frame begins.
    pub ends_as_announced: bool,
}

/// A damaged frame in a region.
#[derive(Clone, Debug)]
pub struct DamagedFrame {
    /// Index of its first byte.
    pub start: usize,
    /// Index after its last byte.
    pub end: usize,
    /// Who sent it.
    pub direction: Direction,
    /// Its first bytes as they were sent, where those are missing or wrong.
    pub head: Vec<u8>,
    /// It has fewer bytes than it should have.
    pub is_short: bool,
    /// What happened to it.
    pub damage: Option<DamageKind>,
    /// Its unit and function are unknown.
    pub is_unidentified: bool,
    /// Number of leading bytes on the wire that are wrong; `head` holds those that were sent.
    pub wrong_head_bytes: usize,
}

impl UnframedRegion<'_, '_> {
    /// The bytes of the region.
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.input.bytes()[..self.length]
    }

    /// Whether this line is framed independently of the other one, as the lines of a two-line tap without a clock are.
    /// Outstanding requests are unknown then, so a response does not need one.
    pub(crate) fn is_framed_independently(&self) -> bool {
        self.context.line_direction.is_some() && self.context.outstanding_request.is_none() && !self.input.has_times
    }

    /// Whether the recording holds nothing but this region.
    pub(crate) fn is_entire_input(&self) -> bool {
        let is_all = self.input.is_ended && self.length == self.input.bytes().len();
        self.input.offset() == 0 && self.next_frame.is_none() && is_all
    }

    /// Whether stray bytes are so rare on this line that more than a few unframed bytes must belong to a frame.
    pub(crate) fn has_few_strays(&self) -> bool {
        self.model.max_stray_bytes() < ENVELOPE_BYTES
    }

    /// Whether there is a pause before this byte that ends a frame, as far as the clock can tell.
    pub(crate) fn has_frame_gap(&self, at: usize) -> bool {
        let min_gap_ns =
            if self.input.has_multibyte_reads { self.frame_gap_ns.max(COARSE_FRAME_GAP_NS) } else { self.frame_gap_ns };
        self.input.pause_before(at).is_some_and(|pause| pause >= min_gap_ns)
    }

    /// Whether the frame after the region is this request.
    pub(crate) fn is_followed_by(&self, request: Option<RequestRef<'_>>) -> bool {
        let frame = self.next_frame.map_or(&[][..], |(frame, _)| frame);
        request.is_some_and(|request| frame.len() > 2 && request.unit == frame[0] && request.pdu == &frame[1..frame.len() - 2])
    }
}
