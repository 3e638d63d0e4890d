//! Exchanges that need no thought.
//!
//! Most traffic is reads that are answered at once. Where a unit and a function are known, nothing is open, and a request
//! that asks for what may be asked for is followed by just the answer it announces, there is nothing to search, to pair
//! or to find. The rows are those of the long way, which every chunking that parts a request from its answer takes
//! (`tests/properties.rs`).

use std::ops::RangeInclusive;
use std::sync::Arc;

use crate::checksum::crc_valid_at;
use crate::direction::Direction;
use crate::framer::rtu::SURE;
use crate::framer::{CutBy, Mode, Verdict};
use crate::functions::{Functions, Plain};
use crate::points::sunspec::may_begin_in;
use crate::points::Bound;
use crate::records::{Frame, Half, Span, Status, Transaction};
use crate::session::bus::learn_side;
use crate::session::moment::{Moment, Setting};
use crate::session::rows::elapsed;
use crate::session::Session;
use crate::stats::Key;
use crate::Ns;

/// Units that may be asked without anything to be said of it (serial line specification, 2.2).
const ADDRESSES: RangeInclusive<u8> = 1..=247;

/// A request that reads has so many bytes, its checksum among them (application protocol, 6.1 to 6.4).
const REQUEST: usize = 8;

/// Unit, function and count.
const HEAD: usize = 3;

/// What the answer to a request is like, if it is a plain one.
struct Expected {
    head: [u8; HEAD],
    /// Bytes of the answer, checksum included.
    length: usize,
    /// Bits of its last data byte that were not asked for.
    padding: u8,
    key: Key,
}

impl Expected {
    /// Of a request at the head of these bytes that asks for what may be asked for.
    #[inline]
    fn of(functions: &Functions, bytes: &[u8]) -> Option<Self> {
        let request: &[u8; REQUEST] = bytes.first_chunk()?;
        let [unit, code, high, low, ..] = *request;
        let row = functions.row(code, &request[2..]).filter(|_| ADDRESSES.contains(&unit))?;
        let kind = row.plain?;
        let (address, quantity) = (u16::from_be_bytes([high, low]), u16::from_be_bytes([request[4], request[5]]));
        let allowed = row.permits[0].iter().all(|permit| permit.violated_by(&request[2..6]).is_none());
        let count = if kind == Plain::Bits { quantity.div_ceil(8) } else { quantity.saturating_mul(2) };
        // The old answer once more may look like this request; and the profile of a unit may begin there.
        let ambiguous = usize::from(high) + HEAD + 2 == REQUEST;
        let marked = kind == Plain::Registers && may_begin_in(address, usize::from(quantity));
        if !allowed || ambiguous || marked {
            return None;
        }
        let rest = quantity % 8;
        let padding = if kind == Plain::Bits && rest > 0 { 0xFF << rest } else { 0 };
        let head = [unit, code, u8::try_from(count).ok()?];
        Some(Self { head, length: HEAD + usize::from(count) + 2, padding, key: Key::reading(unit, code, address, quantity) })
    }

    /// Whether these bytes begin with a whole answer.
    #[inline]
    fn answered(&self, bytes: &[u8]) -> bool {
        let padded = |last: usize| self.padding & bytes[last] == 0;
        bytes.len() >= self.length && bytes[..HEAD] == self.head && padded(self.length - 3) && crc_valid_at(bytes, self.length)
    }
}

