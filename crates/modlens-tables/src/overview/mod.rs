//! What happened over time: series of a bus, of the requests to each unit, and of the values of registers; and transactions to
//! look at. It is what a report draws beside the statistics of the engine.
//!
//! **Memory is bounded.** The resolution of series falls with their number (`series`), and there are at most [`MAX_BUSES`] buses,
//! [`MAX_REQUESTS`] pairs of unit and function, [`registers::MAX_VALUES`] values. What there is no room for is counted.
//!
//! **Parts merge.** Parts of a recording, observed apart and merged in order, give what one pass gives.

mod bus;
mod examples;
mod line;
mod registers;
mod requests;
mod series;
mod times;

use std::borrow::Borrow;
use std::collections::{BTreeMap, BTreeSet};

use modlens_engine::records::{Batch, Connection, End, ExchangeRun, Part, Transaction};
use modlens_protocol::source::Clock;
use modlens_protocol::timestamp::time_text;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use crate::columns::each_value;
use bus::{Axis, BusOverview, RowKind};
use examples::Examples;
use line::{bus_columns, request_columns};
use registers::{Place, MAX_VALUES};
pub use requests::MAX_REQUESTS;
use series::resolution;

/// Buses that have series.
pub const MAX_BUSES: usize = 64;

/// Connections that are listed.
const MAX_CONNECTIONS: usize = 200;

/// Collects what happened over a whole recording.
///
/// ```
/// use modlens_engine::session::{BusOptions, Session};
/// use modlens_readers::chunk::Chunk;
/// use modlens_tables::overview::Overview;
/// let mut session = Session::default();
/// let bus = session.add_bus(BusOptions::named("line"));
/// session.feed(bus, &Chunk { bytes: &[0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87], ..Chunk::default() });
/// session.flush();
/// let mut overview = Overview::default();
/// overview.observe(&session.take());
/// let found = overview.json(&[]);
/// assert_eq!(found["buses"][0]["line"]["transactions"], serde_json::json!([1]));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Overview {
    buses: Vec<BusOverview>,
    examples: Examples,
    connections: Vec<Json>,
    more_connections: u64,
    left_out: LeftOut,
    /// Neither the values of registers nor examples are collected.
    is_of_courses: bool,
}

/// What there was no room for.
#[derive(Clone, Debug, Default, PartialEq)]
struct LeftOut {
    /// Hashes of names, to count each bus once.
    buses: BTreeSet<u64>,
    transactions: u64,
    values: u64,
    /// Parts whose clock was of another kind than the part before.
    parts: u64,
}

impl Overview {
    /// One that collects the time series of lines and units alone: without values of registers, without examples, and without rows
    /// for the requests of each function.
    pub fn of_courses() -> Self {
        Self { is_of_courses: true, ..Self::default() }
    }

    /// Adds the rows of a batch. It has to have frames and transactions.
    pub fn observe(&mut self, batch: &Batch) {
        for connection in &batch.connections {
            if self.connections.len() < MAX_CONNECTIONS {
                self.connections.push(connection_json(connection));
            } else {
                self.more_connections += 1;
            }
        }
        self.frames(batch);
        for part in batch.transaction_parts() {
            match part {
                Part::Compact(run) if self.is_of_courses && run.packets.is_none() => self.exchanges(batch, run),
                Part::Compact(run) => {
                    self.transactions(batch, (0..run.exchanges.length as usize).map(|at| batch.compact_row(run, at)));
                }
                Part::Rows(rows) => {
                    for rows in rows.chunk_by(|row, next| row.bus == next.bus) {
                        self.transactions(batch, rows);
                    }
                }
            }
        }
        if !self.is_of_courses {
            self.values(batch);
        }
    }

    fn frames(&mut self, batch: &Batch) {
        let most = self.bus_resolution();
        for part in batch.frame_parts() {
            match part {
                Part::Compact(run) => {
                    if let Some(at) = self.bus_at(batch, run.bus, false) {
                        self.buses[at].compact_frames(batch, run, most);
                    }
                }
                Part::Rows(rows) => {
                    for rows in rows.chunk_by(|row, next| row.bus == next.bus) {
                        let is_utc = batch.buses[rows[0].bus as usize].clock == Clock::Utc;
                        let has_time = if is_utc { rows[0].start } else { rows[0].elapsed }.is_some();
                        if let Some(at) = self.bus_at(batch, rows[0].bus, has_time) {
                            for row in rows {
                                self.buses[at].frame(row, most);
                            }
                        }
                    }
                }
            }
        }
    }

