//! How much each unit has left before it fails: answers, response time against the master's timeout, damage.

use serde_json::{json, Value as Json};

use crate::claim::Claim;
use crate::contrast::{BusContrast, UnitCounts};
use modlens_engine::durations::Durations;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

/// The margin of each unit of a bus, about which the doctor claims these.
pub(super) fn of_bus(name: &str, bus: &BusContrast, claims: &[Claim]) -> Vec<Json> {
    let us = |ns: i64| ns as f64 / 1000.0;
    let timeout = Timeouts::of(bus, claims);
    // The number of a unit that only damaged requests bear may be damaged as well.
    let asked = bus.units.iter().filter(|(_, counts)| counts.failures.total > counts.bad_requests.failed);
    asked
        .map(|(unit, counts)| {
            let (requests, failed) = (counts.failures.total, counts.failures.failed);
            let p99 = counts.response_times.percentile(0.99);
            let own = timeout.of_unit(counts);
            json!({
                "bus": name, "unit": unit, "requests": requests, "answered": requests - failed,
                "damaged": counts.damaged_frames(), "late": counts.late.failed,
                "line_errors": counts.line_errors.iter().map(|side| side.failed).sum::<u64>(),
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

/// How long the master waits for a response, as far as the recording shows it.
struct Timeouts {
    /// The median of all waits, for units that have always answered: a master mostly has one timeout for all.
    of_all: Option<Ns>,
    /// What the median response takes. Nobody gives up sooner: so short a wait ended because something else was sent.
    least: Ns,
    /// Requests of several masters cut each other's waits short, so none is a timeout.
    is_unknown: bool,
}

impl Timeouts {
    fn of(bus: &BusContrast, claims: &[Claim]) -> Self {
        let (mut waited, mut taken) = (Durations::default(), Durations::default());
        for counts in bus.units.values() {
            waited.merge(&counts.waited);
            taken.merge(&counts.response_times);
        }
        Self {
            of_all: waited.percentile(0.5),
            least: taken.percentile(0.5).unwrap_or(0),
            is_unknown: claims.iter().any(|claim| claim.code == "two_masters"),
        }
    }

    fn of_unit(&self, counts: &UnitCounts) -> Option<Ns> {
        let waited = counts.waited.percentile(0.5).or(self.of_all);
        waited.filter(|waited| !self.is_unknown && *waited >= self.least)
    }
}
