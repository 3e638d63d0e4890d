//! The usage of buses: who asks for what, how often, with which outcome, values and response times.

use std::collections::BTreeMap;

use modlens_engine::records::{Batch, Transaction};
use modlens_protocol::source::Clock;
use modlens_protocol::status::Status;
use modlens_protocol::timestamp::time_text;
use modlens_protocol::Ns;
use modlens_tables::columns::{read_data, read_range, write_data, write_range, Items};
use serde_json::{json, Map, Value as Json};

use crate::distribution::{deciles, phases, rounded};
use crate::MAX_BUSES;
use modlens_engine::durations::Durations;

/// Distinct requests that are counted on a bus.
pub const MAX_REQUESTS: usize = 4096;

/// Distinct values of a register that are kept; one with more has a range.
const MAX_VALUES: usize = 8;

/// What is asked for. A function that reads and writes counts as one request of each kind.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestKey {
    /// Address of the client; `None` on a serial line, where it is the master.
    pub client: Option<String>,
    /// Unit.
    pub unit: u8,
    /// Function code.
    pub function: u8,
    /// Whether it writes.
    pub writes: bool,
    /// First address and quantity; `None` for functions without them.
    pub range: Option<(u16, u16)>,
}

/// The values that one register has had.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Values {
    /// Lowest and highest.
    pub range: Option<(i32, i32)>,
    /// All of them, while they are few, and how often each was seen.
    pub few: BTreeMap<i32, u64>,
    /// How often a value differed from the one before.
    pub changes: u64,
    last: Option<i32>,
}

impl Values {
    fn add(&mut self, value: i32) {
        let (low, high) = self.range.unwrap_or((value, value));
        self.range = Some((low.min(value), high.max(value)));
        if self.few.len() <= MAX_VALUES {
            *self.few.entry(value).or_default() += 1;
        }
        self.changes += u64::from(self.last.is_some_and(|last| last != value));
        self.last = Some(value);
    }

    /// What the register is: written and seldom another value, or written by somebody, is a setpoint.
    fn judged(&self, writes: bool, is_written: bool, count: u64) -> &'static str {
        match (writes, is_written) {
            (true, _) if self.is_list() || 2 * self.changes < count => "setpoint",
            (false, true) => "setpoint",
            (false, false) if self.changes == 0 => "constant",
            _ => "state",
        }
    }

    /// Whether `few` holds all values.
    pub fn is_list(&self) -> bool {
        self.few.len() <= MAX_VALUES
    }
}

/// What is known of one request.
#[derive(Clone, Debug, Default)]
pub struct Habit {
    /// How often it was sent.
    pub count: u64,
    /// When first and last.
    pub times: Option<(Ns, Ns)>,
    /// From one to the next.
    pub intervals: Durations,
    /// Response times of good responses.
    pub responses: Durations,
    /// How often it ended how: `ok`, `no_response`, `exception 2` ...
    pub outcomes: BTreeMap<String, u64>,
    /// Values read or written, a register each.
    pub values: Vec<Values>,
    /// The first transaction.
    pub first_txn: u64,
}

/// Whether a request is about bits, and not about registers.
fn is_bits(key: &RequestKey) -> bool {
    matches!(key.function, 1 | 2 | 5 | 15)
}

/// The first address and that after the last one.
fn ends((first, quantity): (u16, u16)) -> (u32, u32) {
    (u32::from(first), u32::from(first) + u32::from(quantity))
}

/// The usage of one bus.
#[derive(Clone, Debug, Default)]
pub struct BusUsage {
    /// Its requests.
    pub requests: BTreeMap<RequestKey, Habit>,
    /// Time of the first and of the last transaction.
    pub times: Option<(Ns, Ns)>,
    /// Whether times are those of a clock.
    pub has_dates: bool,
    /// Transactions whose request was one too many to be counted.
    pub not_counted: u64,
}

/// The usage of all buses.
#[derive(Clone, Debug, Default)]
pub struct Usage {
    /// By the name of the bus.
    pub buses: BTreeMap<String, BusUsage>,
    /// Transactions on buses that are one too many.
    pub not_counted: u64,
}

impl Usage {
    /// Counts the transactions of a batch.
    pub fn observe(&mut self, batch: &Batch) {
        batch.all_transactions().iter().for_each(|row| self.count(batch, row));
    }

    /// Counts one of the transactions of a batch.
    pub fn count(&mut self, batch: &Batch, row: &Transaction) {
        let bus = &batch.buses[row.bus as usize];
        if !self.buses.contains_key(&bus.name) {
            if self.buses.len() >= MAX_BUSES {
                self.not_counted += 1;
                return;
            }
            self.buses.insert(bus.name.clone(), BusUsage { has_dates: bus.clock == Clock::Utc, ..BusUsage::default() });
        }
        let client = bus.network.as_ref().map(|network| network.client.as_str());
        self.buses.get_mut(&bus.name).expect("just inserted").add(batch, row, client);
    }

    /// All of it as JSON: what `Usual::new` reads, and what a baseline holds.
    pub fn json(&self) -> Json {
        json!({"bus": self.buses.iter().map(|(name, bus)| bus.json(name)).collect::<Vec<_>>()})
    }
}

