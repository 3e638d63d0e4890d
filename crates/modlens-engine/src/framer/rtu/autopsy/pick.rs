//! Which of the candidates are told, where they end, and what happened to them.

use crate::framer::harm::Harm;
use crate::framer::rtu::autopsy::candidate::Candidate;
use crate::framer::rtu::autopsy::{mend, Piece, Scene, COARSE_STOP, CUT_OFF, ENOUGH, MOST_GLITCH, SELDOM, SHORT};
use crate::framer::rtu::costs;
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::AROUND;
use modlens_protocol::checksum::mending_bit;
use modlens_protocol::direction::{Asked, Direction};
use modlens_protocol::framing::RTU_LIMIT;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

impl Scene<'_, '_> {
    /// The best chain of candidates.
    pub(super) fn pick(&self, candidates: &[Candidate]) -> Vec<Piece> {
        let mut chains: Vec<(f32, Option<usize>)> = Vec::with_capacity(candidates.len());
        for candidate in candidates {
            let mut best = (candidate.score, None);
            for (at, before) in candidates.iter().enumerate().take(chains.len()) {
                if before.core > candidate.start || before.start == candidate.start || before.score < ENOUGH {
                    continue;
                }
                let over = before.end.is_some_and(|end| end > candidate.start);
                let answers = before.direction == REQUEST && candidate.direction == RESPONSE;
                let ours = answers && before.header[0] == candidate.header[0] && before.header[1] == candidate.header[1] & 0x7F;
                let own = candidate.score - if over { CUT_OFF } else { 0.0 }
                    + if ours { candidate.novelty + costs::ORPHAN } else { 0.0 };
                if own >= ENOUGH && chains[at].0 + own - SELDOM > best.0 {
                    best = (chains[at].0 + own - SELDOM, Some(at));
                }
            }
            chains.push(best);
        }
        let ends = (0..candidates.len()).filter(|&at| chains[at].1.is_some() || candidates[at].score >= ENOUGH);
        let mut at = ends.max_by(|&a, &b| chains[a].0.total_cmp(&chains[b].0));
        let mut pieces: Vec<Piece> = Vec::new();
        while let Some(here) = at {
            let next = pieces.last().map_or(self.length, |piece| piece.start);
            let piece = self.piece(&candidates[here], next);
            at = chains[here].1;
            let before = at.map_or(0, |at| candidates[at].end.unwrap_or(candidates[at].core));
            pieces.push(self.begun(piece, before));
        }
        pieces.reverse();
        pieces
    }

    /// Where just so many bytes stand before a piece as seem to be missing from it, they are its own, and wrong.
    pub(super) fn begun(&self, piece: Piece, before: usize) -> Piece {
        let count = piece.head.len();
        let Some(start) = piece.start.checked_sub(count).filter(|&start| count > 0 && start >= before) else { return piece };
        let has_checksum = piece.end - piece.start >= 2;
        if !has_checksum || (start != before && !self.stops(start)) || (start + 1..=piece.start).any(|at| self.stops(at)) {
            return piece;
        }
        Piece { start, short: false, harm: None, wrong: count, ..piece }
    }

    pub(super) fn piece(&self, candidate: &Candidate, next: usize) -> Piece {
        let room = next - candidate.start;
        let said = candidate.end.map(|end| end - candidate.start).or_else(|| self.announced(candidate, next));
        let mut should = said.unwrap_or(room);
        let mut length = should.min(room).min(RTU_LIMIT);
        let mut harm = candidate.harm;
        if harm.is_none() && candidate.exact && room > should && should < RTU_LIMIT {
            let longer = &self.bytes()[candidate.start..=candidate.start + should];
            harm = mend::doubled_byte(longer).map(|at| Harm::Doubled { at });
            length += usize::from(harm.is_some());
        }
        if let Some(pause) = self.stops_at(candidate, candidate.start + length) {
            length = pause - candidate.start;
            should = said.unwrap_or(length);
        }
        let bytes = &self.bytes()[candidate.start..candidate.start + length];
        // A flipped bit may be in the byte that announces the length.
        let flipped = length < should && mending_bit(bytes).is_some();
        if flipped {
            should = length;
        } else if harm.is_none() && length < should {
            let count = should - length;
            harm = Some(if self.asked_again(candidate) { Harm::Truncated { count } } else { Harm::Lost { at: length, count } });
        } else if harm.is_none() && candidate.end.is_some() && (candidate.exact || candidate.open_at.is_some()) {
            harm = match candidate.open_at {
                Some(at) => strays_instead(bytes, at),
                None => fewer(bytes, self.ends_well(candidate.end) > 0.0),
            };
            harm = harm.filter(|harm| match harm {
                Harm::Lost { count, .. } => self.over_behind(candidate.start + length - count),
                _ => true,
            });
            length -= match harm {
                Some(Harm::Lost { count, .. }) => count,
                _ => 0,
            };
        }
        let short = length < should || matches!(harm, Some(Harm::Lost { .. }));
        let direction = gain::direction(candidate.direction);
        let (start, end) = (candidate.start, candidate.start + length);
        Piece { start, end, direction, head: candidate.head.clone(), short, harm, unknown: false, wrong: 0 }
    }

