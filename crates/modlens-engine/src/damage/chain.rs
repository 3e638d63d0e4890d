//! Which candidates of a region are reported, where each ends, and what happened to it.

use crate::damage::candidates::Candidate;
use crate::damage::crc_correction;
use crate::damage::glitch::{is_glitch, is_glitch_byte};
use crate::damage::region::{DamagedFrame, UnframedRegion};
use crate::rtu_model::announced_length::ENVELOPE_BYTES;
use crate::rtu_model::damage_kind::DamageKind;
use crate::rtu_model::side::{self, REQUEST, RESPONSE};
use crate::weights::{
    self, FURTHER_DAMAGED_FRAME_BITS, MAX_GLITCH_BYTES, MAX_HEADER_FLIPS, MAX_INSERTION_CHECK_BYTES, MIN_DAMAGED_FRAME_BITS,
    OVERLAP_BITS,
};
use modlens_protocol::checksum::correctable_bit;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::MAX_RTU_FRAME_BYTES;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

impl UnframedRegion<'_, '_> {
    /// The damaged frames of the chain of candidates with the highest total score, in order; none if no candidate has enough.
    ///
    /// `candidates` are ordered by their first bytes and may overlap. The total of a chain is what `chains` gives for the
    /// candidate that it ends with. The first candidate of a chain needs `MIN_DAMAGED_FRAME_BITS` by its own score; a later one
    /// has them by `score_after`, else it would not be in its place.
    pub(crate) fn best_chain(&self, candidates: &[Candidate]) -> Vec<DamagedFrame> {
        let chains = chains(candidates);
        let may_end_with = |&at: &usize| chains[at].before.is_some() || candidates[at].score >= MIN_DAMAGED_FRAME_BITS;
        let ends = (0..candidates.len()).filter(may_end_with);
        let last = ends.max_by(|&a, &b| chains[a].total.total_cmp(&chains[b].total));
        self.frames_of_chain(candidates, &chains, last)
    }

    /// The frames of the chain that ends with the candidate `last`, in order. They are made from the last one to the first,
    /// because only the frame after says up to where one may reach.
    fn frames_of_chain(&self, candidates: &[Candidate], chains: &[Chain], last: Option<usize>) -> Vec<DamagedFrame> {
        let mut frames: Vec<DamagedFrame> = Vec::new();
        let mut current = last;
        while let Some(at) = current {
            let limit = frames.last().map_or(self.length, |frame| frame.start);
            let frame = self.damaged_frame(&candidates[at], limit);
            current = chains[at].before;
            let previous_end = current.map_or(0, |before| candidates[before].end.unwrap_or(candidates[before].core_end));
            frames.push(self.extend_over_wrong_head(frame, previous_end));
        }
        frames.reverse();
        frames
    }

    /// Extends a frame whose first bytes seem to be missing over as many bytes in front of it, if those are free: then
    /// nothing is missing, and the bytes in front are the first ones of the frame with wrong values.
    fn extend_over_wrong_head(&self, frame: DamagedFrame, previous_end: usize) -> DamagedFrame {
        let count = if matches!(frame.damage, Some(DamageKind::FlowControl { .. })) { 0 } else { frame.head.len() };
        let Some(start) = frame.start.checked_sub(count).filter(|&start| count > 0 && start >= previous_end) else {
            return frame;
        };
        let has_crc = frame.end - frame.start >= 2;
        let is_interrupted = (start + 1..=frame.start).any(|at| self.has_frame_gap(at));
        let is_nearly_head = || is_nearly(&self.bytes()[start..frame.start], &frame.head);
        let is_in_place = start == previous_end || self.has_frame_gap(start) || is_nearly_head();
        if !has_crc || !is_in_place || is_interrupted {
            return frame;
        }
        DamagedFrame { start, is_short: false, damage: None, wrong_head_bytes: count, ..frame }
    }