impl BusUsage {
    fn add(&mut self, batch: &Batch, row: &Transaction, client: Option<&str>) {
        let time = row.start.or(row.elapsed);
        if let Some(time) = time {
            let (first, last) = self.times.unwrap_or((time, time));
            self.times = Some((first.min(time), last.max(time)));
        }
        // A response alone says nothing about who asked; a damaged request nothing about what was asked.
        if matches!(row.status, Status::Unsolicited | Status::BadRequest) {
            return;
        }
        let (read, written) = (read_range(batch, row), write_range(batch, row));
        let is_other = read.is_none() && written.is_none();
        for (writes, range) in [(false, read), (true, written)] {
            if range.is_none() && (writes || !is_other) {
                continue;
            }
            let data = if writes { write_data(batch, row) } else { read_data(batch, row) };
            let key = RequestKey { client: client.map(str::to_owned), unit: row.unit, function: row.function, writes, range };
            self.count(key, row, time, data);
        }
    }

    fn count(&mut self, key: RequestKey, row: &Transaction, time: Option<Ns>, data: Option<Items<'_>>) {
        if self.requests.len() >= MAX_REQUESTS && !self.requests.contains_key(&key) {
            self.not_counted += 1;
            return;
        }
        let habit = self.requests.entry(key).or_insert_with(|| Habit { first_txn: row.number, ..Habit::default() });
        habit.count += 1;
        if let Some(time) = time {
            if let Some((_, last)) = habit.times.filter(|_| row.retry_of.is_none()) {
                habit.intervals.add(time - last);
            }
            habit.times = Some((habit.times.map_or(time, |times| times.0), time));
        }
        if let Some(response_time) = row.response_time.filter(|_| row.status == Status::Ok) {
            habit.responses.add(response_time);
        }
        let outcome = match (row.status, row.exception) {
            (Status::Exception, Some(code)) => format!("exception {code}"),
            // What the recording does not show is no outcome.
            (Status::NotObserved, _) => return,
            (status, _) => status.text().to_owned(),
        };
        *habit.outcomes.entry(outcome).or_default() += 1;
        let Some(data) = data.filter(|_| row.status != Status::BadResponse) else { return };
        habit.values.resize_with(habit.values.len().max(data.len()), Values::default);
        (0..data.len()).for_each(|at| habit.values[at].add(data.get(at)));
    }

    fn json(&self, name: &str) -> Json {
        let date = |ns: Ns| if self.has_dates { json!(time_text(ns)) } else { Json::Null };
        let hours = self.times.map(|(first, last)| (last - first) as f64 / 3.6e12);
        json!({
            "name": name, "since": self.times.map(|times| date(times.0)), "until": self.times.map(|times| date(times.1)),
            "hours": hours.map(rounded), "not_counted": self.not_counted,
            "request": self.requests.iter().map(|(key, habit)| habit.json(key, self.judged(key, habit))).collect::<Vec<_>>(),
        })
    }

    /// Which registers of a request are setpoints, state, or constant, in words: `setpoint 200, state 201-203`.
    fn judged(&self, key: &RequestKey, habit: &Habit) -> Option<String> {
        let (first, _) = key.range?;
        let written =
            self.requests.keys().filter(|other| other.writes && other.unit == key.unit && is_bits(other) == is_bits(key));
        let written: Vec<(u32, u32)> = written.filter_map(|other| other.range).map(ends).collect();
        let is_input = matches!(key.function, 2 | 4);
        let mut runs: Vec<(&str, u32, u32)> = Vec::new();
        for (at, values) in habit.values.iter().enumerate() {
            let address = u32::from(first) + at as u32;
            let is_written = !is_input && written.iter().any(|(begin, end)| (*begin..*end).contains(&address));
            let word = values.judged(key.writes, is_written, habit.count);
            match runs.last_mut() {
                Some((last, _, end)) if *last == word => *end = address,
                _ => runs.push((word, address, address)),
            }
        }
        let text = |(word, begin, end): &(&str, u32, u32)| {
            let last = if begin == end { String::new() } else { format!("-{end}") };
            format!("{word} {begin}{last}")
        };
        (!runs.is_empty()).then(|| runs.iter().map(text).collect::<Vec<_>>().join(", "))
    }
}

impl Habit {
    fn json(&self, key: &RequestKey, judged: Option<String>) -> Json {
        let mut row = Map::new();
        let mut put = |name: &str, value: Json| {
            if !value.is_null() {
                row.insert(name.to_owned(), value);
            }
        };
        put("client", json!(key.client));
        put("unit", json!(key.unit));
        put("function", json!(key.function));
        put("writes", if key.writes { json!(true) } else { Json::Null });
        put("address", json!(key.range.map(|range| range.0)));
        put("quantity", json!(key.range.map(|range| range.1)));
        put("count", json!(self.count));
        put("period_s", if self.intervals.count == 0 { Json::Null } else { json!(phases(&self.intervals)) });
        put("outcomes", json!(self.outcomes));
        put("response_time", if self.responses.count == 0 { Json::Null } else { deciles(&self.responses) });
        put("judged", json!(judged));
        put("values", if self.values.is_empty() { Json::Null } else { self.values.iter().map(Values::json).collect() });
        Json::Object(row)
    }
}

impl Values {
    /// `[changes, value, ...]` of a register with few values, `[changes, low, high, "range"]` of another.
    fn json(&self) -> Json {
        let mut all = vec![json!(self.changes)];
        match self.range {
            Some((low, high)) if !self.is_list() => all.extend([json!(low), json!(high), json!("range")]),
            _ => all.extend(self.few.keys().map(|value| json!(value))),
        }
        Json::Array(all)
    }
}
