//! The latest state of a register map: for every register, bit or point its last value, how often it was read and
//! written, and its range.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde_json::{json, Value as Json};

use crate::columns::{each_value, ReadingView};
use modlens_engine::records::Batch;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Bus, unit, table, address, and the index of the point in the plan (`u32::MAX` for a bare register or bit).
type Key = (Arc<str>, u8, Space, u16, u32);

/// Collects the values over a whole recording.
#[derive(Debug, Default)]
pub struct LatestValues {
    entries: BTreeMap<Key, PointState>,
    newest: Option<Ns>,
    /// The name of the bus that was seen last.
    bus: Option<Arc<str>>,
}

/// The state of one register, bit or point. `raw` is its last value as on the wire.
#[derive(Debug, Default)]
struct PointState {
    name: Option<String>,
    unit_of_measure: Option<String>,
    text: Option<String>,
    number: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    reads: u64,
    writes: u64,
    changes: u64,
    elapsed: Option<Ns>,
    raw: Vec<u8>,
}

impl LatestValues {
    /// Adds the values of a batch: those that were read, and those that were written without being refused.
    pub fn add(&mut self, batch: &Batch) {
        each_value(batch, |part| {
            if matches!(part.transaction.status, Status::Ok | Status::Broadcast) {
                self.put(batch, &part);
            }
        });
    }

    /// Adds one value.
    fn put(&mut self, batch: &Batch, part: &ReadingView<'_>) {
        let t = part.transaction;
        let name = batch.buses[t.bus as usize].name.as_str();
        let bus = self.bus.take().filter(|bus| **bus == *name).unwrap_or_else(|| name.into());
        self.bus = Some(bus.clone());
        let index = part.compiled.map_or(u32::MAX, |(index, _)| index);
        let key = (bus, t.unit, part.space, part.address, index);
        let entry = self.entries.entry(key).or_default();
        *(if part.is_write { &mut entry.writes } else { &mut entry.reads }) += 1;
        self.newest = self.newest.max(t.elapsed);
        entry.elapsed = t.elapsed.or(entry.elapsed);
        // The value is converted to text only if its bytes have changed.
        if entry.reads + entry.writes > 1 && entry.raw == part.raw {
            return;
        }
        entry.changes += u64::from(entry.reads + entry.writes > 1);
        entry.raw.clone_from(&part.raw);
        if let Some((_, compiled)) = part.compiled {
            entry.name = Some(compiled.name.clone());
            let instance = t.points.as_ref().expect("a value has a plan");
            entry.unit_of_measure.clone_from(&instance.plan.point(compiled).unit);
        }
        let value = part.value();
        (entry.text, entry.number) = (value.text(), value.number());
        if let Some(number) = entry.number {
            entry.low = Some(entry.low.map_or(number, |low| low.min(number)));
            entry.high = Some(entry.high.map_or(number, |high| high.max(number)));
        }
    }

    /// The rows of the map as a JSON list, sorted by bus, unit, table and address: at most `most` from number `first` on.
    pub fn json(&self, first: usize, most: usize) -> Json {
        self.entries
            .iter()
            .skip(first)
            .take(most)
            .map(|((bus, unit, space, address, _), entry)| {
                let age = self.newest.zip(entry.elapsed).map(|(newest, then)| (newest - then) as f64 / 1000.0);
                json!({
                    "bus": &**bus, "unit": unit, "register_type": space.long_name(), "address": address, "name": entry.name,
                    "value": entry.number, "value_text": entry.text, "unit_of_measure": entry.unit_of_measure,
                    "age_us": age, "reads": entry.reads, "writes": entry.writes, "count": entry.reads + entry.writes,
                    "min": entry.low, "max": entry.high, "changes": entry.changes,
                })
            })
            .collect()
    }
}
