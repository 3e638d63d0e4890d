//! The contrast: what failed against what did not, in counters.

mod before;
mod bus;
mod network;
mod noise;
mod request;
pub mod sample;
pub mod tally;
pub mod times;
mod unit;

use std::collections::BTreeMap;

use modlens_engine::records::Batch;
use modlens_protocol::functions::Functions;

pub use bus::{BusContrast, BusFacts, WINDOW};
pub use network::{ClientCounts, Connections};
pub use noise::{NoiseCounts, NoiseKey, NoiseRuns};
pub use request::{Lonely, RequestCounts};
pub use unit::{LengthRatios, Runs, UnitCounts, EXCEPTIONS};

use crate::observation::{FrameObservation, Observation};

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
/// assert_eq!(contrast.buses().count(), 1);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contrast {
    buses: BTreeMap<String, BusContrast>,
}

impl Contrast {
    /// Counts the rows of a batch. It has to have frames and transactions.
    pub fn observe(&mut self, batch: &Batch) {
        self.observe_connections(batch);
        let functions = batch.functions.as_deref().unwrap_or_else(|| Functions::embedded());
        let mut rest = &batch.frames[..];
        while let Some(first) = rest.first() {
            let run = rest.partition_point_by_bus(first.bus);
            let bus = self.bus(batch, first.bus);
            for row in &rest[..run] {
                bus.frame(FrameObservation::of(batch, row));
            }
            rest = &rest[run..];
        }
        let mut rest = &batch.transactions[..];
        while let Some(first) = rest.first() {
            let run = rest.partition_point_by_bus(first.bus);
            let bus = self.bus(batch, first.bus);
            for row in &rest[..run] {
                bus.transaction(Observation::of(batch, functions, row));
            }
            rest = &rest[run..];
        }
    }

    /// Counts connections; the bus of a connection is its server.
    fn observe_connections(&mut self, batch: &Batch) {
        for row in &batch.connections {
            if !self.buses.contains_key(&row.server) {
                self.buses.insert(row.server.clone(), BusContrast::default());
            }
            self.buses.get_mut(&row.server).expect("just added").connection(row);
        }
    }

    /// The counters of the bus with this index in the batch.
    fn bus(&mut self, batch: &Batch, index: u32) -> &mut BusContrast {
        let row = &batch.buses[index as usize];
        if !self.buses.contains_key(&row.name) {
            self.buses.insert(row.name.clone(), BusContrast::default());
        }
        let bus = self.buses.get_mut(&row.name).expect("just added");
        bus.facts.learn(row);
        bus
    }

    /// Adds what was counted in the part of the recording behind this one.
    pub fn merge(&mut self, later: &Self) {
        for (name, bus) in &later.buses {
            match self.buses.get_mut(name) {
                Some(own) => own.merge(bus),
                None => {
                    self.buses.insert(name.clone(), bus.clone());
                }
            }
        }
    }

    /// The buses by name, each with all that has been counted so far.
    pub fn buses(&self) -> impl Iterator<Item = (&str, BusContrast)> {
        self.buses.iter().map(|(name, bus)| (name.as_str(), bus.completed()))
    }
}

/// Rows that know their bus.
trait RunsOfBus {
    /// How many rows from the first one on are of this bus.
    fn partition_point_by_bus(&self, bus: u32) -> usize;
}

impl RunsOfBus for [modlens_engine::records::Frame] {
    fn partition_point_by_bus(&self, bus: u32) -> usize {
        self.iter().position(|row| row.bus != bus).unwrap_or(self.len())
    }
}

impl RunsOfBus for [modlens_engine::records::Transaction] {
    fn partition_point_by_bus(&self, bus: u32) -> usize {
        self.iter().position(|row| row.bus != bus).unwrap_or(self.len())
    }
}
