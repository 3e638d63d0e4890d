//! Finds damaged frames among the bytes that no valid frame claims, and leaves the rest as noise.
//!
//! The traffic around such a region says which frames may have stood in it: an outstanding request before it makes its
//! response likely, the same request behind it makes a damaged first attempt likely, and a response that nobody asked for
//! makes its request likely. The poll cycle and the units and functions seen on the line add further candidates. Each
//! expected frame is aligned with the bytes, and a damaged frame is reported where an alignment is worth clearly more
//! bits than chance would give. Bytes that fit nothing are noise.

use crate::damage::candidates::Candidate;
use crate::damage::chain::is_glitch;
use crate::damage::expected_frame;
use crate::damage::kind::Harm;
use crate::framer::rtu::announced_length::AROUND;
use crate::framer::rtu::costs;
use crate::framer::rtu::index::Values;
use crate::framer::rtu::model::Model;
use crate::framer::Context;
use crate::input::Input;
use modlens_protocol::direction::Direction;
use modlens_protocol::Ns;

/// Score that a damaged frame needs to be reported. Noise looks like one with a probability of about 2 to the minus this.
pub const MIN_DAMAGED_FRAME_BITS: f32 = 10.0;

/// Tolerance for sums of the same numbers that were added in a different order.
pub const ROUNDING_BITS: f32 = 0.01;

/// Cost of a further damaged frame in the same region: damage is rare, so two damaged frames need more evidence than one.
pub const FURTHER_DAMAGED_FRAME_BITS: f32 = 8.0;

/// Damaged frames are searched for in so many bytes at each end of a region; what lies between in a longer one is noise.
pub const SEARCHED_BYTES: usize = 320;

/// Bonus for a candidate that ends exactly where a pause, a valid frame or the end of the recording is.
pub const FRAME_END_BITS: f32 = 4.0;

/// Cost of each stray byte in front of a candidate, and the most that all of them cost together.
pub const STRAY_BYTE_BITS: f32 = 1.2;
pub const MAX_STRAY_BITS: f32 = 6.8;

/// In a longer frame, one inserted byte makes the CRC valid by chance in too many places to mean anything.
pub const MAX_INSERTION_CHECK_BYTES: usize = 40;

/// A line driver that is switched leaves at most so many stray bytes of one value behind a frame.
pub const MAX_GLITCH_BYTES: usize = 3;

/// USB adapters and schedulers seldom delay the rest of a frame for longer than this.
pub const COARSE_FRAME_GAP_NS: Ns = 45_000_000;

/// Cost of a frame that begins before the announced end of the damaged frame in front of it.
pub const OVERLAP_BITS: f32 = 3.0;

/// Bytes between two frames that no valid frame claims, and what is known about them.
pub struct UnframedRegion<'a, 'c> {
    /// Statistics of the line.
    pub model: &'a Model,
    /// What the session knows, the outstanding request in front of the region among it.
    pub context: &'a Context<'c>,
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
pub struct Piece {
    /// Index of its first byte.
    pub start: usize,
    /// Index behind its last byte.
    pub end: usize,
    /// Who sent it.
    pub direction: Direction,
    /// Its first bytes as they were sent, where those are missing or wrong.
    pub head: Vec<u8>,
    /// It has fewer bytes than it should have.
    pub is_short: bool,
    /// What happened to it.
    pub harm: Option<Harm>,
    /// Its unit and function are unknown.
    pub is_unidentified: bool,
    /// Number of leading bytes on the wire that are wrong; `head` holds those that were sent.
    pub wrong_head_bytes: usize,
}

impl UnframedRegion<'_, '_> {
    pub(crate) fn bytes(&self) -> &[u8] {
        &self.input.bytes()[..self.length]
    }

    /// The damaged frames of this region, in order; all other bytes of it are noise.
    pub fn damaged_frames(&self) -> Vec<Piece> {
        let mut frames = if self.is_too_short() { Vec::new() } else { self.best_chain(&self.all_candidates()) };
        // If the region is the entire input (somebody pasted one damaged frame), the frame starts at the first byte: a
        // candidate that starts later is discarded, unless only glitch bytes of a line driver precede it.
        if self.is_entire_input() && frames.first().is_some_and(|frame| !is_glitch(&self.bytes()[..frame.start])) {
            frames.clear();
        }
        let first = frames.first().map_or(self.length, |frame| frame.start);
        frames.splice(0..0, self.leading_fragment(first, frames.is_empty()));
        match frames.last_mut() {
            // The rest of the frame follows a loss in its middle: the frame extends to the end of the region.
            Some(last) if self.is_one_burst_behind(last) && self.resumes_after_loss(last) => {
                let at = last.end - last.start;
                let count = match last.harm {
                    Some(Harm::Lost { count, .. }) => count + last.end - self.length,
                    _ => 0,
                };
                (last.end, last.harm) = (self.length, Some(Harm::Lost { at, count }));
            }
            Some(last) if self.lost_bytes_behind(last) => {
                let at = last.end - last.start;
                (last.is_short, last.harm) = (true, Some(Harm::Lost { at, count: 0 }));
            }
            _ => frames.extend(self.trailing_fragment(&frames)),
        }
        frames
    }

    /// Whether this line is framed independently of the other one, as the lines of a two-line tap without a clock are.
    /// Outstanding requests are unknown then, so a response does not need one.
    pub(crate) fn is_framed_independently(&self) -> bool {
        self.context.speaker.is_some() && self.context.asked.is_none() && !self.input.timed
    }

    /// Whether the recording holds nothing but this region.
    fn is_entire_input(&self) -> bool {
        let is_all = self.input.ended && self.length == self.input.bytes().len();
        self.input.offset() == 0 && self.next_frame.is_none() && is_all
    }

    /// Whether stray bytes are so rare on this line that more than a few unframed bytes must belong to a frame.
    pub(crate) fn has_few_strays(&self) -> bool {
        self.model.strays_at_most() < AROUND
    }

    /// Whether so few bytes are left (at most `MAX_GLITCH_BYTES`) that no candidate can reach `MIN_DAMAGED_FRAME_BITS`.
    ///
    /// Their CRC cannot match, because they are fewer than any frame has. The bonus for ending at a frame boundary is
    /// smaller than the cost of the missing bytes, and the bonus for a preceding pause is smaller than the cost of
    /// choosing one of the expected frames. Glitch bytes of a line driver are never a unit and a function code.
    fn is_too_short(&self) -> bool {
        let max_bits = || self.model.bits_of(self.bytes()) + costs::PAUSE_BEFORE - STRAY_BYTE_BITS;
        self.length <= MAX_GLITCH_BYTES && (is_glitch(self.bytes()) || max_bits() < MIN_DAMAGED_FRAME_BITS)
    }

    /// All candidates of the region, ordered by the index of their first byte.
    fn all_candidates(&self) -> Vec<Candidate> {
        let expected = expected_frame::expected_frames(self);
        // Which values the first two bytes of any expected frame can have: a cheap test that fails nearly everywhere.
        let mut values = Values::default();
        for frame in &expected {
            values.add(&frame.bytes);
        }
        let mut candidates = Vec::new();
        let searched_again_from = SEARCHED_BYTES.max(self.length.saturating_sub(SEARCHED_BYTES));
        for start in (0..SEARCHED_BYTES.min(self.length)).chain(searched_again_from..self.length) {
            let bytes = &self.bytes()[start..];
            if !expected.is_empty() && values.admit(bytes) {
                self.add_expected(&expected, start, &mut candidates);
            }
            self.add_familiar(start, &mut candidates);
        }
        candidates
    }
}
