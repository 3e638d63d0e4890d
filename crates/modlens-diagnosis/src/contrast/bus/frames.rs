//! What is counted of the frames of a bus, damaged ones and noise among them.

use modlens_engine::records::{Batch, Exchange, ExchangeRun, Frame, Side};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::in_words;
use modlens_protocol::oddity::is_of_driver;
use modlens_protocol::Ns;

use super::super::context::{Around, LEAST_ANSWER_BYTES};
use super::super::good_frame::GoodFrame;
use super::{BusContrast, WINDOW};
use crate::observation::{is_swapped_answer, is_write, write_of_compact, written, FrameObservation, READ_REQUEST_BYTES};

/// A request begins after a silence of 3.5 characters (serial line, 2.5.1.1), rounded down for the clock.
const SILENCE_CHARACTERS: Ns = 3;
/// A character at 115200 baud.
const LEAST_CHAR_NS: Ns = 95_000;

impl BusContrast {
    /// Takes the next frame.
    pub(crate) fn frame(&mut self, mut seen: FrameObservation) {
        self.frames_seen += 1;
        let around = self.context.frame(&seen);
        if seen.place.number == 0 {
            seen.place.number = self.context.last_txn;
        }
        if self.first_frames.len() < WINDOW && self.frames_seen <= WINDOW as u64 {
            self.first_frames.push_back(seen);
        } else {
            self.count_frame(&seen, around);
        }
    }

    /// Takes the next frame if it is good, has no finding and no pauses inside; whether it was taken.
    #[inline]
    pub(crate) fn clean_frame(&mut self, batch: &Batch, row: &Frame) -> bool {
        let is_same_framing = self.facts.mode == Some(row.mode);
        let is_clean = row.verdict.is_good() && row.findings.length == 0 && row.pauses.count == 0 && is_same_framing;
        let is_bare = |good: &GoodFrame| good.is_answered_bare(row.verdict, row.mode, (row.direction, row.unit));
        if self.context.last_good.as_ref().is_some_and(is_bare) {
            return false;
        }
        if !is_clean || self.frames_seen < WINDOW as u64 || self.context.may_be_foreign(row) || is_swapped_answer(batch, row) {
            return false;
        }
        self.context.note_sent(row.side, row.direction, row.number);
        self.frames_seen += 1;
        self.pending += 1;
        self.context.last_txn = row.txn.unwrap_or(self.context.last_txn);
        let sender = (row.direction, row.unit);
        let write = row.code.filter(|code| is_write(*code)).and_then(|_| written(batch, row));
        let good = GoodFrame::after(self.context.last_good, row.number, sender, row.mode, row.code, write);
        self.context.last_good = Some(good.judged(row.verdict).at(row.last_origin, row.side));
        self.count_behind_write(good);
        self.frames.rates.count(row.direction, row.unit, row.pauses, self.facts.char_ns);
        self.frames.count_clean(row);
        true
    }

    /// Takes the frames of a run of compact exchanges.
    pub(in crate::contrast) fn compact_frames(&mut self, run: &ExchangeRun, exchanges: &[Exchange]) {
        if exchanges.is_empty() {
            return;
        }
        let numbered = exchanges.iter().zip(run.number..).zip((run.frame..).step_by(2));
        let mut rest = 0;
        for ((row, txn), frame) in numbered.clone() {
            if self.frames_seen >= WINDOW as u64 {
                break;
            }
            rest += 1;
            self.frame(FrameObservation::of_compact(txn, frame, Direction::Request, row));
            self.frame(FrameObservation::of_compact(txn, frame + 1, Direction::Response, row));
        }
        let count = exchanges.len() as u64;
        let in_bulk = &exchanges[rest..];
        let bytes = in_bulk.iter().map(|row| u64::from(row.lengths[0]) + u64::from(row.lengths[1])).sum();
        self.frames_seen += 2 * in_bulk.len() as u64;
        self.pending += in_bulk.len() as u64;
        self.frames.count_compact(2 * in_bulk.len() as u64, bytes);
        self.facts.mode = Some(Mode::Rtu);
        self.context.last_txn = run.number + count - 1;
        let mut good = self.context.last_good;
        for (at, row) in in_bulk.iter().enumerate() {
            for (frame, direction) in [Direction::Request, Direction::Response].into_iter().enumerate() {
                let number = run.frame + 2 * (rest + at) as u64 + frame as u64;
                let write = is_write(row.function).then_some(row).map(write_of_compact);
                let next = GoodFrame::after(good, number, (direction, Some(row.unit)), Mode::Rtu, Some(row.function), write);
                self.count_behind_write(next);
                good = Some(next);
            }
        }
        self.context.last_good = good;
    }

