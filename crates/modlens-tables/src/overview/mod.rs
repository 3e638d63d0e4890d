//! What happened over time: series of a bus, of the requests to each unit, and of the values of registers; and transactions to
//! look at. It is what a report draws beside the statistics of the engine.
//!
//! **Memory is bounded.** The resolution of series falls with their number (`series`), and there are at most [`MAX_BUSES`] buses,
//! [`MAX_REQUESTS`] pairs of unit and function, [`registers::MAX_VALUES`] values. What there is no room for is counted.
//!
//! **Parts merge.** Parts of a recording, observed apart and merged in order, give what one pass gives.

mod examples;
mod line;
mod registers;
mod requests;
mod series;
mod times;

use std::borrow::Borrow;
use std::collections::{BTreeMap, BTreeSet};

use modlens_engine::records::{Batch, Bus, Connection, End, Exchange, ExchangeRun, Frame, Part, Transaction};
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::Clock;
use modlens_protocol::timestamp::time_text;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use crate::columns::each_value;
use examples::Examples;
use line::{bus_columns, p95_column, request_columns, us, BusBucket, RequestBucket};
use registers::{Place, Registers, MAX_VALUES};
use requests::{Requests, RequestsOfBus};
use series::{resolution, Bucket, Range, Series};

/// Buses that have series.
pub const MAX_BUSES: usize = 64;

/// Pairs of unit and function that have series, all buses taken together.
pub const MAX_REQUESTS: usize = 1024;

/// Connections that are listed.
const MAX_CONNECTIONS: usize = 200;

/// The finest bucket of time is two to the power of this wide: a millisecond.
const TIME_SHIFT: u32 = 20;

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

/// By what a bus's series go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    /// Time since 1970.
    Utc,
    /// Time since the beginning of the recording.
    Relative,
    /// The number of the transaction, where there is no clock.
    Transactions,
}

#[derive(Clone, Copy)]
enum RowKind {
    Frame,
    Transaction,
}

#[derive(Clone, Debug, PartialEq)]
struct BusOverview {
    name: String,
    source: String,
    settings: Option<LineSettings>,
    axis: Axis,
    /// Where the last frame and the last transaction were, for rows without a time.
    last: [i64; 2],
    line: Series<BusBucket>,
    requests: RequestsOfBus,
    registers: Registers,
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

impl BusOverview {
    fn new(row: &Bus, has_time: bool) -> Self {
        let axis = match row.clock {
            Clock::Utc if has_time => Axis::Utc,
            Clock::Relative if has_time => Axis::Relative,
            _ => Axis::Transactions,
        };
        Self {
            name: row.name.clone(),
            source: row.source.clone(),
            settings: row.line,
            axis,
            last: [0; 2],
            line: Series::new(axis.shift()),
            requests: RequestsOfBus::default(),
            registers: Registers::default(),
        }
    }

    /// Where a row is: by its time, or by its number where the bus has no clock. A row that has neither is where the last one
    /// was.
    #[inline]
    fn place(&mut self, rows: RowKind, time: Option<Ns>, number: Option<u64>) -> i64 {
        let position = match self.axis {
            Axis::Transactions => number.map(|number| number as i64),
            _ => time,
        };
        let last = &mut self.last[rows as usize];
        *last = position.unwrap_or(*last);
        *last
    }

    /// The requests of one function to one unit; `None` if there is no room for them. `count` is how many there are of all buses.
    #[inline]
    fn requests_of(&mut self, unit_and_function: (u8, u8), count: &mut usize) -> Option<&mut Requests> {
        let index = self.requests.find(unit_and_function).or_else(|| self.add_requests(unit_and_function, count))?;
        Some(self.requests.at(index))
    }

    #[cold]
    fn add_requests(&mut self, unit_and_function: (u8, u8), count: &mut usize) -> Option<usize> {
        (*count < MAX_REQUESTS).then(|| {
            *count += 1;
            self.requests.add(Requests::new(unit_and_function, self.axis.shift()))
        })
    }

    #[inline]
    fn frame(&mut self, row: &Frame, most: usize) {
        let time = if self.axis == Axis::Utc { row.start } else { row.elapsed };
        let position = self.place(RowKind::Frame, time, row.txn);
        self.line.at(position, most).frame(row);
        self.busy(position, row.wire.length, most);
    }

