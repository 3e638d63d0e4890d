//! Exchanges that come again.
//!
//! Most traffic is a poll cycle. Of a request that was answered before without anything to tell, all is known but the
//! values of the next answer, and whether that arrives whole: it needs no search, no pairing and no checks. The rows are
//! those of the long way, which every chunking that parts a request from its answer takes (`tests/properties.rs`).

use std::sync::Arc;

use crate::checksum::crc_valid_at;
use crate::direction::Direction;
use crate::framer::rtu::{answer, SURE};
use crate::framer::{CutBy, Mode, Verdict};
use crate::functions::{Extent, Functions, Row};
use crate::pairing::Exchange;
use crate::pdu::u16_at;
use crate::points::sunspec::may_begin_in;
use crate::points::Bound;
use crate::records::{Frame, Half, Span, Status, Transaction};
use crate::session::bus::learn_side;
use crate::session::moment::{Moment, Setting};
use crate::session::rows::elapsed;
use crate::session::Session;
use crate::stats::Key;
use crate::Ns;

/// A request that reads has so many bytes, its checksum among them (application protocol, 6.1 to 6.4).
const REQUEST: usize = 8;

/// Unit, function and count.
const HEAD: usize = 3;

/// Requests that are known of one bus at once, and places that one of them may take.
const PLACES: usize = 1024;
const WAYS: usize = 4;

/// A request that was answered, and what its answer is like.
#[derive(Clone, Copy)]
struct Known {
    request: [u8; REQUEST],
    head: [u8; HEAD],
    /// Bits of its last data byte that were not asked for.
    padding: u8,
    /// Bytes of the answer, checksum included.
    length: usize,
    key: Key,
}

/// The requests of one bus that were answered.
#[derive(Default)]
pub(super) struct Routine {
    places: Vec<Option<Known>>,
    /// The place that the next newcomer takes, of those that it may take.
    turn: usize,
}

impl Routine {
    #[inline]
    fn find(&self, bytes: &[u8]) -> Option<&Known> {
        let request = bytes.first_chunk()?;
        let ways = self.places.get(place(request)..)?.iter().take(WAYS);
        ways.flatten().find(|known| known.request == *request)
    }

    /// Takes note of a transaction that nothing was found on.
    pub(super) fn learn(&mut self, functions: &Functions, exchange: &Exchange) {
        if !exchange.sure || exchange.status != Status::Ok || exchange.mode != Mode::Rtu || exchange.retry_of.is_some() {
            return;
        }
        let Ok(request) = <[u8; REQUEST]>::try_from(&exchange.request.wire[..]) else { return };
        if self.find(&request).is_some() {
            return;
        }
        let Some(known) = Known::of(functions, request, exchange) else { return };
        self.places.resize(PLACES + WAYS, None);
        let ways = &mut self.places[place(&request)..][..WAYS];
        let free = ways.iter().position(Option::is_none);
        ways[free.unwrap_or(self.turn % WAYS)] = Some(known);
        self.turn += usize::from(free.is_none());
    }
}

/// Where a request is looked for.
#[inline]
fn place(request: &[u8; REQUEST]) -> usize {
    // An odd number without pattern (the golden ratio's bits) spreads what differs in few bits.
    (u64::from_le_bytes(*request).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 54) as usize % PLACES
}

impl Known {
    /// Only answers of which the table tells the length, and nothing about their values but padding bits.
    fn of(functions: &Functions, request: [u8; REQUEST], exchange: &Exchange) -> Option<Self> {
        let pdu = exchange.request.pdu();
        let row = functions.row(pdu[0], &pdu[1..]).filter(|row| !row.mirrored)?;
        let (count, length) = answer(row, pdu)?;
        let judged_by_values = row.permits[1].iter().any(|permit| permit.offset + permit.width > 1);
        // The old answer once more may look like this request.
        let ambiguous = row.response.extent(&pdu[1..]) == Extent::Exactly(REQUEST - 4);
        let marked = may_begin_in(u16_at(pdu, 1)?, usize::from(count) / 2);
        if judged_by_values || ambiguous || marked || exchange.response.wire.len() != length {
            return None;
        }
        let head = [exchange.unit, pdu[0], count];
        Some(Self { request, head, padding: padding(row, pdu), length, key: Key::of(functions, exchange) })
    }

    /// Whether these bytes begin with a whole answer.
    #[inline]
    fn answered(&self, bytes: &[u8]) -> bool {
        let padded = |last: usize| self.padding & bytes[last] == 0;
        bytes.len() >= self.length && bytes[..HEAD] == self.head && padded(self.length - 3) && crc_valid_at(bytes, self.length)
    }
}

fn padding(row: &Row, request: &[u8]) -> u8 {
    let bits = row.roles.response_block.is_some_and(|(_, bits)| bits);
    let quantity = row.roles.quantity.and_then(|at| u16_at(&request[1..], at)).unwrap_or(0);
    match quantity % 8 {
        rest @ 1.. if bits => 0xFF << rest,
        _ => 0,
    }
}

impl Session {
    /// Tells exchanges at the head of the input, as long as each is one that came before.
    pub(super) fn routine(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        let [(_, line)] = &state.lines[..] else { return };
        if state.routine.find(line.input.bytes()).is_none() || !state.pairing.idle() {
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
        while let Some(known) = state.routine.find(line.input.bytes()) {
            let bytes = &line.input.bytes()[..REQUEST + known.length.min(line.input.bytes().len() - REQUEST)];
            let (request, response) = bytes.split_at(REQUEST);
            let Some(points) = state.profiles.settled(known.head[0]).filter(|_| known.answered(response)) else { break };
            let patience = if setting.clocked { state.pairing.patience() } else { Ns::MAX };
            if !line.input.holds_exchange(REQUEST, known.length, patience) || !framer.again(request, response) {
                break;
            }
            let wire = self.batch.keep(bytes);
            let asked = Moment::of(&line.input, REQUEST, &setting);
            line.input.consume(REQUEST);
            let answered =
                Moment::of(&line.input, known.length, &Setting { last_end: asked.end.or(setting.last_end), ..setting });
            line.input.consume(known.length);
            setting.last_end = answered.end.or(asked.end).or(setting.last_end);
            learn_side(&mut state.sides, asked.side, Direction::Request);
            learn_side(&mut state.sides, answered.side, Direction::Response);
            let response_time = state.pairing.since(asked.end, answered.start, answered.clean_start);
            state.pairing.again(response_time);
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
