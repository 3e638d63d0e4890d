//! Frames that a chain proves (`fast_path::rtu_chain`): whether the bytes before one hide another, and committing it.

use crate::fast_path::frame_check::FrameCheck;
use crate::fast_path::rtu_chain::{ProvenFrame, Unproven};
use crate::framer::rtu::announced_length::{announced_lengths, ENVELOPE_BYTES};
use crate::framer::rtu::score;
use crate::framer::rtu::search::commit::lookahead::complete_frame_at;
use crate::framer::rtu::search::commit::state::Decision;
use crate::framer::rtu::search::hypothesis::{Hypothesis, ROOT};
use crate::framer::rtu::search::state::Search;
use crate::framer::rtu::side::{self, REQUEST, RESPONSE};
use crate::framer::FramerContext;
use crate::input::Input;
use crate::weights::{DAMAGED_LEAD_BITS, MAX_SKIPPED_STRAY_BYTES, MIN_DAMAGED_FRAME_BYTES, PROVEN_LEAD_BITS, UNANSWERED_BITS};
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

/// What stands before a proven frame.
pub enum BeforeProven {
    /// Nothing that has to be weighed.
    Nothing,
    /// A damaged frame of the announced length, right behind the root.
    Damaged(ProvenFrame),
}

impl Search {
    /// What stands before a proven frame; an error if the search has to weigh it, or if more bytes are needed to tell. It has to where
    /// a substring of these bytes has a valid CRC, where a frame that begins in them contains the proven one, or where they may as
    /// well be a damaged frame as none. So far into bytes that are no frame, only a unit that is known may begin another one.
    pub fn look_before_proven(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        frame: &ProvenFrame,
    ) -> Result<BeforeProven, Unproven> {
        let unframed = &input.bytes()[..frame.range.start];
        let damaged = self.announced_damaged_frame(context, unframed, frame)?;
        if self.has_valid_substring(input.offset(), unframed) {
            return Err(Unproven::NoChain);
        }
        let is_asked = |&at: &usize| at <= MAX_SKIPPED_STRAY_BYTES || context.known_units[usize::from(unframed[at])];
        for at in (0..unframed.len()).filter(is_asked) {
            match complete_frame_at(input, context, at, frame.range.end) {
                FrameCheck::NoFrame => {}
                FrameCheck::NeedsMoreBytes => return Err(Unproven::NeedsMoreBytes),
                FrameCheck::Frame(_) => return Err(Unproven::NoChain),
            }
        }
        Ok(damaged.map_or(BeforeProven::Nothing, BeforeProven::Damaged))
    }

    /// The damaged frame of the announced length with which these bytes before a proven frame begin, if its path leads the one without
    /// it by `DAMAGED_LEAD_BITS`; `None` if it is behind by as much, and an error in between, or if its length is announced in
    /// both directions.
    fn announced_damaged_frame(
        &self,
        context: &FramerContext<'_>,
        unframed: &[u8],
        proven: &ProvenFrame,
    ) -> Result<Option<ProvenFrame>, Unproven> {
        if (unframed.len() as u64) < MIN_DAMAGED_FRAME_BYTES || unframed[1] & EXCEPTION_BIT != 0 {
            return Ok(None);
        }
        let mut found = announced_lengths(context, unframed).into_iter().flatten().filter_map(|(direction, extent)| {
            let Extent::Exactly(length) = extent else { return None };
            let direction = side::index_of(direction);
            let score = |frame| score::damaged_frame_score(&self.model, context, self.outstanding_request(), frame, direction);
            Some((ProvenFrame { range: 0..length, direction }, unframed.get(..length).and_then(score)?))
        });
        let (Some((damaged, score)), None) = (found.next(), found.next()) else { return Ok(None) };
        let strays = unframed.len() - damaged.range.end;
        let lead = score + self.model.unframed_cost(unframed.len() as u64) - self.model.unframed_cost(strays as u64);
        match (damaged.direction, proven.direction) {
            _ if lead <= -DAMAGED_LEAD_BITS => Ok(None),
            // It would answer the request that the proven frame answers, too; or a request would stand between the two.
            (_, RESPONSE) => Err(Unproven::NoChain),
            (RESPONSE, _) if lead >= DAMAGED_LEAD_BITS - UNANSWERED_BITS => Ok(Some(damaged)),
            (REQUEST, _) if lead >= DAMAGED_LEAD_BITS + UNANSWERED_BITS => Ok(Some(damaged)),
            _ => Err(Unproven::NoChain),
        }
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

    /// Commits a frame behind the root, and what is unframed before it, as if all bytes up to its end had been scanned and it
    /// were the only hypothesis: proven ones have a valid CRC, damaged ones before them have not.
    pub fn commit_without_search(
        &mut self,
        input: &Input,
        context: &FramerContext<'_>,
        frame: &ProvenFrame,
        is_crc_valid: bool,
    ) -> Decision {
        let [start, end] = [frame.range.start, frame.range.end].map(|index| input.offset() + index as u64);
        (self.scanned_to, self.is_scanning) = (end, false);
        self.reserve_request();
        let (bytes, answers_outstanding) = (&input.bytes()[frame.range.clone()], frame.direction == RESPONSE);
        let before = self.lattice[ROOT].answerable;
        let answerable = self.requests.after(before, bytes, frame.direction, answers_outstanding, is_crc_valid);
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
            is_crc_valid,
            answerable,
            ..Hypothesis::root()
        });
        self.commit_frame(input, context, ROOT + 1, score)
    }
}
