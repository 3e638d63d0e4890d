//! The fast path on an RTU line without a clock, for compact exchanges: a run of them in one loop over the bytes (`compact_run`).
//!
//! It takes the exchanges that `rtu_batch` takes there, and refusals, and leaves the session as that does. What follows from the
//! bytes of a request alone is found once: the requests of a poll cycle come again and again, byte by byte the same. Of these
//! only what differs from one to the next is learned at once, the rest at the end of a run of them.

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::fast_path::rtu_exchange::LastExchange;
use crate::findings::{words, REFUSED};
use crate::records::{ExchangeRun, Span, NOT_REFUSED};
use crate::session::decoder::Decoder;
use crate::session::exchanges::compact_run::{CompactRun, RunBytes, RunContext};
use crate::session::exchanges::matching::RtuRun;
use crate::session::exchanges::run::{BatchTotals, ExchangeEnd};
use crate::session::rows::FindingPlace;
use modlens_protocol::framing::Mode;

impl Decoder {
    /// Emits the RTU exchanges at the head of the only line of the bus with this index as compact exchanges, until one does not
    /// qualify. The caller has made sure that `emits_compact` holds, and that nothing is open.
    ///
    /// The framer learns the units, functions and requests of a run one by one, and what is the same of all exchanges at once.
    pub(super) fn emit_contiguous(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        let plain = line.input.plain_untimed_bytes(Mode::Rtu);
        let Some(framer) = line.framer.rtu_mut().filter(|_| plain > 0) else { return };
        let bytes = &line.input.bytes()[..plain];
        let known = RunContext {
            functions: &self.functions,
            framer,
            pairing: &mut state.pairing,
            reads: &mut state.memo,
            profiles: &mut state.profiles,
            units: [&mut state.known_units, &mut state.paired_units],
            stats: &mut self.stats,
            counts: state.counts,
        };
        let (first, arena_start) = (self.batch.exchanges.len(), self.batch.arena.len());
        let mut run = CompactRun::default();
        let block = RunBytes::new(&known, bytes, arena_start);
        let odds = run.take(known, &block, &mut self.batch.exchanges);
        let Some(at) = run.last else { return };
        let expected = ExpectedExchange::announced_by(&self.functions, Mode::Rtu, &bytes[at..]).expect("it was matched");
        let is_refused = self.batch.exchanges.last().is_some_and(|exchange| exchange.exception != NOT_REFUSED);
        let expected = if is_refused { expected.refused() } else { expected };
        self.end_compact_run(bus, first, &run, LastExchange { expected, odds });
        if run.refusals > 0 && self.wanted.findings {
            self.report_refusals();
        }
    }

    /// Consumes the bytes of a run, of which `last` is the last exchange, and does what is done once for all of it. `first` is
    /// the index of its first exchange in the batch.
    fn end_compact_run(&mut self, bus: usize, first: usize, run: &CompactRun, last: LastExchange) {
        let state = &mut self.buses[bus];
        let input = &mut state.lines[0].1.input;
        let (offset, bytes) = (input.offset(), run.length);
        input.consume(bytes);
        self.batch.arena.extend_from_slice(input.consumed_bytes(bytes));
        let count = (self.batch.exchanges.len() - first) as u32;
        state.pairing.record_untimed_exchanges(count, count - run.mirrored);
        let exchanges = Span { start: first as u32, length: count };
        let (number, frame) = (self.next_txn, self.next_frame);
        // Nothing of the run has changed a profile.
        let points = state.profiles.now();
        self.batch.exchange_runs.push(ExchangeRun { bus: bus as u32, number, frame, offset, exchanges, packets: None, points });
        self.next_txn += u64::from(count);
        self.next_frame += 2 * u64::from(count);
        let totals = BatchTotals { exchanges: u64::from(count), bytes };
        self.end_run(bus, Mode::Rtu, &totals, (&mut RtuRun::ended_by(last), ExchangeEnd::newest(&self.batch, self.next_txn)));
    }

    /// Adds the rows of the findings on those exchanges of the run emitted last that were refused.
    fn report_refusals(&mut self) {
        let Some(run) = self.batch.exchange_runs.last() else { return };
        for (at, exchange) in run.exchanges.of(&self.batch.exchanges).iter().enumerate() {
            if exchange.exception == NOT_REFUSED {
                continue;
            }
            let row = run.transaction(&self.batch.exchanges, &[], at);
            let place = FindingPlace {
                frame: Some(row.response.frame),
                txn: Some(row.number),
                bus: row.bus as usize,
                start: None,
                recording_start: self.origin,
                unit: Some(row.unit),
                origin: row.origin,
            };
            self.batch.findings.push(place.row(REFUSED, words::exception(exchange.exception)));
        }
    }
}
