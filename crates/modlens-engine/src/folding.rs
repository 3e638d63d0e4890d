//! Makes compact exchanges of rows, for who keeps millions of them: in a fifth of the memory, a row says the same.
//!
//! The fast path emits compact exchanges where it may (`session::exchanges`). Rows are what is left: of lines whose silences are
//! counted one by one, as those of a tap are, of buses with profiles, of exchanges that went the slow way. Most of them say nothing
//! that a compact exchange has no room for.

use std::sync::Arc;

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::findings::REFUSED;
use crate::records::{Batch, Exchange, ExchangeRun, ExchangeTiming, PacketPair, PacketsOfRun, Span, Transaction, NOT_REFUSED};
use modlens_profiles::points::UnitPlans;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::mbap::PREFIX_BYTES as MBAP_PREFIX_BYTES;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Folds the batches of a session, one after the other.
#[derive(Default)]
pub struct Folder {
    /// For each bus the profiles of its units, as its last rows had them.
    plans: Vec<Arc<UnitPlans>>,
}

impl Folder {
    /// Makes compact exchanges of those transactions with times of which these say all. Frames are not touched.
    pub fn fold(&mut self, batch: &mut Batch) {
        let Some(functions) = batch.functions.clone() else { return };
        let runs = batch.exchange_runs.len();
        let rows = std::mem::take(&mut batch.transactions);
        let mut left = Vec::new();
        for row in rows {
            match compact(&row, batch, &functions) {
                Some((exchange, pair)) => self.push(&row, exchange, pair, batch, runs),
                None => left.push(row),
            }
        }
        batch.transactions = left;
        batch.exchange_runs.sort_by_key(|run| run.number);
    }

    /// Adds an exchange to the run that was begun last, if it goes on there; the runs from `first` on are those of this call.
    fn push(&mut self, row: &Transaction, exchange: Exchange, pair: PacketPair, batch: &mut Batch, first: usize) {
        let points = self.points(row);
        let goes_on = batch.exchange_runs[first..].last_mut().zip(batch.exchanges.last()).filter(|(run, last)| {
            run.bus == row.bus
                && run.end() == row.number
                && run.frame + 2 * u64::from(run.exchanges.length) == row.request.frame
                && run.mode() == row.mode
                && run.packets.is_some_and(|packets| packets.recording_start == recording_start(row))
                && last.start + u32::from(last.lengths[0]) + u32::from(last.lengths[1]) == exchange.start
                && run.points.as_ref().map(Arc::as_ptr) == points.as_ref().map(Arc::as_ptr)
        });
        if let Some((run, _)) = goes_on {
            run.exchanges.length += 1;
        } else {
            let place = Span { start: batch.exchanges.len() as u32, length: 1 };
            batch.exchange_runs.push(ExchangeRun { points, ..run_of(row, place, batch.packet_pairs.len() as u32) });
        }
        batch.exchanges.push(exchange);
        batch.packet_pairs.push(pair);
    }

    /// The profiles of the bus of a row, with that which the row has for its unit.
    fn points(&mut self, row: &Transaction) -> Option<Arc<UnitPlans>> {
        let bus = row.bus as usize;
        if self.plans.len() <= bus {
            self.plans.resize_with(bus + 1, Arc::default);
        }
        let plans = &mut self.plans[bus];
        if plans.of_unit(row.unit).map(Arc::as_ptr) != row.points.as_ref().map(Arc::as_ptr) {
            Arc::make_mut(plans).share(row.unit, row.points.clone());
        }
        (!plans.are_none()).then(|| Arc::clone(plans))
    }
}

/// When the recording began, if the row shows it.
fn recording_start(row: &Transaction) -> Option<Ns> {
    row.start.zip(row.elapsed).map(|(start, elapsed)| start - elapsed)
}

/// The run that begins with the exchange of a row, of which `place` is the place among the exchanges.
fn run_of(row: &Transaction, place: Span, first: u32) -> ExchangeRun {
    let packets = PacketsOfRun { first, recording_start: recording_start(row), mode: row.mode };
    let (bus, number, frame) = (row.bus, row.number, row.request.frame);
    ExchangeRun { bus, number, frame, offset: 0, exchanges: place, packets: Some(packets), points: None }
}

