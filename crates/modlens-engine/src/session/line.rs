//! The state of one line: its bytes, its framer, and who speaks on it.

use std::collections::VecDeque;

use crate::findings::contradictions::ContradictionCounts;
use crate::framer::line_framer::LineFramer;
use crate::framer::{FrameResult, Framer};
use crate::input::Input;
use crate::session::inner_pauses::InnerPauses;
use crate::session::lateness::Lateness;
use crate::session::two_lines::alignment::LineFrame;
use modlens_protocol::direction::possible_directions;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// Votes beyond which a further frame no longer changes who speaks on a line.
const MAX_LINE_VOTES: i32 = 50;

/// One line of a bus: a serial line has one, a two-line tap and a TCP connection have one for each direction.
pub(crate) struct LineState {
    /// Frames seen on the line that only a master can send, less those that only a unit can send.
    pub(crate) request_votes: i32,
    pub(crate) input: Input,
    pub(crate) framer: LineFramer,
    /// End of the last frame that was emitted.
    pub(crate) last_end: Option<Ns>,
    pub(crate) lateness: Lateness,
    pub(crate) inner_pauses: InnerPauses,
    pub(crate) contradictions: ContradictionCounts,
    /// Frames that wait for their place among those of the other line, where no clock gives their order.
    pub(crate) unmerged: Option<Box<UnmergedFrames>>,
}

impl LineState {
    /// The pause inside the next frame that its sender must have made, where reads of several bytes hide shorter ones.
    pub(crate) fn proven_pause(&mut self, framed: &FrameResult, unit: u8) -> Option<Ns> {
        let input = self.emission_input();
        let is_hidden = framed.verdict.is_good() && input.has_multibyte_reads;
        let longest = input.longest_pause(0, framed.length).filter(|_| is_hidden);
        self.inner_pauses.add(framed.direction, unit, longest)
    }

    /// Whether the framer holds nothing back: the next frame is decided by its own bytes alone.
    pub(crate) fn is_settled(&self) -> bool {
        self.unmerged.is_none() && self.framer.is_settled_at(self.input.offset())
    }
}

/// The frames of a line that wait for their place among those of the other line.
pub(crate) struct UnmergedFrames {
    pub(crate) results: VecDeque<FrameResult>,
    /// For each of `results`, what its place depends on.
    pub(crate) frames: VecDeque<LineFrame>,
    /// The bytes of the line from the first of these frames on. The line's own input begins after all of them.
    pub(crate) input: Input,
}

impl UnmergedFrames {
    pub(crate) fn new(input: Input) -> Self {
        Self { results: VecDeque::new(), frames: VecDeque::new(), input }
    }
}

/// The votes of a line after one more frame: +1 for a frame that only a master can send, -1 for one that only a unit can
/// send, 0 for one that may be either.
pub(crate) fn add_vote(votes: i32, functions: &Functions, adu: &[u8]) -> i32 {
    let vote = match possible_directions(functions, adu.get(1..).unwrap_or(&[])) {
        (true, false) => 1,
        (false, true) => -1,
        _ => 0,
    };
    (votes + vote).clamp(-MAX_LINE_VOTES, MAX_LINE_VOTES)
}
