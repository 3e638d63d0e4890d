//! Learns a device's registers from traffic: which registers are read and written, in which blocks, how their values
//! change, and what they are. The result is the skeleton of a profile with the evidence for it.

use std::collections::BTreeMap;

use serde_json::{json, Value as Json};

use crate::columns::{read_data, read_range, row_of, write_data, write_range, Items};
use modlens_engine::records::{Batch, Transaction};
use modlens_profiles::find::LayoutHint;
use modlens_profiles::fit::{fit, Fit, SeenTable};
use modlens_profiles::learn::{
    conclude, likely_pairs, movements, Anchor, Counts, Equation, LayoutPoint, Learned, ObservedTable, MOST_ROWS,
};
use modlens_profiles::points::Plan;
use modlens_profiles::profile::Type;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;

/// The memory that the samples of all tables may take, in bytes. Where there are more, each block keeps fewer.
const MOST_SAMPLE_BYTES: usize = 48 << 20;

/// Collects the blocks that a master reads and writes over a whole recording.
#[derive(Debug)]
pub struct RegisterSurvey {
    units: BTreeMap<(u8, Space), ObservedTable>,
    /// The samples that are kept of each block.
    most_rows: usize,
    /// Scales that are known from elsewhere.
    anchors: BTreeMap<(u8, Space), Vec<Anchor>>,
    /// What was learnt of each table, once it was asked for.
    learned: BTreeMap<(u8, Space), Vec<Learned>>,
}

impl Default for RegisterSurvey {
    fn default() -> Self {
        Self { units: BTreeMap::new(), most_rows: MOST_ROWS, anchors: BTreeMap::new(), learned: BTreeMap::new() }
    }
}

impl RegisterSurvey {
    /// Adds the transactions of a batch.
    pub fn add(&mut self, batch: &Batch) {
        self.learned.clear();
        for t in batch.all_transactions() {
            let space = row_of(batch, t).and_then(|row| row.space);
            let Some(space) = space.filter(|_| matches!(t.status, Status::Ok | Status::Exception)) else { continue };
            let most_rows = self.most_rows;
            let table = self.units.entry((t.unit, space)).or_insert_with(|| ObservedTable::with_rows(most_rows));
            if let Some(range) = read_range(batch, t) {
                table.block(range.0, range.1).reads += 1;
                put(table, t, range, read_data(batch, t), false);
            }
            if let Some(range) = write_range(batch, t) {
                table.block(range.0, range.1).writes += 1;
                put(table, t, range, write_data(batch, t).filter(|_| t.status == Status::Ok), true);
            }
        }
        self.limit_samples();
    }

    /// Halves the samples of the blocks with the most of them until they fit into the memory that they may take.
    fn limit_samples(&mut self) {
        while self.sample_bytes() > MOST_SAMPLE_BYTES && self.most_rows > 2 {
            self.most_rows /= 2;
            self.units.values_mut().for_each(|table| table.limit_rows(self.most_rows));
        }
    }

    /// The memory that samples take, in bytes.
    pub fn sample_bytes(&self) -> usize {
        self.units.values().map(ObservedTable::sample_bytes).sum()
    }

    /// The samples that are kept of each block.
    pub fn most_rows(&self) -> usize {
        self.most_rows
    }

    /// Learns about the tables of a unit, unless it was done before. What was learnt of other units is dropped.
    fn learn(&mut self, unit: u8) {
        self.learned.retain(|place, _| place.0 == unit);
        for (place, table) in self.units.range((unit, Space::Coil)..).take_while(|(place, _)| place.0 == unit) {
            let anchors = self.anchors.get(place).map_or(&[][..], |anchors| &anchors[..]);
            let learn = || if place.1.is_bits() { Vec::new() } else { conclude(table, anchors) };
            self.learned.entry(*place).or_insert_with(learn);
        }
    }