    /// The candidate as a frame: where it ends, and what happened to it. `limit` is the index in the region where the next
    /// frame of the chain begins, or the region's length.
    ///
    /// Where it ends is found first (`extent_of`), what happened to it second (`explain_end`), where the alignment does not say
    /// it already. If neither says anything, `damage` is `None`: some bits are wrong. `is_short`: the frame has fewer bytes
    /// than expected, or lost some.
    fn damaged_frame(&self, candidate: &Candidate, limit: usize) -> DamagedFrame {
        let Ending { length, expected_length, damage } = self.explain_end(candidate, self.extent_of(candidate, limit));
        DamagedFrame {
            start: candidate.start,
            end: candidate.start + length,
            direction: side::direction_of(candidate.direction),
            head: candidate.head.clone(),
            is_short: length < expected_length
                || matches!(damage, Some(DamageKind::LostBytes { .. } | DamageKind::FlowControl { .. })),
            damage,
            is_unidentified: false,
            wrong_head_bytes: 0,
        }
    }

    /// How many bytes a candidate has, how many it should have, and its damage if that is known by now.
    ///
    /// It should have those up to `Candidate::end`, else those that its header announces, else all up to `limit`. It has as
    /// many, but none at or after `limit`, no more than `MAX_RTU_FRAME_BYTES`, and one more if one was received twice
    /// (`doubled_byte`). If a pause inside counts as its end (`gap_inside`), it ends there; where nothing says how many bytes
    /// it should have, it then is as long as it should be.
    fn extent_of(&self, candidate: &Candidate, limit: usize) -> Ending {
        let available = limit - candidate.start;
        let announced = candidate.end.map(|end| end - candidate.start).or_else(|| self.announced_length(candidate, limit));
        let expected_length = announced.unwrap_or(available);
        let doubled = self.doubled_byte(candidate, expected_length, available);
        let length = expected_length.min(available).min(MAX_RTU_FRAME_BYTES) + usize::from(doubled.is_some());
        let damage = candidate.damage.or(doubled);
        match self.gap_inside(candidate, candidate.start + length) {
            Some(gap) => {
                let length = gap - candidate.start;
                Ending { length, expected_length: announced.unwrap_or(length), damage }
            }
            None => Ending { length, expected_length, damage },
        }
    }

    /// The byte that a candidate has twice, if all its known bytes agree, its alignment names no damage, there is at least one
    /// more byte up to the limit (`available`) than expected, and the CRC is valid without the second copy.
    fn doubled_byte(&self, candidate: &Candidate, expected_length: usize, available: usize) -> Option<DamageKind> {
        let may_be_longer = available > expected_length && expected_length < MAX_RTU_FRAME_BYTES;
        if candidate.damage.is_some() || !candidate.is_exact || !may_be_longer {
            return None;
        }
        let longer = &self.bytes()[candidate.start..=candidate.start + expected_length];
        crc_correction::doubled_byte(longer).map(|at| DamageKind::DoubledByte { at })
    }

    /// What happened to a candidate, as far as its length shows it; a damage that is known already stays as it is.
    ///
    /// 1. Fewer bytes than expected, and one flipped bit explains the CRC: nothing is missing, since the flipped bit may be in
    ///    the byte that announces the length. The expected length becomes the real one.
    /// 2. Fewer bytes than expected: the end is missing. It was never sent if a retry follows, else it was lost.
    /// 3. As many as expected by `Candidate::end`: the last ones may be stray bytes in the place of lost ones
    ///    (`strays_for_lost_bytes`). The frame ends in front of them.
    fn explain_end(&self, candidate: &Candidate, ending: Ending) -> Ending {
        let Ending { length, expected_length, .. } = ending;
        let bytes = &self.bytes()[candidate.start..candidate.start + length];
        if length < expected_length && correctable_bit(bytes).is_some() {
            return Ending { expected_length: length, ..ending };
        }
        if ending.damage.is_some() {
            return ending;
        }
        if length < expected_length {
            return Ending { damage: Some(self.missing_end(candidate, length, expected_length - length)), ..ending };
        }
        let damage = candidate.end.and_then(|_| self.strays_for_lost_bytes(candidate, bytes));
        let strays = if let Some(DamageKind::LostBytes { count, .. }) = damage { count } else { 0 };
        Ending { length: length - strays, damage, ..ending }
    }