/// The compact exchange that says all that a row does; `None` if there is none.
fn compact(row: &Transaction, batch: &Batch, functions: &Functions) -> Option<(Exchange, PacketPair)> {
    let (mode, starts) = (row.mode, [row.request.start?, row.response.start?]);
    let before = match mode {
        Mode::Tcp => MBAP_PREFIX_BYTES,
        Mode::Rtu => 0,
        Mode::Ascii => return None,
    };
    let [request, response] = [row.request.wire, row.response.wire];
    if row.request.frame == 0 || request.start + request.length != response.start {
        return None;
    }
    let [asked, answered] = [request, response].map(|wire| wire.of(&batch.arena).get(before..));
    let (asked, answered) = (asked?, answered?);
    let expected = ExpectedExchange::from_request(functions, mode, asked)?;
    let codes = row.findings.of(&batch.codes);
    let (expected, exception) = match (row.status, codes) {
        (Status::Ok, []) => (expected, NOT_REFUSED),
        (Status::Exception, [one]) if *one == REFUSED => (expected.refused(), expected.refused_by(answered)?),
        _ => return None,
    };
    let around = if mode == Mode::Tcp { [before; 2] } else { [2; 2] };
    let lengths = [expected.request_bytes + around[0], expected.response_bytes + around[1]];
    let is_whole = lengths == [request.length as usize, response.length as usize];
    if !is_whole || exception == NOT_REFUSED && !expected.is_answered_by(asked, answered) {
        return None;
    }
    let exchange = expected.compact(request.start, lengths, row.confidence, exception);
    let (gap, response_time) = (row.gap.into(), row.response_time.into());
    let pair = PacketPair { starts, gap, response_time, packet: row.origin, mbap_id: row.mbap_id.unwrap_or(0) };
    let run = run_of(row, Span { start: 0, length: 1 }, 0);
    let timing = ExchangeTiming { pair: &pair, recording_start: recording_start(row) };
    says_the_same(row, &run.transaction_of(&exchange, 0, exchange.start, Some(timing))).then_some((exchange, pair))
}

/// Whether two rows say the same, but for the end of their frames, which no table has, and where their findings are.
fn says_the_same(row: &Transaction, made: &Transaction) -> bool {
    let frames = |row: &Transaction| {
        [row.request, row.response].map(|one| (one.frame, [one.wire, one.pdu].map(|span| (span.start, span.length)), one.start))
    };
    let times = |row: &Transaction| [row.start, row.elapsed, row.response_time, row.waited, row.late_response, row.gap];
    let numbers = |row: &Transaction| (row.number, row.bus, row.retry_of, row.late_response_to, row.mbap_id, row.origin);
    let meaning =
        |row: &Transaction| (row.mode, row.unit, row.function, row.status, row.exception, row.confidence, row.unconfirmed);
    frames(row) == frames(made) && times(row) == times(made) && numbers(row) == numbers(made) && meaning(row) == meaning(made)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::records::Bus;
    use crate::session::{BusOptions, Session, WantedTables};
    use modlens_protocol::source::{Clock, Place};
    use modlens_readers::chunk::{Chunk, Times};

    /// Reads of a tap (serial line specification, 2.5.1.1: 8E1), whose settings are known: a request each second, its response
    /// after 20 ms; the fourth is refused, the last not answered before the end.
    fn rows() -> Batch {
        let wanted = WantedTables { frames: true, transactions: true, findings: true };
        let mut session = Session::new(Arc::new(Functions::default()), wanted, false, None);
        let name = String::from("line");
        let (place, clock) = (Place::Packet, Clock::Utc);
        let bus = Bus { name: name.clone(), source: name, place, clock, line: None, network: None };
        let line = Some("19200-8E1".parse().expect("settings"));
        let bus = session.add_bus(BusOptions { bus, mode: Some(Mode::Rtu), line, resolution: None, rule: None });
        let request = [0x01, 0x03, 0x00, 0x00, 0x00, 0x01, 0x84, 0x0a];
        let (answer, refusal) = ([0x01, 0x03, 0x02, 0x00, 0x07, 0xf9, 0x86], [0x01, 0x83, 0x02, 0xc0, 0xf1]);
        for turn in 0..20 {
            let time = 1_000_000_000 + turn * 1_000_000_000;
            session.feed(bus, &Chunk { bytes: &request, times: Times::Read(time), ..Chunk::default() });
            let response: &[u8] = if turn == 3 { &refusal } else { &answer };
            if turn != 19 {
                session.feed(bus, &Chunk { bytes: response, times: Times::Read(time + 20_000_000), ..Chunk::default() });
            }
        }
        session.flush();
        session.take()
    }

    #[test]
    fn what_a_row_says_is_kept_in_less() {
        let mut batch = rows();
        let before = batch.transactions.clone();
        assert_eq!((before.len(), batch.exchanges.len()), (20, 0));
        Folder::default().fold(&mut batch);
        assert_eq!(batch.transactions.iter().map(|row| row.status).collect::<Vec<_>>(), [Status::NotObserved]);
        assert_eq!((batch.exchanges.len(), batch.transaction_count()), (19, 20));
        for (row, made) in before.iter().zip(batch.all_transactions()) {
            assert!(row.status == Status::NotObserved || says_the_same(row, made), "{row:?} {made:?}");
            assert_eq!(row.findings.of(&batch.codes), made.findings.of(&batch.codes));
        }
    }
}
