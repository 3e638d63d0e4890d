//! Both sides of a gateway: transactions on the network matched with those on its serial line.
//!
//! ```text
//! Batch -> Exchange (network) \   alignment: clocks, server, units, from the first exchanges
//! Batch -> Exchange (line)    /-> matching: by PDU, unit, order, and times that cannot be otherwise
//!                                 -> verdict of each request: forwarded, cached, dropped, late ... -> rows as JSON
//! ```
//!
//! A request on the line was caused by a request on the network with the same PDU that came before it and was not answered
//! before it. Where several could be, the response decides: a gateway returns it at once, so it is the one whose response is
//! the same and came first after that of the line. Only such matches adjust the clocks.
//!
//! **Memory is bounded by time**: a request waits for [`HORIZON`] of the other recording, and the caller feeds the side of
//! which less was read ([`Join::wants`]).

mod alignment;
mod clock;
mod envelope;
mod exchange;
mod hull;
mod line_memory;
mod matching;
mod rows;
mod verdict;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use modlens_tables::columns::{Table, TableKind};
use modlens_tables::predicate::Predicate;
use serde_json::{json, Value as Json};

use alignment::{align, Alignment, SAMPLE};
use clock::ClockPair;
use exchange::{Exchange, Request};
use line_memory::LineMemory;
use rows::Rows;

/// A gateway forwards a request at most so long after it came.
pub const HORIZON: Ns = 10_000_000_000;

/// By so much two clocks that show a date may differ.
pub const REACH: Ns = 600_000_000_000;

/// One of the two recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The capture of the network.
    Network,
    /// The recording of the serial line.
    Line,
}

impl Side {
    fn other(self) -> Self {
        if self == Self::Network {
            Self::Line
        } else {
            Self::Network
        }
    }
}

/// What has come of one side.
#[derive(Debug, Default)]
struct Stream {
    queue: VecDeque<Exchange>,
    first: Option<Ns>,
    last: Option<Ns>,
    count: u64,
    is_over: bool,
    has_dates: bool,
}

/// Joins two recordings of one gateway.
#[derive(Debug, Default)]
pub struct Join {
    filter: Option<Predicate>,
    network: Stream,
    line: Stream,
    alignment: Option<Alignment>,
    clocks: ClockPair,
    /// Unit on the network -> unit on the line, as found so far.
    units: BTreeMap<u8, u8>,
    requests: VecDeque<Request>,
    memory: LineMemory,
    rows: Rows,
}

impl Join {
    /// Joins with a filter of transactions: rows are kept where the transaction of the line, or of the network where there is
    /// none, satisfies it.
    pub fn new(filter: Option<Predicate>) -> Self {
        Self { filter, ..Self::default() }
    }

    /// Takes the transactions of a batch.
    pub fn add(&mut self, side: Side, batch: &Arc<Batch>) {
        let table = Table::new(Arc::clone(batch), TableKind::Transactions);
        for row in 0..table.len() {
            let is_wanted = self.filter.as_ref().is_none_or(|filter| filter.holds(&table, row));
            let Some(one) = Exchange::new(&table, row, is_wanted) else { continue };
            let is_dated = table.transaction(row).is_some_and(|t| batch.buses[t.bus as usize].clock == Clock::Utc);
            let stream = self.stream(side);
            stream.has_dates |= is_dated;
            stream.count += 1;
            stream.first = Some(stream.first.map_or(one.start, |first| first.min(one.start)));
            stream.last = stream.last.max(Some(one.start));
            let at = stream.queue.partition_point(|other| other.start <= one.start);
            stream.queue.insert(at, one);
        }
        self.advance();
    }

    /// Notes that one of the recordings has ended.
    pub fn end(&mut self, side: Side) {
        self.stream(side).is_over = true;
        self.advance();
    }

