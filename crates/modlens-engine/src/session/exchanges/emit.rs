//! What a session makes of a matched exchange, whatever its framing: its rows or its compact form, and what is learned from it.

use crate::findings::{words, REFUSED};
use crate::records::{
    Exchange, ExchangeRun, ExchangeTiming, Frame, FrameRef, PacketPair, PacketsOfRun, Span, Transaction, NOT_REFUSED,
};
use crate::session::bus::{learn_side, BusState, FROM_CLIENT, FROM_SERVER};
use crate::session::decoder::Decoder;
use crate::session::exchanges::matching::{MatchedExchange, LENGTH_AT};
use crate::session::exchanges::run::{Form, Run};
use crate::session::frame_timing::FrameTiming;
use crate::session::held_exchanges::ExchangeStart;
use crate::session::in_flight::AnswerShape;
use crate::session::rows::{elapsed, FindingPlace};
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{DelimitedBy, Mode, Verdict};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Where the bytes of an exchange are in the arena: first the request's, then the response's right after them.
pub(super) struct ExchangePlaces {
    /// Its bytes as they were on the lines.
    pub wires: [Span; 2],
    /// The decoded PDUs, where the lines carry characters; else they are parts of the `wires`.
    pub pdus: Option<[Span; 2]>,
}

impl Decoder {
    /// Emits a matched exchange, whose bytes are consumed; `timings` say when and where its frames were.
    ///
    /// The session then has the state in which the slow path would leave it: what the bus has learned (`learn_exchange`), the
    /// request's statistics, and the next numbers (one transaction, two frames). The memo keeps the request, and the run counts
    /// the exchange. Left to the end of the run are the statistics of the bus, the last response and the framer.
    #[inline(always)]
    #[allow(clippy::inline_always)] // The body of two loops: as a call, most of its time goes to passing the arguments.
    pub(super) fn emit_exchange(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        places: &ExchangePlaces,
        timings: [FrameTiming; 2],
        run: &mut Run,
    ) {
        let state = &mut self.buses[bus];
        let [request, response] = &timings;
        let starts = request.start.zip(response.start).map(<[Ns; 2]>::from);
        if let (Some(starts), Some(_)) = (starts, matched.mbap_id) {
            let status = if matched.exception == NOT_REFUSED { Status::Ok } else { Status::Exception };
            let answer = (matched.mbap_id, AnswerShape::of(&matched.expected));
            state.connection.note_exchange((self.next_txn, status), answer, starts, &state.pairing);
        }
        let response_time = learn_exchange(state, matched, &timings).filter(|&ns| ns >= run.min_measurable_ns);
        let (expected, key) = (&matched.expected, matched.expected.key());
        if matched.exception == NOT_REFUSED {
            let spans = [request.span(), response.span()];
            self.stats.record_exchange(state.counts, (key, matched.counters), spans, response_time);
            if matched.counters.is_none() && matched.mode != Mode::Ascii {
                let wire = places.wires[0].of(&self.batch.arena);
                let request = if matched.mode == Mode::Tcp { &wire[LENGTH_AT..] } else { wire };
                state.memo.keep(&mut self.stats, state.counts, request, expected);
            }
        } else {
            self.record_refusal(bus, matched, starts, response_time, request.origin);
        }
        if self.wanted.transactions || self.wanted.frames {
            let pair = starts.map(|starts| PacketPair {
                starts,
                gap: request.gap.into(),
                response_time: response_time.into(),
                packet: request.origin,
                mbap_id: matched.mbap_id.unwrap_or(0),
            });
            let confidence = matched.transaction_confidence();
            let exchange = expected.compact(places.wires[0].start, matched.lengths, confidence, matched.exception);
            if self.wanted.frames {
                self.push_frames(bus, matched, places, &timings);
            }
            match pair.filter(|_| run.form != Form::Rows) {
                Some(pair) => self.push_compact(bus, exchange, pair, matched.mode),
                None => self.push_transaction(bus, matched, (&exchange, pair.as_ref()), places, &timings),
            }
        }
        run.totals.exchanges += 1;
        run.totals.bytes += matched.lengths[0] + matched.lengths[1];
        self.next_txn += 1;
        self.next_frame += 2;
    }

    /// Counts an exchange of a connection that was refused, and adds its finding, if findings are wanted.
    #[cold]
    fn record_refusal(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        times: Option<[Ns; 2]>,
        response_time: Option<Ns>,
        origin: u64,
    ) {
        let (counts, unit) = (self.buses[bus].counts, matched.expected.unit);
        self.stats.record_refusal(counts, (matched.expected.key(), matched.exception), times, response_time);
        if let Some([first, last]) = times {
            self.stats.record_run_times(counts, first, last);
        }
        if self.wanted.findings {
            let place = FindingPlace {
                frame: Some(self.next_frame + 1),
                txn: Some(self.next_txn),
                bus,
                start: times.map(|[asked, _]| asked),
                recording_start: self.origin,
                unit: Some(unit),
                origin,
            };
            self.batch.findings.push(place.row(REFUSED, words::exception(matched.exception)));
        }
    }

