//! The doctor by bus and day (UTC): what somebody with hundreds of taps looks at first.
//!
//! Each bus has counters for each day of its own, so that a day's trouble is neither diluted by the weeks around it nor told
//! again on the days after it. A row without a time counts for the day of the row before it.

use std::collections::BTreeMap;

use modlens_engine::records::Batch;
use modlens_protocol::functions::Functions;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use serde_json::{json, Value as Json};

use crate::bus_day::bus_day;
use crate::contrast::{Contrast, Counted};
use crate::observation::{FrameObservation, Observation};
use crate::report::Report;
use modlens_protocol::timestamp::time_text;

const DAY_NS: Ns = 86_400_000_000_000;

/// The counters of each bus and day; see the module.
#[derive(Default)]
pub struct Days {
    buses: BTreeMap<String, Bus>,
    /// How many days of a bus are kept, the latest ones.
    kept: Option<usize>,
    /// What the last call of `changed` saw, by bus and date.
    told: BTreeMap<(String, String), String>,
}

/// The days of a bus. The key is the number of the day since 1970, `None` without a date.
#[derive(Default)]
struct Bus {
    days: BTreeMap<Option<i64>, Contrast>,
    /// The day of the last frame and of the last transaction.
    last: [Option<i64>; 2],
}

impl Days {
    /// No counters yet. With `kept`, a bus keeps so many of its latest days: a tap runs for years.
    pub fn new(kept: Option<usize>) -> Self {
        Self { kept, ..Self::default() }
    }

    /// Counts the rows of a batch. It has to have frames and transactions.
    pub fn observe(&mut self, batch: &Batch) {
        let functions = batch.functions.as_deref().unwrap_or_else(|| Functions::embedded());
        for row in &batch.frames {
            self.day(batch, row.bus, row.start, 0).bus(batch, row.bus).frame(FrameObservation::of(batch, row));
        }
        for row in batch.all_transactions() {
            let contrast = self.day(batch, row.bus, row.start, 1);
            contrast.bus(batch, row.bus).transaction(Observation::of(batch, functions, row));
        }
        for row in &batch.connections {
            let day = row.opened.filter(|_| row.clock == Clock::Utc).map(day_of);
            let bus = self.buses.entry(row.server.clone()).or_default();
            bus.days.entry(day).or_default().observe_connection(row, Counted::default());
        }
        if let Some(kept) = self.kept {
            for bus in self.buses.values_mut() {
                while bus.days.len() > kept {
                    bus.days.pop_first();
                }
            }
        }
    }

    /// The counters for a row of a bus of the batch; `table` is 0 for frames, 1 for transactions.
    fn day(&mut self, batch: &Batch, index: u32, time: Option<Ns>, table: usize) -> &mut Contrast {
        let row = &batch.buses[index as usize];
        if !self.buses.contains_key(&row.name) {
            self.buses.insert(row.name.clone(), Bus::default());
        }
        let bus = self.buses.get_mut(&row.name).expect("just added");
        if let Some(time) = time.filter(|_| row.clock == Clock::Utc) {
            bus.last[table] = Some(day_of(time));
        }
        bus.days.entry(bus.last[table]).or_default()
    }

    /// What the doctor reports about each bus and day, as JSON, by bus and day: `date` (null without one) and `bus`, the seconds
    /// from the first to the last frame, and what a report has.
    pub fn rows(&self) -> Vec<Json> {
        let days = self.buses.iter().flat_map(|(name, bus)| bus.days.iter().map(move |(day, contrast)| (name, day, contrast)));
        days.map(|(name, day, contrast)| {
            let mut row = json!({
                "date": day.map(|day| time_text(day * DAY_NS)[..10].to_owned()), "bus": name, "seconds": seconds(contrast.clone()),
            });
            let report = Report::of(contrast.clone());
            let (Json::Object(keys), Json::Object(document)) = (&mut row, report.json()) else { unreachable!("both are maps") };
            keys.extend(document);
            row
        })
        .collect()
    }

    /// The flat rows ([`bus_day`]) that have changed since the last call, as JSON, each with its bus; of a bus the latest day
    /// comes last.
    pub fn changed(&mut self) -> Vec<(String, String)> {
        let mut changed = Vec::new();
        let before = std::mem::take(&mut self.told);
        for day in self.rows() {
            let bus = day["bus"].as_str().unwrap_or_default().to_owned();
            let key = (bus.clone(), day["date"].as_str().unwrap_or_default().to_owned());
            let text = bus_day(&day).to_string();
            if before.get(&key) != Some(&text) {
                changed.push((bus, text.clone()));
            }
            self.told.insert(key, text);
        }
        changed
    }
}

fn day_of(time: Ns) -> i64 {
    time.div_euclid(DAY_NS)
}

/// From the first to the last frame.
fn seconds(contrast: Contrast) -> Option<f64> {
    let span = contrast.into_buses().filter_map(|(_, bus)| bus.frames.span);
    span.reduce(|(a, b), (c, d)| (a.min(c), b.max(d))).map(|(first, last)| (last - first) as f64 / 1e9)
}
