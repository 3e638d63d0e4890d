//! RTU by joint evidence: CRC, layout, the outstanding request, what the line has shown, and pauses, scored in bits.
//!
//! `crc_scan` finds every substring with a valid CRC, `score` and `context_score` say by the table of weights what each is worth
//! as a request or a response, and `search` finds the best path through all of them. Unambiguous traffic takes the fast path past the search.
//! The bytes between frames are handed to `damage`: damaged frames where header or silences show them, noise elsewhere.

pub(crate) mod context_score;
pub(crate) mod frame_check;
pub(crate) mod header_score;
pub(crate) mod lone_frames;
pub(crate) mod search;

mod decided;
mod single_frame;
mod unambiguous;

use crate::damage::recovery::DamageRecovery;
use crate::framer::rtu::frame_check::FrameCheck;
use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use crate::weights::{COARSE_MIN_GAP_NS, FRAME_BREAK_CHARACTERS_FACTOR, FRAME_BREAK_NS};
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;

use search::{Decision, Search};

/// The framer of an RTU line.
pub struct RtuFramer {
    pub(crate) search: Search,
    /// What the search decided and is not returned yet.
    decision: Option<Decision>,
    /// The stream offset at which the fast path found no frame.
    fast_path_failed_at: Option<u64>,
    /// The stream offset of bytes after which, taken as stray bytes, the fast path found no frame.
    fast_path_failed_after_strays_at: Option<u64>,
    /// What was found in the unframed bytes before the decision.
    recovery: DamageRecovery,
    /// The last frame that was decided was damaged (`Decision::Damaged`). Damaged frames among unframed bytes do not count.
    pub(crate) last_was_damaged: bool,
    /// The shortest pause between frames.
    frame_gap_ns: Ns,
}

/// Times.
impl RtuFramer {
    /// A framer for a line with these settings.
    pub fn new(line: Option<&LineSettings>) -> Self {
        Self {
            search: Search::default(),
            decision: None,
            fast_path_failed_at: None,
            fast_path_failed_after_strays_at: None,
            recovery: DamageRecovery::default(),
            last_was_damaged: false,
            frame_gap_ns: line.map_or(COARSE_MIN_GAP_NS, LineSettings::t35_ns),
        }
    }

    /// The shortest pause that counts as one between frames: longer where reads have several bytes.
    fn frame_gap_ns(&self, input: &Input) -> Ns {
        if input.has_multibyte_reads {
            self.frame_gap_ns.max(COARSE_MIN_GAP_NS)
        } else {
            self.frame_gap_ns
        }
    }

    /// Learns whether valid frames of this line, like this one of `length` bytes, have pauses inside.
    fn learn_inner_pause(&mut self, input: &Input, length: usize) {
        if input.has_times
            && !input.has_multibyte_reads
            && input.boundary_after(0, length - 1, self.frame_gap_ns(input)).is_some()
        {
            self.search.model.learn_inner_pause();
        }
    }
}

impl Framer for RtuFramer {
    fn next(&mut self, input: &Input, context: &FramerContext<'_>, adu: &mut Vec<u8>) -> Option<FrameResult> {
        let has_checksum = || input.first_read().is_some_and(|read| !read.lacks_checksum);
        if self.decision.is_none() && !context.is_multi_line && has_checksum() {
            match self.try_fast_path(input, context) {
                FrameCheck::Frame(length) => return Some(self.commit_unambiguous_frame(input, context, length, adu)),
                FrameCheck::NeedsMoreBytes => return None,
                FrameCheck::NoFrame => {}
            }
        }
        self.next_by_search(input, context, adu)
    }

    fn mode(&self) -> Mode {
        Mode::Rtu
    }

    fn skip_to(&mut self, offset: u64) {
        self.decision = None;
        self.recovery.forget_found();
        self.search.skip_to(offset);
    }

    fn is_settled_at(&self, offset: u64) -> bool {
        self.decision.is_none() && self.fast_path_failed_at != Some(offset) && self.search.is_settled_at(offset)
    }

    fn break_ns(&self, line: Option<&LineSettings>) -> Ns {
        line.map_or(FRAME_BREAK_NS, |line| FRAME_BREAK_NS.max(FRAME_BREAK_CHARACTERS_FACTOR * line.char_ns()))
    }
}
