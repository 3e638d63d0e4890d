//! What stands in front of the damaged frames of a gap and behind them: the remains of others.

use crate::framer::harm::Harm;
use crate::framer::rtu::autopsy::pick::glitch;
use crate::framer::rtu::autopsy::{template, Piece, Scene, COARSE_STOP, MOST_GLITCH};
use crate::framer::rtu::AROUND;
use modlens_protocol::checksum::mending_bit;
use modlens_protocol::direction::{Asked, Direction};
use modlens_protocol::framing::RTU_LIMIT;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};
use modlens_protocol::Ns;

impl Scene<'_, '_> {
    /// Whether the bytes behind a piece came in one go.
    pub(super) fn ends_in_one(&self, piece: &Piece) -> bool {
        let (start, end) = (piece.end, self.length);
        start < end && self.stops(start) && !(start + 1..end).any(|at| self.stops(at))
    }

    /// What stands behind a frame that lost its end, between two pauses: the rest of a frame that lost its beginning.
    pub(super) fn tail(&self, pieces: &[Piece]) -> Option<Piece> {
        let last = pieces.last().filter(|last| matches!(last.harm, Some(Harm::Lost { .. })))?;
        let (_, after) = self.after?;
        let (start, end) = (last.end, self.length);
        if !self.ends_in_one(last) || end - start <= self.model.strays_at_most() || end - start > RTU_LIMIT {
            return None;
        }
        let direction = if after == Direction::Request { Direction::Response } else { Direction::Request };
        let harm = Some(Harm::Lost { at: 0, count: 0 });
        Some(Piece { start, end, direction, head: Vec::new(), short: true, harm, unknown: true, wrong: 0 })
    }

    /// What stands before all that was recognised: the rest of a frame, where one must have been.
    ///
    /// A recording begins in the middle of a frame more often than not. Elsewhere, a request or its answer is missing,
    /// and more bytes than strays would be stand in the place.
    pub(super) fn remains(&self, to: usize, alone: bool) -> Option<Piece> {
        let begins = self.input.offset() == 0 && self.after.is_some();
        let after = self.after.map(|(_, direction)| direction);
        let (due, asked) = match (after, self.context.asked) {
            // A line that one side has for itself.
            _ if self.context.speaker.is_some() && self.quiet(to) => (self.context.speaker.unwrap_or(Direction::Unknown), None),
            _ if self.context.speaker.is_some() && !begins => return None,
            (Some(Direction::Request), Some(asked)) => (Direction::Response, Some(asked)),
            (Some(Direction::Response), None) => (Direction::Request, None),
            _ if begins => (Direction::Unknown, None),
            _ => return None,
        };
        if !(alone || begins) || self.behind_damage || to > RTU_LIMIT {
            return None;
        }
        let bytes = &self.bytes()[..to];
        if let Some(asked) = asked.filter(|&asked| to == self.length && self.is_clean() && begun(bytes, asked)) {
            let unknown = bytes.len() < 2;
            let again = self.repeats(Some(asked));
            let harm = again.then_some(Harm::Truncated { count: 0 });
            return Some(Piece { start: 0, end: to, direction: due, head: Vec::new(), short: true, harm, unknown, wrong: 0 });
        }
        // On a line with few strays, zeros are data.
        let clean = begins || (self.context.speaker.is_some() && self.is_clean());
        let strays = if clean { 0 } else { bytes.iter().take(MOST_GLITCH).take_while(|&&byte| glitch(byte)).count() };
        let least = if begins { 2 } else { self.model.strays_at_most() + 1 };
        if to - strays < least {
            return None;
        }
        let expected = asked.and_then(|asked| template::answer_length(self, asked));
        let length = to - strays;
        let again = self.repeats(asked);
        let harm = match expected {
            Some(expected) if expected > length && expected - length <= length && !again => {
                Some(Harm::Lost { at: 0, count: expected - length })
            }
            Some(expected) if expected < length => return None,
            // Who is heard here begins with unit and function, unless those were lost.
            None if self.context.speaker.is_some() && !begins && self.lacks_something(&bytes[strays..]) => {
                Some(Harm::Lost { at: 0, count: 0 })
            }
            _ => None,
        };
        Some(Piece { start: strays, end: to, direction: due, head: Vec::new(), short: true, harm, unknown: true, wrong: 0 })
    }

