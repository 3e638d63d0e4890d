//! The contrast: what failed against what did not, in counters.

mod almost;
mod before;
mod bus;
mod clean_run;
mod clean_units;
mod context;
mod cycles;
mod displaced;
mod epochs;
mod followed;
mod frame_counts;
pub mod gaps;
mod good_frame;
pub mod jumps;
mod known_requests;
pub mod lists;
mod network;
mod noise;
pub mod odd_run;
mod odd_transaction;
#[cfg(test)]
mod one_by_one;
mod overtaken;
mod pauses;
pub mod rates;
mod recent;
pub mod registers;
mod request;
mod runs;
pub mod sample;
mod symptom;
mod symptoms;
pub mod tally;
pub mod times;
pub mod told;
mod unit;
mod unserved;
pub mod writes;

use std::collections::btree_map::Entry;
use std::collections::BTreeMap;

use modlens_engine::records::{Batch, Connection, Part};

pub use bus::{BusContrast, BusFacts, WINDOW};
pub use epochs::Epochs;
pub use followed::{Followed, FollowedAnswers};
pub use network::{ClientCounts, Connections, Counted};
pub use noise::{NoiseCounts, NoiseKey, NoiseRuns};
pub use overtaken::Overtaken;
pub use pauses::Pauses;
pub use request::{Lonely, Pair, RequestCounts};
pub use runs::Runs;
pub use symptom::Symptom;
pub use symptoms::{Seen, Symptoms};
pub use unit::{LengthRatios, UnitCounts, EXCEPTIONS};
pub use unserved::{LockedOut, Unserved};
pub use writes::{AfterWrite, AfterWrites};

use crate::clean::Exchanges;
use crate::observation::FrameObservation;
use modlens_protocol::Ns;
use tally::{mix, mix_bytes};

/// Buses, units and distinct requests that are counted, all buses taken together: those with the least hashes of their names.
const MOST: Bounds = Bounds { buses: 1024, units: 4096, requests: 16_384 };

/// The connections that are open, by their numbers, and what has been counted of them.
#[derive(Clone, Debug, Default)]
pub struct OpenConnections(BTreeMap<u64, Counted>);

impl OpenConnections {
    fn of(&self, row: &Connection) -> Counted {
        self.0.get(&row.number).copied().unwrap_or_default()
    }
}

/// How many of each are kept.
#[derive(Clone, Copy)]
struct Bounds {
    buses: usize,
    units: usize,
    requests: usize,
}

/// The counters of all buses.
///
/// ```
/// use modlens_diagnosis::contrast::Contrast;
/// use modlens_engine::session::{BusOptions, Session};
/// use modlens_readers::chunk::Chunk;
/// let mut session = Session::default();
/// let bus = session.add_bus(BusOptions::named("line"));
/// session.feed(bus, &Chunk { bytes: &[0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87], ..Chunk::default() });
/// session.flush();
/// let mut contrast = Contrast::default();
/// contrast.observe(&session.take());
/// assert_eq!(contrast.into_buses().count(), 1);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Contrast {
    buses: BTreeMap<String, BusContrast>,
    /// Whether something was left out, for want of room.
    overflowed: bool,
    /// Whether whole buses or units were.
    left_out: bool,
    is_selection: bool,
}

/// What was counted of what there is.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// A user has chosen what is counted.
    pub is_selection: bool,
    /// Whole buses or units were left out.
    pub is_part: bool,
    /// There were more buses, units or requests than are counted.
    pub has_overflowed: bool,
}

impl Contrast {
    /// Counters of transactions that a user has chosen: they say nothing of the whole line.
    pub fn of_selection() -> Self {
        Self { is_selection: true, ..Self::default() }
    }

    /// Counts the rows of a batch. It has to have frames and transactions.
    pub fn observe(&mut self, batch: &Batch) {
        self.observe_after(batch, &OpenConnections::default());
    }

    /// The same where something of the connections was counted while they were open.
    pub fn observe_after(&mut self, batch: &Batch, counted: &OpenConnections) {
        for row in &batch.connections {
            self.observe_connection(row, counted.of(row));
        }
        self.observe_frames(batch);
        self.observe_transactions(batch);
        self.prune(MOST);
    }

    /// Counts frames, with those of compact exchanges between them.
    fn observe_frames(&mut self, batch: &Batch) {
        for part in batch.frame_parts() {
            match part {
                Part::Compact(run) => self.bus(batch, run.bus).compact_frames(run, run.exchanges.of(&batch.exchanges)),
                Part::Rows(rows) => {
                    for rows in rows.chunk_by(|row, next| row.bus == next.bus) {
                        let bus = self.bus(batch, rows[0].bus);
                        for row in rows {
                            if !bus.clean_frame(batch, row) {
                                bus.frame(FrameObservation::of(batch, row));
                            }
                        }
                    }
                }
            }
        }
    }

    /// Counts transactions, with compact exchanges between them.
    fn observe_transactions(&mut self, batch: &Batch) {
        let exchanges = Exchanges::of(batch);
        for part in batch.transaction_parts() {
            match part {
                Part::Compact(run) => self.bus(batch, run.bus).compact_transactions(&exchanges, run),
                Part::Rows(rows) => {
                    for rows in rows.chunk_by(|row, next| row.bus == next.bus) {
                        let bus = self.bus(batch, rows[0].bus);
                        for row in rows {
                            bus.row(&exchanges, row);
                        }
                    }
                }
            }
        }
        self.buses.values_mut().for_each(BusContrast::end_batch);
    }