    /// Appends a compact exchange with times to `held`, if transactions are wanted.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn push_compact(&mut self, bus: usize, exchange: Exchange, pair: PacketPair, mode: Mode) {
        if self.wanted.transactions {
            let (number, frame, recording_start) = (self.next_txn, self.next_frame, self.origin);
            let start = ExchangeStart { bus: bus as u32, number, frame, recording_start, mode };
            self.held.exchanges.push(exchange, pair, &start);
        }
    }

    /// Appends the rows of the two frames of an exchange to the batch, as on the slow path.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn push_frames(&mut self, bus: usize, matched: &MatchedExchange, places: &ExchangePlaces, timings: &[FrameTiming; 2]) {
        let findings = Span { start: self.batch.codes.len() as u32, length: 0 };
        let line = self.buses[bus].lines[0].0;
        let lines = if matched.mbap_id.is_some() { [FROM_CLIENT, FROM_SERVER] } else { [line; 2] };
        for (at, direction) in [Direction::Request, Direction::Response].into_iter().enumerate() {
            let row = frame_row(matched, direction, &timings[at]);
            let elapsed = elapsed(self.origin, row.start);
            let (number, line, wire, txn) = (self.next_frame + at as u64, lines[at], places.wires[at], Some(self.next_txn));
            self.batch.frames.push(Frame { number, bus: bus as u32, line, wire, elapsed, txn, findings, ..row });
        }
    }

    /// Appends the row of the transaction of an exchange to `held`, if transactions are wanted, as on the slow path. It is that of
    /// the compact exchange, but for what this has no room for.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn push_transaction(
        &mut self,
        bus: usize,
        matched: &MatchedExchange,
        (exchange, pair): (&Exchange, Option<&PacketPair>),
        places: &ExchangePlaces,
        timings: &[FrameTiming; 2],
    ) {
        let findings = Span { start: self.batch.codes.len() as u32, length: 0 };
        let (number, frame, mode, recording_start) = (self.next_txn, self.next_frame, matched.mode, self.origin);
        if self.wanted.transactions {
            let packets = pair.map(|_| PacketsOfRun { first: 0, recording_start, mode });
            let exchanges = Span { start: 0, length: 1 };
            let run = ExchangeRun { bus: bus as u32, number, frame, offset: timings[0].offset, exchanges, packets, points: None };
            let timing = pair.map(|pair| ExchangeTiming { pair, recording_start });
            let row = run.transaction_of(exchange, 0, exchange.start, timing);
            let [request, response] = [(row.request, 0), (row.response, 1)].map(|(frame, at)| {
                let pdu = places.pdus.map_or(frame.pdu, |pdus| pdus[at]);
                FrameRef { pdu, end: timings[at].end, ..frame }
            });
            let points = self.buses[bus].profiles.of_unit(matched.expected.unit);
            let origin = timings[0].origin;
            self.held.push(Transaction { mode, request, response, findings, points, origin, ..row });
        }
    }
}

/// Learns from an exchange what the recording's words for a sender mean, what pairing learns, and that its unit is known and was
/// paired. Returns the time from the end of the request to the start of the response; `None` without a clock.
#[inline(always)]
#[allow(clippy::inline_always)] // As above.
fn learn_exchange(state: &mut BusState, matched: &MatchedExchange, [request, response]: &[FrameTiming; 2]) -> Option<Ns> {
    let expected = &matched.expected;
    learn_side(&mut state.side_votes, request.side, Direction::Request);
    learn_side(&mut state.side_votes, response.side, Direction::Response);
    let response_time = state.pairing.measurable_interval(request.end, response.start, response.clean_start);
    let is_mirrored = expected.echoes_request && matched.exception == NOT_REFUSED;
    let poll_pause = request.gap.filter(|_| expected.echoes_request);
    state.pairing.record_exchange(matched.mbap_id, expected.echoes_request);
    state.pairing.learn_times(poll_pause, response_time, is_mirrored);
    if matched.mbap_id.is_none() {
        state.pairing.learn_interval(request.start, request.end);
    }
    state.note_paired(expected.unit);
    response_time
}

/// Returns the row of the request's frame, or of the response's for any other `direction`, with what follows from the exchange
/// and its times. Verdict, confidence and what delimits the frame are those that the framer of the mode would give.
#[inline(always)]
#[allow(clippy::inline_always)] // A row is large, and the caller moves it into its table at once.
fn frame_row(matched: &MatchedExchange, direction: Direction, timing: &FrameTiming) -> Frame {
    let delimited_by = if matched.mode == Mode::Ascii { DelimitedBy::Delimiter } else { DelimitedBy::Length };
    let direction_bits = if direction == Direction::Request { u8::MAX } else { matched.response_bits() };
    Frame {
        number: 0,
        bus: 0,
        line: 0,
        offset: timing.offset,
        wire: Span::default(),
        start: timing.start,
        end: timing.end,
        elapsed: None,
        gap: timing.gap,
        pauses: timing.pauses,
        mode: matched.mode,
        direction,
        unit: Some(matched.expected.unit),
        code: Some(matched.expected.code),
        exception: None,
        verdict: Verdict::Ok,
        unconfirmed: false,
        confidence: direction_bits.min(matched.request_confidence()),
        delimited_by,
        txn: None,
        mbap_id: matched.mbap_id,
        findings: Span::default(),
        origin: timing.origin,
        last_origin: timing.last_origin,
        side: timing.side,
    }
}

/// Returns the places of a request that starts at this index of the arena, and of the response right after it. Lengths in bytes.
pub(super) fn adjacent_spans(start: usize, [request_length, response_length]: [usize; 2]) -> [Span; 2] {
    let span = |start: usize, length: usize| Span { start: start as u32, length: length as u32 };
    [span(start, request_length), span(start + request_length, response_length)]
}
