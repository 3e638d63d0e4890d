//! What the frames of a short recording show side by side: bytes of no frame beside a whole answer, and a request that was received
//! with its answer.

use std::collections::VecDeque;

use modlens_engine::records::Side;
use modlens_protocol::direction::Direction;

use crate::observation::FrameObservation;

/// Shorter runs are strays.
const LEAST_BYTES: usize = 4;

/// More bytes are not shown.
const MOST_SHOWN: usize = 16;

/// A run of bytes of no frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OddRun {
    bytes: Vec<u8>,
    /// It is in a line or packet of its own, and as long as the whole answer before it.
    is_like_answer: bool,
}

impl OddRun {
    /// The first one that is long enough for a frame.
    pub(super) fn of(frames: &VecDeque<FrameObservation>) -> Option<Self> {
        let is_odd = |seen: &FrameObservation| !seen.verdict.is_good() && seen.bytes.len() >= LEAST_BYTES;
        let at = frames.iter().position(is_odd)?;
        let seen = &frames[at];
        let before = frames.iter().take(at).rfind(|before| before.verdict.is_good());
        let is_like_answer = before.is_some_and(|before| {
            let is_apart = seen.origins[0] != 0 && seen.origins[0] != before.origins[1];
            is_apart && before.direction == Direction::Response && before.length == seen.length
        });
        Some(Self { bytes: seen.bytes.clone(), is_like_answer })
    }

    /// The bytes, and what they may be, as the end of a sentence.
    pub fn words(&self) -> String {
        let shown: Vec<String> = self.bytes.iter().take(MOST_SHOWN).map(|byte| format!("{byte:02X}")).collect();
        let more = if self.bytes.len() > MOST_SHOWN { " .." } else { "" };
        let like = if self.is_like_answer {
            ", as many as the answer before has, so that they may be a second answer that is damaged from its first byte on"
        } else {
            ""
        };
        format!(" ({}{more}){like}", shown.join(" "))
    }
}

/// Whether a request and its answer are in one run of bytes that the program has received, and it has sent nothing.
pub(super) fn overhears(frames: &VecDeque<FrameObservation>) -> bool {
    let is_received = |seen: &FrameObservation| seen.side == Some(Side::Received) && seen.verdict.is_good();
    let is_pair = |request: &FrameObservation, answer: &FrameObservation| {
        let are_together = request.origins[1] != 0 && request.origins[1] == answer.origins[0];
        let is_answer = request.is_read_request() && answer.direction == Direction::Response;
        are_together && is_answer && request.txn == answer.txn && is_received(request) && is_received(answer)
    };
    let mut pairs = frames.iter().zip(frames.iter().skip(1));
    frames.iter().all(|seen| seen.side != Some(Side::Sent)) && pairs.any(|(one, next)| is_pair(one, next))
}