    /// The damage of a candidate of `length` bytes that lacks `count` at its end.
    fn missing_end(&self, candidate: &Candidate, length: usize, count: usize) -> DamageKind {
        if self.is_followed_by_retry(candidate) {
            DamageKind::Truncated { count }
        } else {
            DamageKind::LostBytes { at: length, count }
        }
    }

    /// Whether a frame of the right length is really a shorter one, whose lost bytes have been replaced by as many stray
    /// bytes of a line driver after it.
    fn strays_for_lost_bytes(&self, candidate: &Candidate, bytes: &[u8]) -> Option<DamageKind> {
        if !candidate.is_exact && candidate.agreeing_bytes.is_none() {
            return None;
        }
        let damage = match candidate.agreeing_bytes {
            Some(agreeing) => strays_behind_known_bytes(bytes, agreeing),
            None => strays_behind_unknown_bytes(bytes, self.end_bonus(candidate.end) > 0.0),
        };
        damage.filter(|damage| match damage {
            DamageKind::LostBytes { count, .. } => self.is_silent_behind_strays(candidate.start + bytes.len() - count),
            _ => true,
        })
    }

    /// The length in bytes that the header of a candidate announces, where its expected frame does not say it.
    fn announced_length(&self, candidate: &Candidate, limit: usize) -> Option<usize> {
        let bytes = &self.bytes()[candidate.start..limit];
        if candidate.header[..] != bytes[..2.min(bytes.len())] || candidate.header[1] & EXCEPTION_BIT != 0 {
            return None;
        }
        let row = self.context.functions.row(bytes[1], &bytes[2..])?;
        let layout = if candidate.direction == REQUEST { &row.request } else { &row.response };
        match layout.extent(&bytes[2..]) {
            Extent::Exactly(length) if length + ENVELOPE_BYTES <= MAX_RTU_FRAME_BYTES => Some(length + ENVELOPE_BYTES),
            _ => None,
        }
    }

    /// The index of the first pause inside a frame, from the bytes after those that agree up to index `end`: the frame ended
    /// there. `None` if a correction makes the frame valid, if it ends at a pause or with the region, or if pauses inside
    /// frames are usual on this line.
    fn gap_inside(&self, candidate: &Candidate, end: usize) -> Option<usize> {
        let pauses_are_usual = !self.input.has_multibyte_reads && self.model.has_inner_pauses();
        if candidate.is_corrected || pauses_are_usual || self.end_bonus(candidate.end) > 0.0 {
            return None;
        }
        (candidate.core_end.max(candidate.start + 1)..end).find(|&at| self.has_frame_gap(at))
    }

    /// Whether the request follows the region again, so that the unit has not received the candidate, or the master
    /// has not: then the sender stopped, and the tap has lost nothing.
    fn is_followed_by_retry(&self, candidate: &Candidate) -> bool {
        let Some((frame, Direction::Request)) = self.next_frame else { return false };
        if candidate.direction == REQUEST {
            let core = self.bytes().get(candidate.start..candidate.core_end).unwrap_or(&[]);
            let agrees = core.iter().zip(frame).all(|(a, b)| a == b);
            return frame[..2] == candidate.header && (agrees || !candidate.head.is_empty());
        }
        self.is_followed_by(self.context.outstanding_request)
    }
}

/// Whether these bytes are the first ones of a frame but for one wrong bit in one byte, or three in more. What a line driver has
/// left is not.
fn is_nearly(bytes: &[u8], head: &[u8]) -> bool {
    let flips: u32 = bytes.iter().zip(head).map(|(byte, sent)| (byte ^ sent).count_ones()).sum();
    !is_glitch(bytes) && flips <= if head.len() > 1 { MAX_HEADER_FLIPS } else { 1 }
}

/// Where a candidate ends.
struct Ending {
    /// How many bytes it has in the region.
    length: usize,
    /// How many it should have.
    expected_length: usize,
    /// What happened to it, as far as that is known.
    damage: Option<DamageKind>,
}