    /// Whether the bytes up to here are nothing but a piece of a frame: in one go, by the clock, on a line with few strays.
    pub(super) fn quiet(&self, to: usize) -> bool {
        let known = self.input.timed || self.is_by_itself();
        known && self.is_clean() && self.model.strays_at_most() < to && !(1..to).any(|at| self.stops(at))
    }

    /// Whether the bytes behind a piece are neither strays nor a frame that was recognised, on a line where bytes go
    /// missing: how many between the piece's beginning and their end, nobody knows. An intruder goes on behind a frame, too.
    pub(super) fn runs_on(&self, piece: &Piece) -> bool {
        let behind = self.length - piece.end;
        let whole = mending_bit(&self.bytes()[piece.start..piece.end]).is_some();
        let loses = self.is_by_itself() || (self.model.loses_bytes() && !self.announced);
        loses && self.is_clean() && piece.harm.is_none() && behind > self.model.strays_at_most() && !whole
    }

    /// Whether the line is silent behind the strays that begin here, as behind those of a driver; who collides goes on.
    pub(super) fn over_behind(&self, strays: usize) -> bool {
        let bytes = self.input.bytes();
        let end = strays + bytes[strays..].iter().take(MOST_GLITCH).take_while(|&&byte| byte == bytes[strays]).count();
        let behind = if self.announced { bytes.len() } else { self.length };
        if end >= behind {
            return true;
        }
        if self.input.timed {
            self.input.pause_before(end).is_some_and(|pause| pause >= self.silence)
        } else {
            self.model.has_unit(bytes[end])
        }
    }

    /// Whether no unit of this line begins these bytes, or one does, and not so many are announced.
    pub(super) fn lacks_something(&self, bytes: &[u8]) -> bool {
        let &[unit, code, ref body @ ..] = bytes else { return true };
        let row = self.context.functions.row(code & !EXCEPTION_BIT, body);
        let lengths = row.map(|row| [&row.request, &row.response].map(|layout| layout.extent(body)));
        let announced = lengths.into_iter().flatten().any(|length| match length {
            Extent::Exactly(length) => (length + AROUND..=length + AROUND + MOST_GLITCH).contains(&bytes.len()),
            _ => false,
        });
        let fixed = lengths.is_some_and(|lengths| lengths.iter().all(|length| matches!(length, Extent::Exactly(_))));
        let begins = self.model.has_unit(unit) && !(self.is_by_itself() && fixed);
        !begins && !announced
    }

    /// Whether the bytes behind a frame that lost its end are its own last ones: the silence before them is as long as
    /// what is missing between.
    pub(super) fn goes_on(&self, piece: &Piece) -> bool {
        let (Some(Harm::Lost { count, .. }), Some(char_ns)) = (piece.harm, self.input.char_ns) else { return false };
        let Some(missing) = count.checked_sub(self.length - piece.end).filter(|&missing| missing > 0) else { return false };
        let expected = missing as Ns * char_ns;
        let late = if self.input.coarse { COARSE_STOP / 2 } else { 2 * char_ns };
        let pause = self.input.pause_before(piece.end);
        pause.is_some_and(|pause| (pause - expected).abs() <= late.max(expected / 8))
    }
}

/// Whether these are the first bytes of the answer, and no strays: on a line with few of those, one byte in 256 is the unit
/// that was asked.
fn begun(bytes: &[u8], asked: Asked<'_>) -> bool {
    let code = || bytes.get(1).is_none_or(|code| asked.pdu.first() == Some(&(code & !EXCEPTION_BIT)));
    bytes.len() <= 2 && !glitch(bytes[0]) && bytes[0] == asked.unit && code()
}