    /// Takes the scale of a point as known: what was learnt before is forgotten.
    pub fn anchor(&mut self, unit: u8, space: Space, anchor: Anchor) {
        self.learned.clear();
        self.anchors.entry((unit, space)).or_default().push(anchor);
    }

    /// How well a profile fits a unit.
    pub fn fit(&mut self, unit: u8, plan: &Plan) -> Fit {
        self.learn(unit);
        let seen =
            |((_, space), table): (&(u8, Space), _)| SeenTable { space: *space, table, learned: &self.learned[&(unit, *space)] };
        let tables = self.units.iter().filter(|(place, _)| place.0 == unit).map(seen);
        fit(plan, &tables.collect::<Vec<_>>())
    }

    /// The layout of the points that are certain, and pairs that are likely.
    pub fn layout_hints(&self) -> Vec<LayoutHint> {
        let mut found = Vec::new();
        for ((unit, space), table) in self.units.iter().filter(|((_, space), _)| !space.is_bits()) {
            let learned = conclude(table, &[]);
            let points: Vec<&LayoutPoint> = learned.iter().map(|learned| &learned.layout).collect();
            let hint = |address, count, kind, order, is_certain| LayoutHint {
                unit: *unit,
                space: *space,
                address,
                count,
                kind,
                order,
                is_certain,
            };
            let certain = points.iter().filter(|layout| layout.is_certain);
            found.extend(certain.map(|layout| hint(layout.address, layout.count, layout.kind, layout.order, true)));
            let likely = likely_pairs(table, &points).into_iter();
            found.extend(likely.map(|(address, order)| hint(address, 2, Type::U32, order, false)));
        }
        found
    }

    /// The blocks of each table of each unit, as JSON.
    pub fn tables(&self) -> Json {
        self.units.iter().map(|((unit, space), table)| table_json(*unit, *space, table)).collect()
    }

    /// How the points of a table moved in so many parts of the time, and what they say of each other: as JSON.
    pub fn movements(&mut self, unit: u8, space: Space, parts: usize) -> Json {
        self.learn(unit);
        let (Some(table), Some(learned)) = (self.units.get(&(unit, space)), self.learned.get(&(unit, space))) else {
            return json!({"spans": [], "equations": []});
        };
        let found = movements(table, learned, parts);
        let equation = |one: &Equation| json!({"kind": one.kind, "address": one.point, "of": one.of, "factor": one.factor, "residual": one.residual});
        json!({"spans": found.spans, "equations": found.equations.iter().map(equation).collect::<Vec<Json>>()})
    }

    /// What was learnt of a table, from the point with the number `first` on, at most `most` points: as JSON.
    pub fn points(&mut self, unit: u8, space: Space, first: usize, most: usize) -> Json {
        self.learn(unit);
        let (Some(table), Some(learned)) = (self.units.get(&(unit, space)), self.learned.get(&(unit, space))) else {
            return Json::Array(Vec::new());
        };
        if space.is_bits() {
            return table.registers.iter().skip(first).take(most).map(|(at, counts)| register_json(*at, counts)).collect();
        }
        let point = |one: &Learned| {
            let mut found = answer_json(one);
            let register = register_json(one.layout.address, &table.registers[&one.layout.address]);
            if let (Some(found), Json::Object(register)) = (found.as_object_mut(), register) {
                found.extend(register);
            }
            found
        };
        learned.iter().skip(first).take(most).map(point).collect()
    }
}

/// Adds one transaction with the values that it read or wrote.
fn put(table: &mut ObservedTable, t: &Transaction, range: (u16, u16), items: Option<Items<'_>>, is_write: bool) {
    if let Some(code) = t.exception {
        *table.block(range.0, range.1).exceptions.entry(code).or_default() += 1;
    }
    let Some(items) = items.filter(|items| items.len() == usize::from(range.1)) else { return };
    let values: Vec<u16> = (0..items.len()).map(|i| items.get(i) as u16).collect();
    table.put(range.0, &values, t.start.or(t.elapsed).unwrap_or(0), is_write);
}