impl Session {
    /// Tells exchanges at the head of the input, as long as each is one that came before.
    pub(super) fn routine(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        let [(_, line)] = &state.lines[..] else { return };
        if !state.pairing.idle() {
            return;
        }
        // What silences say is told of each frame.
        let silences = line.input.timed && state.options.rule().is_some();
        if silences || state.jumped || line.ahead.is_some() {
            return;
        }
        let mut setting = state.setting(0);
        let told_apart = 2 * state.coarsest();
        let (id, line) = &mut state.lines[0];
        let Some(framer) = line.framer.routine().filter(|framer| framer.settled(line.input.offset())) else { return };
        let mut last = None;
        while let Some(known) = Expected::of(&self.functions, line.input.bytes()) {
            let unit = known.head[0];
            let (request, rest) = line.input.bytes().split_at(REQUEST);
            let Some(points) = state.profiles.settled(unit).filter(|_| known.answered(rest)) else { break };
            let response = &rest[..known.length];
            let patience = if setting.clocked { state.pairing.patience() } else { Ns::MAX };
            let together = line.input.holds_exchange(REQUEST, known.length, patience);
            if !(together && crc_valid_at(request, REQUEST) && framer.again(request, response)) {
                break;
            }
            let wire = self.batch.keep(&line.input.bytes()[..REQUEST + known.length]);
            let asked = Moment::of(&line.input, REQUEST, &setting);
            asked.between(&line.input, (self.next_frame, REQUEST), setting.place, &mut self.batch.between);
            line.input.consume(REQUEST);
            let answered =
                Moment::of(&line.input, known.length, &Setting { last_end: asked.end.or(setting.last_end), ..setting });
            answered.between(&line.input, (self.next_frame + 1, known.length), setting.place, &mut self.batch.between);
            line.input.consume(known.length);
            setting.last_end = answered.end.or(asked.end).or(setting.last_end);
            learn_side(&mut state.sides, asked.side, Direction::Request);
            learn_side(&mut state.sides, answered.side, Direction::Response);
            let response_time = state.pairing.since(asked.end, answered.start, answered.clean_start);
            state.pairing.again(unit, response_time);
            (state.known_units[usize::from(unit)], state.paired_units[usize::from(unit)]) = (true, true);
            let told = Told {
                number: self.next_txn,
                frame: self.next_frame,
                bus: bus as u32,
                line: *id,
                head: known.head,
                request: Span { length: REQUEST as u32, ..wire },
                response: Span { start: wire.start + REQUEST as u32, length: known.length as u32 },
                asked,
                answered,
                response_time: response_time.filter(|&ns| ns >= told_apart),
                recording: self.origin,
            };
            self.stats.again(state.counts, known.key, wire.length as usize, [asked.span(), answered.span()], told.response_time);
            self.next_txn += 1;
            self.next_frame += 2;
            last = Some((told.request, told.response));
            if self.wanted.frames {
                let findings = self.batch.keep_codes(&[]);
                self.batch.frames.push(told.frame(Direction::Request, findings));
                self.batch.frames.push(told.frame(Direction::Response, findings));
            }
            if self.wanted.transactions {
                self.held.push(told.transaction(points, self.batch.keep_codes(&[])));
            }
        }
        if let Some((request, response)) = last {
            let (request, response) = (request.of(&self.batch.arena), response.of(&self.batch.arena));
            framer.resume(request, response, line.input.offset());
            state.pairing.resume(response[0], &response[1..response.len() - 2]);
            line.last_end = setting.last_end;
        }
    }
}

/// One exchange as its rows have it.
struct Told {
    number: u64,
    /// The request's; the answer has the next.
    frame: u64,
    bus: u32,
    line: u8,
    head: [u8; HEAD],
    request: Span,
    response: Span,
    asked: Moment,
    answered: Moment,
    response_time: Option<Ns>,
    /// When the recording began.
    recording: Option<Ns>,
}

impl Told {
    fn transaction(&self, points: Option<Arc<Bound>>, findings: Span) -> Transaction {
        let half = |frame: u64, wire: Span, start: Option<Ns>| {
            let pdu = Span { start: wire.start + 1, length: wire.length - 3 };
            Half { frame, wire, pdu, start }
        };
        Transaction {
            number: self.number,
            bus: self.bus,
            mode: Mode::Rtu,
            start: self.asked.start,
            elapsed: elapsed(self.recording, self.asked.start),
            unit: self.head[0],
            function: self.head[1],
            status: Status::Ok,
            exception: None,
            response_time: self.response_time,
            waited: None,
            late_response: None,
            retry_of: None,
            late_for: None,
            gap: self.asked.gap,
            mbap_id: None,
            request: half(self.frame, self.request, self.asked.start),
            response: half(self.frame + 1, self.response, self.answered.start),
            findings,
            points,
            origin: self.asked.origin,
        }
    }

    fn frame(&self, direction: Direction, findings: Span) -> Frame {
        let (number, wire, moment) = match direction {
            Direction::Request => (self.frame, self.request, &self.asked),
            _ => (self.frame + 1, self.response, &self.answered),
        };
        Frame {
            number,
            bus: self.bus,
            line: self.line,
            offset: moment.offset,
            wire,
            start: moment.start,
            elapsed: elapsed(self.recording, moment.start),
            gap: moment.gap,
            mode: Mode::Rtu,
            direction,
            unit: Some(self.head[0]),
            code: Some(self.head[1]),
            exception: None,
            verdict: Verdict::Ok,
            tentative: false,
            confidence: SURE,
            cut_by: CutBy::Length,
            txn: Some(self.number),
            mbap_id: None,
            findings,
            origin: moment.origin,
            last_origin: moment.last_origin,
        }
    }
}