    /// Adds transactions of one bus; at least one.
    fn transactions(&mut self, batch: &Batch, rows: impl IntoIterator<Item: Borrow<Transaction>>) {
        let (line, of_requests, of_values) = (self.bus_resolution(), self.request_resolution(), self.value_resolution());
        let (mut requests, mut values) = (self.requests(), self.registers());
        let mut rows = rows.into_iter().peekable();
        let Some(first) = rows.peek().map(Borrow::borrow) else { return };
        let Some(at) = self.bus_at(batch, first.bus, time_of(batch, first).is_some()) else { return };
        let bus = &mut self.buses[at];
        for row in rows {
            let row = row.borrow();
            let position = bus.place(RowKind::Transaction, time_of(batch, row), Some(row.number));
            bus.line.at(position, line).transaction(row);
            let shift = bus.axis.shift();
            let Some(of_function) = bus.requests_of((row.unit, row.function), &mut requests) else {
                self.left_out.transactions += 1;
                continue;
            };
            of_function.series.at(position, of_requests).transaction(row);
            if self.is_of_courses {
                continue;
            }
            self.examples.add(batch, row, &mut of_function.examples[row.status as usize]);
            if row.points.is_none() {
                let (before, place) = (bus.registers.values, Place { position, shift, most: of_values });
                let room = MAX_VALUES - (values - before);
                self.left_out.values += bus.registers.transaction(batch, row, place, room) as u64;
                values += bus.registers.values - before;
            }
        }
    }

    /// Adds compact exchanges to the time series.
    fn exchanges(&mut self, batch: &Batch, run: &ExchangeRun) {
        let (line, of_requests, mut requests) = (self.bus_resolution(), self.request_resolution(), self.requests());
        let Some(at) = self.bus_at(batch, run.bus, false) else { return };
        let bus = &mut self.buses[at];
        let exchanges = run.exchanges.of(&batch.exchanges);
        bus.each_bucket(RowKind::Transaction, run.number, exchanges, line, |bucket, exchanges| {
            bucket.exchanges(exchanges);
        });
        let is_numbered = bus.axis == Axis::Transactions;
        for (exchange, number) in exchanges.iter().zip(run.number..) {
            let position = if is_numbered { number as i64 } else { bus.last[RowKind::Transaction as usize] };
            match bus.requests_of((exchange.unit, exchange.function), &mut requests) {
                Some(of_function) => of_function.series.at(position, of_requests).exchange(exchange.status()),
                None => self.left_out.transactions += 1,
            }
        }
    }

    /// Adds the values of units that have a profile.
    fn values(&mut self, batch: &Batch) {
        let has_profile = batch.transactions.iter().any(|row| row.points.is_some())
            || batch.exchange_runs.iter().any(|run| run.points.is_some());
        if !has_profile {
            return;
        }
        let most = self.value_resolution();
        each_value(batch, |part| {
            let row = part.transaction;
            if row.points.is_none() {
                return;
            }
            let others = self.registers();
            let Some(at) = self.bus_at(batch, row.bus, time_of(batch, row).is_some()) else { return };
            let bus = &mut self.buses[at];
            let position = bus.place(RowKind::Transaction, time_of(batch, row), Some(row.number));
            let room = MAX_VALUES - (others - bus.registers.values);
            let place = Place { position, shift: bus.axis.shift(), most };
            self.left_out.values += bus.registers.value(&part, place, room) as u64;
        });
    }

    /// Adds what was observed of the part of the recording after this one.
    pub fn merge(&mut self, later: &Self) {
        for bus in &later.buses {
            match self.buses.iter().position(|own| own.name == bus.name) {
                Some(at) if self.buses[at].axis != bus.axis => self.left_out.parts += 1,
                Some(at) => self.merge_bus(at, bus),
                None if self.buses.len() == MAX_BUSES => self.left_out.add_bus(&bus.name),
                None => self.buses.push(bus.clone()),
            }
        }
        self.examples.merge(&later.examples);
        for connection in &later.connections {
            if self.connections.len() < MAX_CONNECTIONS {
                self.connections.push(connection.clone());
            } else {
                self.more_connections += 1;
            }
        }
        self.more_connections += later.more_connections;
        self.left_out.buses.extend(&later.left_out.buses);
        self.left_out.transactions += later.left_out.transactions;
        self.left_out.values += later.left_out.values;
        self.left_out.parts += later.left_out.parts;
    }

    fn merge_bus(&mut self, at: usize, later: &BusOverview) {
        let (line, of_requests, of_values) = (self.bus_resolution(), self.request_resolution(), self.value_resolution());
        let (mut requests, room) = (self.requests(), MAX_VALUES - (self.registers() - self.buses[at].registers.values));
        let own = &mut self.buses[at];
        own.settings = later.settings.or(own.settings);
        own.last = later.last;
        own.line.merge(&later.line, line);
        // In order: which ones there is room for must not depend on that in which they came.
        for (key, counts) in later.requests.sorted() {
            if let Some(index) = own.requests.find(key) {
                let own = own.requests.at(index);
                own.series.merge(&counts.series, of_requests);
                own.examples.iter_mut().zip(counts.examples).for_each(|(own, more)| *own = (*own).min(more));
            } else if requests < MAX_REQUESTS {
                requests += 1;
                own.requests.add(counts.clone());
            }
        }
        self.left_out.values += own.registers.merge(&later.registers, of_values, room) as u64;
    }