    /// Leaves out what is beyond the bounds. What is kept depends on names only: what is among the least hashes of the whole is
    /// so in each part as well, and is never left out.
    fn prune(&mut self, most: Bounds) {
        // By the bus first, so that those that are kept are kept whole, but for one.
        let of = |name: &str, what: u64| mix_bytes(name.as_bytes()) >> 32 << 32 | mix(what) >> 32;
        let buses: Vec<u64> = self.buses.keys().map(|name| of(name, 0)).collect();
        if let Some(limit) = limit(buses, most.buses) {
            (self.overflowed, self.left_out) = (true, true);
            self.buses.retain(|name, _| of(name, 0) < limit);
        }
        let units = |bus: &BusContrast| bus.units.len();
        if self.buses.values().map(units).sum::<usize>() > most.units {
            let all = self.buses.iter().flat_map(|(name, bus)| bus.units.keys().map(move |unit| of(name, u64::from(*unit) + 1)));
            let limit = limit(all.collect(), most.units).expect("there are more");
            (self.overflowed, self.left_out) = (true, true);
            for (name, bus) in &mut self.buses {
                bus.settle();
                bus.units.retain(|unit, _| of(name, u64::from(*unit) + 1) < limit);
            }
        }
        if self.buses.values().map(|bus| bus.requests.len()).sum::<usize>() > most.requests {
            let all = self.buses.iter().flat_map(|(name, bus)| bus.requests.hashes().map(move |hash| of(name, hash)));
            let limit = limit(all.collect(), most.requests).expect("there are more");
            self.overflowed = true;
            for (name, bus) in &mut self.buses {
                bus.settle();
                bus.requests.retain(|hash| of(name, hash) < limit);
                bus.forget();
            }
        }
    }

    /// What was counted of what there is.
    pub fn extent(&self) -> Extent {
        let has_overflowed = self.overflowed || self.buses.values().any(|bus| bus.requests.overflowed);
        Extent { is_selection: self.is_selection, is_part: self.left_out, has_overflowed }
    }

    /// Counts a connection that is over; its bus is its server.
    pub(crate) fn observe_connection(&mut self, row: &Connection, before: Counted) {
        self.of_server(&row.server).connection(row, before);
    }

    /// Counts what has come of connections that are open, and notes that it was counted.
    pub fn observe_open(&mut self, open: &[Connection], now: Ns, counted: &mut OpenConnections) {
        for row in open {
            self.of_server(&row.server).open_connection(row, counted.of(row), now);
        }
        counted.0 = open.iter().map(|row| (row.number, Counted::of_open(row, now))).collect();
    }

    /// The counters of a server: the bus of its connections.
    fn of_server(&mut self, server: &str) -> &mut BusContrast {
        if !self.buses.contains_key(server) {
            self.buses.insert(server.to_owned(), BusContrast::default());
        }
        self.buses.get_mut(server).expect("just added")
    }

    /// The counters of the bus with this index in the batch.
    pub(crate) fn bus(&mut self, batch: &Batch, index: u32) -> &mut BusContrast {
        let row = &batch.buses[index as usize];
        if !self.buses.contains_key(&row.name) {
            self.buses.insert(row.name.clone(), BusContrast::default());
        }
        let bus = self.buses.get_mut(&row.name).expect("just added");
        bus.facts.learn(row);
        bus
    }

    /// Adds what was counted in the part of the recording after this one.
    pub fn merge(&mut self, later: Self) {
        for (name, bus) in later.buses {
            match self.buses.entry(name) {
                Entry::Occupied(mut own) => own.get_mut().merge(bus),
                Entry::Vacant(none) => drop(none.insert(bus)),
            }
        }
        self.overflowed |= later.overflowed;
        self.left_out |= later.left_out;
        self.prune(MOST);
    }

    /// The buses by name, each with all that has been counted so far.
    pub fn into_buses(self) -> impl Iterator<Item = (String, BusContrast)> {
        self.buses.into_iter().map(|(name, bus)| (name, bus.completed()))
    }
}

/// The hash from which on there are too many; `None` if there are not.
fn limit(mut hashes: Vec<u64>, most: usize) -> Option<u64> {
    (hashes.len() > most).then(|| *hashes.select_nth_unstable(most).1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::RequestKey;

    fn contrast(buses: std::ops::Range<u16>) -> Contrast {
        let mut all = Contrast::default();
        for number in buses {
            let bus = all.buses.entry(format!("10.0.{number}.1:502")).or_default();
            for unit in 0..8u8 {
                bus.units.entry(unit).or_default();
                let key = RequestKey { unit, function: 3, address: number, quantity: 1 };
                bus.requests.entry(key.hash(), key);
            }
        }
        all
    }

    #[test]
    fn what_is_kept_depends_on_names_only() {
        let most = Bounds { buses: 20, units: 50, requests: 30 };
        let mut whole = contrast(0..40);
        whole.prune(most);
        let mut merged = contrast(0..25);
        merged.prune(most);
        let mut later = contrast(25..40);
        later.prune(most);
        merged.merge(later);
        merged.prune(most);
        let kept = |all: &Contrast| {
            let units: usize = all.buses.values().map(|bus| bus.units.len()).sum();
            let requests: usize = all.buses.values().map(|bus| bus.requests.len()).sum();
            (all.buses.len(), units, requests)
        };
        assert_eq!(kept(&whole), (20, 50, 30));
        assert!(whole.extent().has_overflowed && merged.extent().has_overflowed);
        assert_eq!(kept(&merged), kept(&whole));
        assert!(whole.buses.keys().eq(merged.buses.keys()));
    }
}