    /// The recording of which more is needed next; `None` when both have ended.
    pub fn wants(&self) -> Option<Side> {
        let lagging = match (self.network.last, self.line.last) {
            _ if self.alignment.is_none() && self.reach().is_none() => {
                if self.network.queue.len() <= self.line.queue.len() {
                    Side::Network
                } else {
                    Side::Line
                }
            }
            (None, _) => Side::Network,
            (Some(network), Some(line)) if network + self.clocks.offset() <= line => Side::Network,
            _ => Side::Line,
        };
        let is_over = |side| if side == Side::Network { self.network.is_over } else { self.line.is_over };
        [lagging, lagging.other()].into_iter().find(|side| !is_over(*side))
    }

    /// Whether the two recordings were found to have traffic in common; `None` while that is not known.
    pub fn is_aligned(&self) -> Option<bool> {
        let is_over = self.network.is_over && self.line.is_over;
        if self.alignment.is_some() {
            Some(true)
        } else {
            is_over.then_some(false)
        }
    }

    /// The rows that are certain by now, as a list, in the order of time on the network.
    pub fn rows(&mut self) -> Json {
        // Older rows may still come from requests that are open.
        let open = self.requests.front().map(|request| request.exchange.start);
        let waiting = self.network.queue.front().map(|one| one.start);
        let until = open.into_iter().chain(waiting).min();
        self.rows.take(until)
    }

    /// What was found about the gateway: clocks, units, counts of verdicts, timeouts.
    pub fn summary(&self) -> Json {
        let found = self.alignment.as_ref();
        let units: BTreeMap<String, u8> = self.units.iter().map(|(above, below)| (above.to_string(), *below)).collect();
        let rival = found.and_then(|found| found.rival).map(|rival| rival as f64 / 1e9);
        let (matched, outcomes, gateway_timeout, client_timeout) = self.rows.counts();
        json!({
            "server": found.map(|found| &*found.server),
            "network_transactions": self.network.count, "line_transactions": self.line.count, "line_matched": matched,
            "clocks": self.clocks.json(), "rival_offset_s": rival, "units": units, "outcomes": outcomes,
            "gateway_timeout_ms": gateway_timeout, "client_timeout_ms": client_timeout,
            "has_dates": self.network.has_dates,
        })
    }

    fn stream(&mut self, side: Side) -> &mut Stream {
        match side {
            Side::Network => &mut self.network,
            Side::Line => &mut self.line,
        }
    }

    /// By how much the clocks can differ, where both show a date.
    fn reach(&self) -> Option<Ns> {
        (self.network.has_dates && self.line.has_dates).then_some(REACH)
    }

    fn advance(&mut self) {
        if self.alignment.is_none() && !self.try_to_align() {
            return;
        }
        // What the line carries later than a request is decided says nothing about it.
        while self.match_next() {
            self.decide_requests();
        }
        self.decide_requests();
    }

    fn try_to_align(&mut self) -> bool {
        let (Some(network), Some(line)) = (self.network.first, self.line.first) else { return false };
        // What lies before the other recording by more than clocks differ has no counterpart.
        let begin = |other: Ns| self.reach().map_or(Ns::MIN, |reach| other - reach);
        let (from_line, from_network) = (begin(line), begin(network));
        let upstream: Vec<&Exchange> = self.network.queue.iter().filter(|one| one.start >= from_line).take(SAMPLE).collect();
        let below: Vec<&Exchange> = self.line.queue.iter().filter(|one| one.start >= from_network).take(SAMPLE).collect();
        let is_full = |sample: &[&Exchange], stream: &Stream| sample.len() == SAMPLE || stream.is_over;
        if !is_full(&upstream, &self.network) || !is_full(&below, &self.line) {
            return false;
        }
        self.alignment = align(&upstream, &below, self.reach());
        let Some(found) = &self.alignment else { return false };
        self.clocks = ClockPair::new(found.offset);
        self.units.clone_from(&found.units);
        true
    }
}
