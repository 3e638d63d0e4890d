//! How much each unit has left before it fails: answers, response time against the master's timeout, damage.

use serde_json::{json, Value as Json};

use crate::contrast::BusContrast;
use modlens_protocol::source::Clock;

/// The margin of each unit of a bus.
pub(super) fn of_bus(name: &str, bus: &BusContrast) -> Vec<Json> {
    let us = |ns: i64| ns as f64 / 1000.0;
    // A master mostly has one timeout for all: where a unit has never failed, that of the others is shown.
    let timeout = bus.units.values().filter_map(|counts| counts.waited.percentile(0.5)).min();
    // The number of a unit that only damaged requests bear may be damaged as well.
    let asked = bus.units.iter().filter(|(_, counts)| counts.failures.total > counts.bad_requests.failed);
    asked
        .map(|(unit, counts)| {
            let (requests, failed) = (counts.failures.total, counts.failures.failed);
            let p99 = counts.response_times.percentile(0.99);
            let own = counts.waited.percentile(0.5).or(timeout);
            json!({
                "bus": name, "unit": unit, "requests": requests, "answered": requests - failed,
                "damaged": counts.garbled.failed + counts.bad_requests.failed, "late": counts.late.failed,
                "timed": counts.response_times.count, "response_time_p99_us": p99.map(us), "timeout_us": own.map(us),
                "clock": clock(bus),
            })
        })
        .collect()
}

/// The clock that response times are of.
fn clock(bus: &BusContrast) -> &'static str {
    match bus.facts.clock {
        Clock::Utc => "utc",
        Clock::Relative => "relative",
        Clock::None => "none",
    }
}