    /// Adds the frames of compact exchanges.
    fn compact_frames(&mut self, batch: &Batch, run: &ExchangeRun, most: usize) {
        let exchanges = run.exchanges.of(&batch.exchanges);
        self.each_bucket(RowKind::Frame, run.number, exchanges, most, BusBucket::good_frames);
        if self.axis == Axis::Transactions || self.settings.is_none() {
            return;
        }
        let position = self.last[RowKind::Frame as usize];
        for length in exchanges.iter().flat_map(|exchange| exchange.lengths) {
            self.busy(position, length.into(), most);
        }
    }

    /// Adds consecutive exchanges without times, the first of which has this number, to the buckets of the line: as many at a
    /// time as lie in one.
    fn each_bucket(
        &mut self,
        rows: RowKind,
        number: u64,
        exchanges: &[Exchange],
        most: usize,
        add: impl Fn(&mut BusBucket, &[Exchange]),
    ) {
        let (mut number, mut rest) = (number, exchanges);
        while !rest.is_empty() {
            let position = self.place(rows, None, Some(number));
            // Room is made before it is known where the bucket ends: it may become wider.
            self.line.at(position, most);
            // Without numbers, all of them are where the last row was.
            let count = match self.axis {
                Axis::Transactions => rest.len().min((self.line.bucket_end(position) - position) as usize),
                _ => rest.len(),
            };
            let (own, others) = rest.split_at(count);
            add(self.line.at(position, most), own);
            self.place(rows, None, Some(number + count as u64 - 1));
            (number, rest) = (number + count as u64, others);
        }
    }

    /// Adds the time that a frame of this length takes, where there is a clock.
    #[inline]
    fn busy(&mut self, position: i64, length: u32, most: usize) {
        if let Some(line) = self.settings.filter(|_| self.axis != Axis::Transactions) {
            let busy = line.char_ns() * i64::from(length);
            let width = self.line.width();
            if position & (width - 1) <= width - busy {
                self.line.at(position, most).busy += busy;
            } else {
                self.add_busy(position, busy, most);
            }
        }
    }

    /// Shares the time that a frame took among the buckets that it lies in.
    #[cold]
    fn add_busy(&mut self, start: i64, busy: Ns, most: usize) {
        // The last bucket first: it may make all others wider.
        self.line.at(start + busy - 1, most);
        let width = self.line.width();
        let (mut from, end) = (start, start + busy);
        while from < end {
            let until = ((from & !(width - 1)) + width).min(end);
            self.line.at(from, most).busy += until - from;
            from = until;
        }
    }

    /// The 95th percentile of each unit's response times, all functions taken together.
    fn units_json(&self, range: Range) -> Json {
        let mut units: BTreeMap<u8, Vec<RequestBucket>> = BTreeMap::new();
        for ((unit, _), counts) in self.requests.sorted() {
            let more = counts.series.cut_to(range);
            match units.get_mut(&unit) {
                Some(own) => own.iter_mut().zip(&more).for_each(|(own, more)| own.merge(more)),
                None => drop(units.insert(unit, more)),
            }
        }
        units.iter().map(|(unit, buckets)| json!({"unit": unit, "p95_us": p95_column(buckets)})).collect()
    }

    /// The range of the bus in buckets that are wide enough for all these series.
    fn common(&self, series: impl Iterator<Item = Range>, most: usize) -> Range {
        self.line.range().into_iter().chain(series).reduce(Range::with).expect("the bus has rows").within(most)
    }
}

impl Axis {
    fn text(self) -> &'static str {
        match self {
            Self::Utc => "utc",
            Self::Relative => "relative",
            Self::Transactions => "transactions",
        }
    }

    fn shift(self) -> u32 {
        match self {
            Self::Transactions => 0,
            _ => TIME_SHIFT,
        }
    }

    /// Where the buckets of a range begin, and how wide each is: in microseconds, or in transactions.
    fn steps(self, range: Range) -> Json {
        let (start, step) = (range.first << range.shift, 1i64 << range.shift);
        let count = range.last - range.first + 1;
        match self {
            Self::Transactions => json!({"start": start, "step": step, "count": count}),
            _ => json!({"start": us(start), "step": us(step), "count": count}),
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
