//! Frames that a chain proves (`fast_path::rtu_chain`): whether the bytes before one hide another, and committing it.

use crate::fast_path::frame_check::FrameCheck;
use crate::fast_path::rtu_chain::{ProvenFrame, Unproven};
use crate::framer::rtu::announced_length::{announced_lengths, ENVELOPE_BYTES};
use crate::framer::rtu::score;
use crate::framer::rtu::search::commit::state::Decision;
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::state::Search;
use crate::framer::rtu::side::{self, RESPONSE};
use crate::framer::FramerContext;
use crate::input::Input;
use crate::weights::{MIN_DAMAGED_FRAME_BYTES, PROVEN_LEAD_BITS};
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

impl Search {
    /// Whether no other frame begins in the bytes before a proven one, so that the search has nothing to weigh: no substring of them has a
    /// valid CRC, none is a rival (`rival_in_stray_bytes`), and none is a damaged frame of the announced length right behind the
    /// root.
    pub fn check_before_proven(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        frame: &ProvenFrame,
    ) -> Result<(), Unproven> {
        let unframed = &input.bytes()[..frame.range.start];
        if self.announces_damaged_frame(context, unframed) || self.has_valid_substring(input.offset(), unframed) {
            return Err(Unproven::NoChain);
        }
        match self.rival_in_stray_bytes(input, context, unframed.len(), frame.range.len()) {
            FrameCheck::NoFrame => Ok(()),
            FrameCheck::NeedsMoreBytes => Err(Unproven::NeedsMoreBytes),
            FrameCheck::Frame(_) => Err(Unproven::NoChain),
        }
    }

    /// Whether these bytes behind the root begin with a damaged frame of exactly the length that it announces.
    fn announces_damaged_frame(&self, context: &FramerContext<'_>, unframed: &[u8]) -> bool {
        if (unframed.len() as u64) < MIN_DAMAGED_FRAME_BYTES || unframed[1] & EXCEPTION_BIT != 0 {
            return false;
        }
        announced_lengths(context, unframed).into_iter().flatten().any(|(direction, extent)| {
            let Extent::Exactly(length) = extent else { return false };
            let frame = unframed.get(..length);
            let score = |frame| {
                score::damaged_frame_score(&self.model, context, self.outstanding_request(), frame, side::index_of(direction))
            };
            frame.and_then(score).is_some()
        })
    }

    /// Whether any substring of these bytes, which begin at this stream offset, has a valid CRC and may be a frame.
    fn has_valid_substring(&mut self, offset: u64, bytes: &[u8]) -> bool {
        if bytes.len() < ENVELOPE_BYTES {
            return false;
        }
        let may_be_frame = |start: u64, length: usize| !score::is_impossible(bytes[(start - offset) as usize + 1], length);
        let mut found = std::mem::take(&mut self.valid_starts);
        self.stray_scanner.restart(offset);
        self.stray_scanner.scan(offset, bytes, &may_be_frame, &mut found);
        let is_found = !found.is_empty();
        self.valid_starts = found;
        is_found
    }

    /// Commits a proven frame behind the root, and what is unframed before it, as if all bytes up to its end had been scanned and
    /// it were the only hypothesis. Others are dropped.
    pub fn commit_proven_frame(&mut self, input: &Input, context: &FramerContext<'_>, frame: &ProvenFrame) -> Decision {
        self.lattice.truncate(1);
        let [start, end] = [frame.range.start, frame.range.end].map(|index| input.offset() + index as u64);
        (self.scanned_to, self.is_scanning) = (end, false);
        self.reserve_request();
        let answers_outstanding = frame.direction == RESPONSE;
        let before = self.lattice[ROOT].answerable;
        let answerable =
            self.requests.after(before, &input.bytes()[frame.range.clone()], frame.direction, answers_outstanding, true);
        let score = self.current_score(&self.lattice[ROOT]) + PROVEN_LEAD_BITS;
        self.lattice.push(Hypothesis {
            start,
            end,
            direction: frame.direction,
            path_score: score,
            frame_score: PROVEN_LEAD_BITS,
            first_on_path: ROOT + 1,
            next_damaged_end_at: end + MIN_DAMAGED_FRAME_BYTES,
            answers_outstanding,
            answerable,
            ..Hypothesis::root()
        });
        self.commit_frame(input, context, ROOT + 1, score)
    }
}
