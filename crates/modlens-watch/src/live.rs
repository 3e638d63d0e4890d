//! What rules and a baseline find while rows come: each thing once, as soon as it is seen.
//!
//! Usage is counted over the current hour, so that what begins after weeks is seen at once, and over ten minutes, because
//! a period or a response time that moves is a minority in the hour that was as usual before it. A deviation that
//! lasts is reported when it begins; it is reported again after it was absent for an hour.

use std::collections::BTreeMap;
use std::sync::Arc;

use modlens_engine::records::Batch;
use modlens_protocol::Ns;
use serde_json::Value as Json;

use crate::compare::compare;
use crate::usage::Usage;
use crate::usual::Usual;

/// The time over which usage is compared with the baseline.
const LONG: Ns = 3_600_000_000_000;

/// The same for what moves. It is compared once, when it is over: many looks at few requests find what is none.
const SHORT: Ns = 600_000_000_000;

/// What the short time is compared for.
const MOVING: [&str; 2] = ["period_moved", "response_time_shifted"];

/// Rows are compared with the baseline at most so often where batches are small, as those of a tap.
const STEP: Ns = 1_000_000_000;

/// And so often within a batch, as those of a file, but not before there are as many rows as requests to compare.
const LONG_STEP: Ns = 30_000_000_000;

/// What cannot be said within a batch, which may have the rows of one bus before those of another.
const OF_ALL_BUSES: &str = "missing_bus";

/// Compares rows with a baseline while they come.
#[derive(Debug)]
pub struct Live {
    usual: Usual,
    hour: Window,
    minutes: Window,
    compared: Option<Ns>,
    /// Rows since then.
    rows: usize,
    /// Each deviation, with when it was last there.
    present: BTreeMap<String, Option<Ns>>,
}

/// Usage since a time.
#[derive(Debug)]
struct Window {
    length: Ns,
    usage: Usage,
    begun: Option<Ns>,
}

impl Window {
    fn new(length: Ns) -> Self {
        Self { length, usage: Usage::default(), begun: None }
    }

    /// How many requests it has.
    fn requests(&self) -> usize {
        self.usage.buses.values().map(|bus| bus.requests.len()).sum()
    }

    /// Whether it is over.
    fn is_over(&mut self, now: Ns) -> bool {
        now - *self.begun.get_or_insert(now) >= self.length
    }
}

impl Live {
    /// Compares with this baseline.
    pub fn new(usual: Usual) -> Self {
        let (hour, minutes) = (Window::new(LONG), Window::new(SHORT));
        Self { usual, hour, minutes, compared: None, rows: 0, present: BTreeMap::new() }
    }

    /// Counts the rows of a batch; gives the deviations that begin with it, as `compare` lists them.
    pub fn observe(&mut self, batch: &Arc<Batch>) -> Vec<Json> {
        let (mut found, mut latest) = (Vec::new(), None);
        for row in batch.all_transactions() {
            self.hour.usage.count(batch, row);
            self.minutes.usage.count(batch, row);
            latest = latest.max(row.start.or(row.elapsed));
            self.rows += 1;
            if latest.is_some_and(|latest| self.is_due(latest, LONG_STEP)) && self.rows >= self.hour.requests() {
                found.extend(self.deviations_at(latest, |code| code != OF_ALL_BUSES));
            }
        }
        if latest.is_none_or(|latest| self.is_due(latest, STEP)) {
            found.extend(self.deviations_at(latest, |_| true));
        }
        found
    }

    /// The deviations that were not reported yet; for the end of the rows, too.
    pub fn deviations(&mut self) -> Vec<Json> {
        self.deviations_at(self.compared, |_| true)
    }

    fn is_due(&self, latest: Ns, step: Ns) -> bool {
        self.compared.is_none_or(|compared| !(0..step).contains(&(latest - compared)))
    }

    /// Compares; what is new among the deviations at this moment, of the codes that can be said.
    fn deviations_at(&mut self, now: Option<Ns>, can_be_said: impl Fn(&str) -> bool) -> Vec<Json> {
        (self.compared, self.rows) = (now, 0);
        let mut found = compared(&self.usual, &self.hour);
        if now.is_some_and(|now| self.minutes.is_over(now)) {
            let minutes = compared(&self.usual, &self.minutes);
            found.extend(minutes.into_iter().filter(|row| MOVING.iter().any(|code| row["code"] == *code)));
            self.minutes = Window::new(SHORT);
        }
        found.retain(|row| row["code"].as_str().is_some_and(&can_be_said));
        found.retain(|row| {
            let last = self.present.insert(key(row), now);
            last.is_none_or(|last| last.zip(now).is_some_and(|(last, now)| now - last > LONG))
        });
        if let Some(now) = now {
            self.present.retain(|_, last| last.is_none_or(|last| now - last <= LONG));
            if self.hour.is_over(now) {
                self.hour = Window::new(LONG);
            }
        }
        found
    }
}

/// The deviations of a window.
fn compared(usual: &Usual, window: &Window) -> Vec<Json> {
    match compare(usual, &window.usage, false) {
        Json::Array(found) => found,
        _ => Vec::new(),
    }
}

/// What makes two deviations the same.
fn key(row: &Json) -> String {
    ["code", "bus", "client", "unit", "function", "address"].map(|field| row[field].to_string()).join(" ")
}