/// What was asked for in a table of a unit.
fn table_json(unit: u8, space: Space, table: &ObservedTable) -> Json {
    let blocks: Vec<Json> = table
        .blocks
        .iter()
        .map(|((first, count), block)| {
            json!({"first": first, "count": count, "reads": block.reads, "writes": block.writes, "exceptions": block.exceptions})
        })
        .collect();
    json!({
        "unit": unit, "register_type": space.long_name(), "space": space.short_name(), "blocks": blocks,
        "registers": table.registers.len(), "together": correlated_pairs(table),
    })
}

/// The register's counts and what its values look like, as JSON.
fn register_json(address: u16, counts: &Counts) -> Json {
    let values: Vec<u16> = counts.distinct().unwrap_or_default().into_iter().map(|pair| pair.0).collect();
    let looks = match counts.changes() {
        0 => "constant",
        changes if counts.downs == 0 && changes > 2 && !(2..5).contains(&values.len()) => "counter",
        // A signed quantity that crosses zero jumps between 65535 and 0.
        _ if counts.max >= 0xFF00 && counts.min < 0x0100 => "signed",
        _ if (2..=6).contains(&values.len()) && counts.max < 64 => "enum",
        _ => "quantity",
    };
    json!({
        "address": address, "samples": counts.samples, "changes": counts.changes(), "distinct": counts.distinct_count(),
        "raw_min": counts.min, "raw_max": counts.max, "looks": looks, "read": counts.is_read, "written": counts.writes > 0,
        "values": if values.len() <= 6 { values } else { Vec::new() },
    })
}

/// What is known of a point; null where the data do not say.
fn answer_json(one: &Learned) -> Json {
    let (layout, scale) = (&one.layout, one.scale);
    json!({
        "address": layout.address, "count": layout.count, "type": layout.kind.word(), "order": layout.order.word(),
        "layout_bits": rounded(layout.bits), "layout_evidence": rounded(one.evidence), "is_certain": layout.is_certain,
        "role": one.role.map(|role| role.0.word()), "role_bits": one.role.map(|role| rounded(role.1)),
        "scale": scale.map(|scale| scale.factor), "unit_symbol": scale.and_then(|scale| scale.unit),
        "scale_bits": scale.map(|scale| rounded(scale.bits)), "quantity": scale.and_then(|scale| scale.quantity),
        "quantity_bits": scale.filter(|scale| scale.quantity.is_some()).map(|scale| rounded(scale.quantity_bits)),
        "min": one.range.map(|range| range.0), "max": one.range.map(|range| range.1),
        "reason": layout.reason, "scale_reason": scale.map(|scale| scale.reason),
    })
}

fn rounded(bits: f64) -> f64 {
    (bits * 10.0).round() / 10.0
}

/// Pairs that change together are listed up to this number.
const MOST_PAIRS: usize = 1000;

/// Pairs of registers of one block that change together: where one changes, the other does, too, at least nine times of
/// ten.
fn correlated_pairs(table: &ObservedTable) -> Vec<Json> {
    let mut found = Vec::new();
    for ((first, _), block) in table.blocks.iter().filter(|(_, block)| block.samples.len() > 8) {
        let changed = block.samples.changes();
        let steps = block.samples.len() as u32 - 1;
        for (a, one) in changed.iter().enumerate() {
            for (b, other) in changed.iter().enumerate().skip(a + 1) {
                let both: u32 = one.iter().zip(other).map(|(x, y)| (x & y).count_ones()).sum();
                let any: u32 = one.iter().zip(other).map(|(x, y)| (x | y).count_ones()).sum();
                // A register that changes at nearly every sample coincides with all others by chance.
                if found.len() < MOST_PAIRS && any > 4 && any * 2 < steps && both * 10 >= any * 9 {
                    found.push(json!([usize::from(*first) + a, usize::from(*first) + b]));
                }
            }
        }
    }
    found
}