    /// The length that the header of a piece announces, where its template says none.
    pub(super) fn announced(&self, candidate: &Candidate, next: usize) -> Option<usize> {
        let bytes = &self.bytes()[candidate.start..next];
        if candidate.header[..] != bytes[..2.min(bytes.len())] || candidate.header[1] & EXCEPTION_BIT != 0 {
            return None;
        }
        let row = self.context.functions.row(bytes[1], &bytes[2..])?;
        let layout = if candidate.direction == REQUEST { &row.request } else { &row.response };
        match layout.extent(&bytes[2..]) {
            Extent::Exactly(length) if length + AROUND <= RTU_LIMIT => Some(length + AROUND),
            _ => None,
        }
    }

    /// Where the line falls silent inside a frame whose checksum nothing mends: there it was over.
    pub(super) fn stops_at(&self, candidate: &Candidate, end: usize) -> Option<usize> {
        let usual = !self.input.coarse && self.model.pauses_inside();
        if candidate.mended || usual || self.ends_well(candidate.end) > 0.0 {
            return None;
        }
        (candidate.core.max(candidate.start + 1)..end).find(|&at| self.stops(at))
    }

    /// Whether a pause before this byte ends a frame, as far as the clock can tell.
    pub(super) fn stops(&self, at: usize) -> bool {
        let least = if self.input.coarse { self.silence.max(COARSE_STOP) } else { self.silence };
        self.input.pause_before(at).is_some_and(|pause| pause >= least)
    }

    /// Whether the same request follows: then nobody received this.
    pub(super) fn asked_again(&self, candidate: &Candidate) -> bool {
        let Some((frame, Direction::Request)) = self.after else { return false };
        if candidate.direction == REQUEST {
            let there = self.bytes().get(candidate.start..candidate.core).unwrap_or(&[]);
            let agrees = there.iter().zip(frame).all(|(a, b)| a == b);
            return frame[..2] == candidate.header && (agrees || !candidate.head.is_empty());
        }
        self.repeats(self.context.asked)
    }

    /// Whether the frame behind the gap is this request once more.
    pub(super) fn repeats(&self, asked: Option<Asked<'_>>) -> bool {
        let frame = self.after.map_or(&[][..], |(frame, _)| frame);
        asked.is_some_and(|asked| frame.len() > 2 && asked.unit == frame[0] && asked.pdu == &frame[1..frame.len() - 2])
    }
}

/// What is wrong with a frame of the right length whose checksum no flipped bit mends: perhaps it is a shorter one, and
/// its last bytes are strays behind it.
fn fewer(bytes: &[u8], ends_well: bool) -> Option<Harm> {
    let length = bytes.len();
    let last = *bytes.last().filter(|&&last| length > 5 && glitch(last))?;
    let count = bytes.iter().rev().take_while(|&&byte| byte == last).count();
    match count {
        // One byte of that kind may as well belong to the frame; then no byte put in mends the rest.
        1 if !ends_well && length <= SHORT => {
            let at = mend::missing_byte(&bytes[..length - 1]).filter(|_| mending_bit(bytes).is_none())?;
            Some(Harm::Lost { at, count })
        }
        2..=MOST_GLITCH if mending_bit(bytes).is_none() => Some(Harm::Lost { at: length - count, count }),
        _ => None,
    }
}

/// Whether the last bytes of a frame that is known are strays in the place of what was lost; here it agrees up to `at`.
fn strays_instead(bytes: &[u8], at: usize) -> Option<Harm> {
    let rest = bytes.get(at..).filter(|rest| (1..=MOST_GLITCH).contains(&rest.len()))?;
    let strays = rest.iter().all(|&byte| byte == rest[0]) && glitch(rest[0]) && mending_bit(bytes).is_none();
    strays.then_some(Harm::Lost { at, count: rest.len() })
}

/// A driver that is switched holds the line for some bits: the byte begins or ends in ones, or is all of one kind.
pub(super) fn glitch(byte: u8) -> bool {
    byte.leading_ones() + byte.trailing_zeros() >= 8
}

/// Whether these strays are what a driver leaves when it is switched: few, of one such value.
pub fn is_glitch(strays: &[u8]) -> bool {
    strays.len() <= MOST_GLITCH && strays.iter().all(|&byte| glitch(byte) && byte == strays[0])
}