/// The best chain that ends with a certain candidate.
struct Chain {
    /// Its total score in bits.
    total: f32,
    /// Index of the candidate in front of the last one; `None` if the chain has only one.
    before: Option<usize>,
}

/// For each candidate, the chain with the highest total that ends with it: from left to right, by dynamic programming.
///
/// A candidate may follow another one that begins earlier, whose `core_end` is not after its start, and that has
/// `MIN_DAMAGED_FRAME_BITS` by its own score. It then counts with `score_after` less `FURTHER_DAMAGED_FRAME_BITS`, if
/// `score_after` is at least `MIN_DAMAGED_FRAME_BITS`. It is alone, with its own score, if no chain is worth more.
fn chains(candidates: &[Candidate]) -> Vec<Chain> {
    let mut chains: Vec<Chain> = Vec::with_capacity(candidates.len());
    for candidate in candidates {
        let mut best = Chain { total: candidate.score, before: None };
        for (at, before) in candidates.iter().enumerate().take(chains.len()) {
            if before.core_end > candidate.start || before.start == candidate.start || before.score < MIN_DAMAGED_FRAME_BITS {
                continue;
            }
            let score = score_after(candidate, before);
            let total = chains[at].total + score - FURTHER_DAMAGED_FRAME_BITS;
            if score >= MIN_DAMAGED_FRAME_BITS && total > best.total {
                best = Chain { total, before: Some(at) };
            }
        }
        chains.push(best);
    }
    chains
}

/// The score of a candidate in bits if another one is before it in the chain. A response that no request predicted, and that paid
/// for that, gets it back after its damaged request; one after the response to the same request pays for it.
fn score_after(candidate: &Candidate, before: &Candidate) -> f32 {
    let overlaps = before.end.is_some_and(|end| end > candidate.start);
    let is_same_function = before.header[0] == candidate.header[0] && before.header[1] == candidate.header[1] & !EXCEPTION_BIT;
    let turn = match (before.direction, candidate.direction) {
        (REQUEST, RESPONSE) if is_same_function && candidate.header_cost > 0.0 => {
            candidate.header_cost + weights::UNSOLICITED_BITS
        }
        (RESPONSE, RESPONSE) if is_same_function => -weights::UNSOLICITED_BITS,
        _ => 0.0,
    };
    candidate.score - if overlaps { OVERLAP_BITS } else { 0.0 } + turn
}

/// Whether a frame of the right length, whose CRC no single flipped bit explains, is a shorter one with stray bytes after
/// it; for frames whose content is unknown.
fn strays_behind_unknown_bytes(bytes: &[u8], ends_well: bool) -> Option<DamageKind> {
    let length = bytes.len();
    let last = *bytes.last().filter(|&&last| length > 5 && is_glitch_byte(last))?;
    let count = bytes.iter().rev().take_while(|&&byte| byte == last).count();
    match count {
        // A single byte like that may as well belong to the frame. It is a stray byte if one byte inserted into the rest
        // makes the CRC valid, and one flipped bit does not.
        1 if !ends_well && length <= MAX_INSERTION_CHECK_BYTES => {
            let at = crc_correction::missing_byte(&bytes[..length - 1]).filter(|_| correctable_bit(bytes).is_none())?;
            Some(DamageKind::LostBytes { at, count })
        }
        2..=MAX_GLITCH_BYTES if correctable_bit(bytes).is_none() => Some(DamageKind::LostBytes { at: length - count, count }),
        _ => None,
    }
}

/// Whether the last bytes of a frame are stray bytes in the place of lost ones; for frames whose content is known, of
/// which the first `agreeing` bytes are as expected.
fn strays_behind_known_bytes(bytes: &[u8], agreeing: usize) -> Option<DamageKind> {
    let rest = bytes.get(agreeing..).filter(|rest| (1..=MAX_GLITCH_BYTES).contains(&rest.len()))?;
    let are_strays = rest.iter().all(|&byte| byte == rest[0]) && is_glitch_byte(rest[0]) && correctable_bit(bytes).is_none();
    are_strays.then_some(DamageKind::LostBytes { at: agreeing, count: rest.len() })
}