    fn count_frame(&mut self, seen: &FrameObservation, around: Around) {
        let attached = around.attached;
        self.troubles += u64::from(seen.findings.has_trouble());
        self.facts.mode = Some(seen.mode);
        self.frames.count(seen);
        self.count_line_errors(seen);
        if let Some(behind_write) = around.burst {
            self.noise.by_write[usize::from(behind_write)] += 1;
            let write = self.context.last_good.and_then(|good| good.write());
            if let Some(write) = write.filter(|_| behind_write) {
                self.noise.after_writes.count_burst(write);
            }
        }
        if let Some((_, Some(unit))) = attached.filter(|_| around.is_doubled) {
            self.units.entry(unit).or_default().doubled.count(true, seen.place);
        }
        if seen.verdict.is_good() {
            if let Some(good) = self.context.last_good {
                self.count_behind_write(good);
            }
            self.symptoms.lone_layout(seen);
            if seen.is_swapped {
                self.symptoms.swapped_checksum(seen);
            }
            if let (Some(unit), true) = (seen.unit, around.is_bare_answer) {
                self.units.entry(unit).or_default().bare.count(true, seen.place);
            }
            if let Some(figures) = around.idle_front {
                self.symptoms.idle_front(seen, figures);
            }
            if around.is_foreign {
                self.symptoms.foreign_request(seen);
            }
            if around.is_other_framing {
                self.symptoms.other_framing(seen);
            }
            self.frames.rates.count(seen.direction, seen.unit, seen.pauses, self.facts.char_ns);
            self.count_pause(seen);
            return;
        }
        // A frame without its checksum is whole: a text leaves it out.
        let is_damaged = seen.length >= LEAST_ANSWER_BYTES && seen.bytes.get(1..).and_then(in_words::pdu).is_none();
        self.received_damage += u64::from(seen.side == Some(Side::Received) && is_damaged);
        self.noise.count(seen, attached.is_some_and(|(direction, _)| direction == Direction::Request));
        let is_answer =
            seen.length >= LEAST_ANSWER_BYTES && attached.is_some_and(|(direction, _)| direction == Direction::Request);
        // On Modbus/TCP, only what begins with a header is taken for the answer of a transaction.
        let is_header = self.symptoms.impossible_header(seen);
        // What follows a damaged answer is judged with it, unless it is the unit with which the next one begins.
        let is_next = seen.bytes.len() == 1 && attached.and_then(|(_, unit)| unit) == seen.bytes.first().copied();
        let is_of_answer = seen.mode != Mode::Tcp && (is_answer || (around.is_behind_damage && !is_next));
        if !is_header && seen.txn.is_none() && !is_of_answer {
            self.symptoms.frame(seen, attached.and_then(|(_, unit)| unit), around);
        }
        if let (Some((Direction::Response, Some(unit))), true) = (attached, self.may_be_spoiled_request(seen)) {
            self.units.entry(unit).or_default().spoiled_after.count(true, seen.place);
        }
        if seen.length < LEAST_ANSWER_BYTES && seen.txn.is_none() {
            match attached {
                Some((direction, Some(unit))) => {
                    let side = usize::from(direction != Direction::Request || around.is_behind_damage);
                    self.units.entry(unit).or_default().strays[side].count(true, seen.place);
                }
                _ => self.strays.count(true, seen.place),
            }
        }
    }

    /// Whether these are a few bytes of no transaction, after a silence, and no more than a request has: what is left of one.
    fn may_be_spoiled_request(&self, seen: &FrameObservation) -> bool {
        let silence = SILENCE_CHARACTERS * self.facts.char_ns.unwrap_or(LEAST_CHAR_NS);
        let is_apart = seen.gap.is_some_and(|gap| gap >= silence);
        let is_of_driver = seen.bytes.iter().all(|byte| is_of_driver(*byte));
        seen.mode == Mode::Rtu && seen.txn.is_none() && is_apart && seen.length <= READ_REQUEST_BYTES && !is_of_driver
    }

    /// Counts a frame with parity or framing errors.
    fn count_line_errors(&mut self, seen: &FrameObservation) {
        if let (true, Some(unit)) = (seen.findings.has(Finding::LineError), seen.unit) {
            let side = usize::from(seen.direction != Direction::Request);
            self.units.entry(unit).or_default().line_errors[side].count(true, seen.place);
        }
    }

    /// Counts the pauses inside a frame, with the unit that it was from or to.
    fn count_pause(&mut self, seen: &FrameObservation) {
        let side = match seen.direction {
            _ if seen.pauses.count == 0 => return,
            Direction::Request => 0,
            Direction::Response => 1,
            Direction::Unknown => return,
        };
        if let Some(unit) = seen.unit {
            self.units.entry(unit).or_default().pauses[side].count(seen.pauses, seen.place);
        }
    }

    /// Counts a good frame that belongs to a write, or follows one.
    #[inline]
    fn count_behind_write(&mut self, good: GoodFrame) {
        if good.is_behind_write() {
            self.frames.behind_writes += 1;
            if let Some(write) = good.write() {
                self.noise.after_writes.count_frame(write);
            }
        }
    }
}