    /// Everything as JSON; `docs/stats.schema.json` describes it. `wanted` are the numbers of transactions that have to be among
    /// the examples if they are known.
    pub fn json(&self, wanted: &[u64]) -> Json {
        let mut overview = json!({
            "buses": null, "connections": self.connections, "examples": null,
            "left_out": {
                "buses": self.left_out.buses.len(), "transactions": self.left_out.transactions,
                "values": self.left_out.values, "connections": self.more_connections, "parts": self.left_out.parts,
            },
        });
        // What is large is put in here and below: the macro would copy it.
        overview["buses"] = self.buses.iter().map(|bus| self.bus_json(bus)).collect();
        overview["examples"] = self.examples.json(wanted);
        overview
    }

    fn bus_json(&self, bus: &BusOverview) -> Json {
        let Some(range) = bus.line.range() else { return Json::Null };
        let has_clock = bus.axis != Axis::Transactions;
        let has_load = has_clock && bus.settings.is_some();
        let line = range.within(self.bus_resolution());
        let of_requests = bus.common(bus.requests.iter().filter_map(|one| one.series.range()), self.request_resolution());
        let of_values = bus.common(bus.registers.range().into_iter(), self.value_resolution());
        // The text of the time series draws units only; these rows would be most of the document.
        let shown = if self.is_of_courses { BTreeMap::new() } else { bus.requests.sorted() };
        let requests: Vec<Json> = shown
            .into_iter()
            .map(|((unit, function), counts)| {
                let mut row = json!({"unit": unit, "function": function});
                let columns = request_columns(&counts.series.cut_to(of_requests));
                let (Json::Object(row), Json::Object(columns)) = (&mut row, columns) else { unreachable!("both are maps") };
                row.extend(columns);
                Json::Object(std::mem::take(row))
            })
            .collect();
        let mut columns = bus.axis.steps(line);
        let (Json::Object(all), Json::Object(more)) = (&mut columns, bus_columns(&bus.line.cut_to(line), has_clock, has_load))
        else {
            unreachable!("both are maps")
        };
        all.extend(more);
        let mut found = json!({
            "bus": bus.name, "source": bus.source, "settings": bus.settings.map(|line| line.to_string()), "axis": bus.axis.text(),
            "line": null,
            "requests": {"steps": bus.axis.steps(of_requests), "rows": null, "units": bus.units_json(of_requests)},
            "registers": {"steps": bus.axis.steps(of_values), "rows": null},
        });
        found["line"] = columns;
        found["requests"]["rows"] = requests.into();
        found["registers"]["rows"] = bus.registers.json(of_values);
        found
    }

    /// The index here of the bus with this index in the batch; `None` if there is no room for it.
    fn bus_at(&mut self, batch: &Batch, index: u32, has_time: bool) -> Option<usize> {
        let row = &batch.buses[index as usize];
        let found = self.buses.iter().position(|bus| bus.name == row.name);
        if let Some(at) = found {
            self.buses[at].settings = row.line.or(self.buses[at].settings);
            return found;
        }
        if self.buses.len() == MAX_BUSES {
            self.left_out.add_bus(&row.name);
            return None;
        }
        self.buses.push(BusOverview::new(row, has_time));
        Some(self.buses.len() - 1)
    }

    fn requests(&self) -> usize {
        self.buses.iter().map(|bus| bus.requests.len()).sum()
    }

    fn registers(&self) -> usize {
        self.buses.iter().map(|bus| bus.registers.values).sum()
    }

    fn bus_resolution(&self) -> usize {
        resolution(2048, self.buses.len(), 32, 1024)
    }

    fn request_resolution(&self) -> usize {
        resolution(8192, self.requests(), 16, 256)
    }

    fn value_resolution(&self) -> usize {
        resolution(32_768, self.registers(), 16, 256)
    }
}

impl LeftOut {
    fn add_bus(&mut self, name: &str) {
        if self.buses.len() < MAX_BUSES * 1024 {
            self.buses.insert(modlens_protocol::mix::mix(
                name.bytes().fold(0, |hash, byte| modlens_protocol::mix::mix(hash ^ u64::from(byte))),
            ));
        }
    }
}

/// The time of a transaction on the clock of its bus.
#[inline]
fn time_of(batch: &Batch, row: &Transaction) -> Option<Ns> {
    match batch.buses[row.bus as usize].clock {
        Clock::Utc => row.start,
        _ => row.elapsed,
    }
}

fn connection_json(row: &Connection) -> Json {
    let time = |time: Option<Ns>| time.filter(|_| row.clock == Clock::Utc).map(time_text);
    let findings: Vec<&str> = row.findings.iter().map(|finding| finding.doc().code).collect();
    json!({
        "connection": row.number, "client": row.client, "client_port": row.client_port, "server": row.server,
        "opened": time(row.opened), "closed": time(row.closed), "closed_by": row.closed_by.map(End::text),
        "refused": row.is_refused, "reset": row.is_reset, "requests": row.requests, "writes": row.writes, "answered": row.answered,
        "in_flight_max": row.in_flight_max, "lockstep": row.lockstep,
        "retransmitted_segments": row.retransmitted_segments, "lost_bytes": row.lost_bytes, "findings": findings,
    })
}
