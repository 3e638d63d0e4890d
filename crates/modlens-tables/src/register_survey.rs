//! Learns a device's registers from traffic: which registers are read and written, in which blocks, how their values
//! change, and which of them belong together. The result is the skeleton of a profile with the evidence for it.

use std::collections::BTreeMap;

use serde_json::{json, Value as Json};

use crate::columns::{read_data, read_range, row_of, write_data, write_range, Items};
use modlens_engine::records::{Batch, Transaction};
use modlens_profiles::find::LayoutHint;
use modlens_profiles::learn::{rank_types, text, MIN_MARGIN_BITS};
use modlens_profiles::profile::{Order, Type};
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;

/// The number of samples kept of a block, from the beginning of the recording.
const SAMPLES: usize = 512;

/// Collects the blocks that a master reads and writes over a whole recording.
#[derive(Debug, Default)]
pub struct RegisterSurvey {
    units: BTreeMap<(u8, Space), Blocks>,
}

/// The blocks of one table of one unit, by first address and quantity.
type Blocks = BTreeMap<(u16, u16), Block>;

/// The transactions that accessed one block.
#[derive(Debug, Default)]
struct Block {
    reads: u64,
    writes: u64,
    exceptions: BTreeMap<u8, u64>,
    /// The values of its registers or bits, one row per transaction.
    rows: Vec<Vec<u16>>,
}

impl RegisterSurvey {
    /// Adds the transactions of a batch.
    pub fn add(&mut self, batch: &Batch) {
        for t in batch.all_transactions() {
            let space = row_of(batch, t).and_then(|row| row.space);
            let Some(space) = space.filter(|_| matches!(t.status, Status::Ok | Status::Exception)) else { continue };
            let blocks = self.units.entry((t.unit, space)).or_default();
            if let Some(range) = read_range(batch, t) {
                let block = blocks.entry(range).or_default();
                block.reads += 1;
                block.put(t, read_data(batch, t));
            }
            if let Some(range) = write_range(batch, t) {
                let block = blocks.entry(range).or_default();
                block.writes += 1;
                block.put(t, write_data(batch, t).filter(|_| t.status == Status::Ok));
            }
        }
    }

    /// The layout of the points that are certain, without integers of four registers, which are wrong too often.
    pub fn layout_hints(&self) -> Vec<LayoutHint> {
        let mut found = Vec::new();
        for ((unit, space), blocks) in self.units.iter().filter(|((_, space), _)| !space.is_bits()) {
            for point in learned_points(blocks, &registers(blocks)).into_iter().filter(|point| point.is_certain) {
                if matches!(point.kind, "u64" | "s64") {
                    continue;
                }
                let Some(kind) = Type::from_word(point.kind) else { continue };
                let LearnedPoint { address, count, order, .. } = point;
                found.push(LayoutHint { unit: *unit, space: *space, address, count, kind, order });
            }
        }
        found
    }

    /// The result for each table of each unit, as JSON.
    pub fn json(&self) -> Json {
        self.units.iter().map(|((unit, space), blocks)| table(*unit, *space, blocks)).collect()
    }
}

impl Block {
    /// Adds one transaction with the values that it read or wrote.
    fn put(&mut self, t: &Transaction, items: Option<Items<'_>>) {
        if let Some(code) = t.exception {
            *self.exceptions.entry(code).or_default() += 1;
        }
        let Some(items) = items.filter(|_| self.rows.len() < SAMPLES) else { return };
        self.rows.push((0..items.len()).map(|i| items.get(i) as u16).collect());
    }
}

/// Everything learnt about one table of a unit: its blocks, single registers, multi-register points and correlated
/// pairs.
fn table(unit: u8, space: Space, blocks: &Blocks) -> Json {
    let listed: Vec<Json> = blocks
        .iter()
        .map(|((first, count), block)| {
            json!({"first": first, "count": count, "reads": block.reads, "writes": block.writes, "exceptions": block.exceptions})
        })
        .collect();
    let mut points = Vec::new();
    let registers = registers(blocks);
    if !space.is_bits() {
        points = learned_points(blocks, &registers);
    }
    let singles: Vec<Json> = registers.iter().map(|(address, register)| register.json(*address)).collect();
    json!({
        "unit": unit, "register_type": space.long_name(), "space": space.short_name(), "blocks": listed, "registers": singles,
        "points": points.iter().map(LearnedPoint::json).collect::<Vec<_>>(), "together": correlated_pairs(blocks),
    })
}

/// The values of each register, by address.
fn registers(blocks: &Blocks) -> BTreeMap<u16, Register> {
    let mut registers: BTreeMap<u16, Register> = BTreeMap::new();
    for ((first, _), block) in blocks {
        for row in &block.rows {
            for (i, &value) in row.iter().enumerate() {
                registers.entry(first.wrapping_add(i as u16)).or_default().put(value, block);
            }
        }
    }
    registers
}

/// The values of one register over time.
#[derive(Debug, Default)]
struct Register {
    values: Vec<u16>,
    read: bool,
    written: bool,
}

impl Register {
    fn put(&mut self, value: u16, block: &Block) {
        self.values.push(value);
        self.read |= block.reads > 0;
        self.written |= block.writes > 0;
    }

    /// The register's statistics and what its values look like, as JSON.
    fn json(&self, address: u16) -> Json {
        let mut distinct = self.values.clone();
        distinct.sort_unstable();
        distinct.dedup();
        let changes = self.values.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let rising = self.values.windows(2).all(|pair| pair[1].wrapping_sub(pair[0]) < 0x1000);
        // A signed quantity that crosses zero jumps between 65535 and 0.
        let signed = distinct.iter().any(|&value| value >= 0xFF00) && distinct.iter().any(|&value| value < 0x0100);
        let looks = match (changes, distinct.len()) {
            (0, _) => "constant",
            _ if rising && changes > 2 && distinct.len() > 4 => "counter",
            _ if signed => "signed",
            (_, 2..=6) if distinct[distinct.len() - 1] < 64 => "enum",
            _ => "quantity",
        };
        json!({
            "address": address, "samples": self.values.len(), "changes": changes, "distinct": distinct.len(),
            "min": distinct.first(), "max": distinct.last(), "looks": looks, "read": self.read, "written": self.written,
            "values": if distinct.len() <= 6 { distinct } else { Vec::new() },
        })
    }
}

/// Consecutive registers that form one value, with the evidence for it.
#[derive(Clone, Debug)]
struct LearnedPoint {
    address: u16,
    count: u16,
    kind: &'static str,
    order: Order,
    bits: f64,
    is_certain: bool,
    reason: String,
    rivals: Vec<(&'static str, Order)>,
}

impl LearnedPoint {
    fn end(&self) -> u32 {
        u32::from(self.address) + u32::from(self.count)
    }

    /// Whether both take some of the same registers. Other interpretations of exactly the same registers do not count.
    fn overlaps(&self, other: &Self) -> bool {
        let same = (self.address, self.count) == (other.address, other.count);
        !same && u32::from(self.address) < other.end() && u32::from(other.address) < self.end()
    }

    /// The weight in the choice between overlapping points. A point without a close rival counts more than a guess.
    fn weight(&self) -> f64 {
        if self.is_certain {
            self.bits
        } else {
            self.bits / 4.0
        }
    }

    fn json(&self) -> Json {
        let rivals: Vec<Json> = self.rivals.iter().map(|(kind, order)| json!({"type": kind, "order": order.word()})).collect();
        json!({
            "address": self.address, "count": self.count, "type": self.kind, "order": self.order.word(),
            "bits": (self.bits * 10.0).round() / 10.0, "sure": self.is_certain, "reason": self.reason, "rivals": rivals,
        })
    }
}

/// The best set of non-overlapping points: texts and numbers of two and four registers. If it shows which order the
/// device uses, the choice is made again with a preference for that order.
fn learned_points(blocks: &Blocks, registers: &BTreeMap<u16, Register>) -> Vec<LearnedPoint> {
    let constant: BTreeMap<u16, u16> = registers
        .iter()
        .filter(|(_, register)| register.values.windows(2).all(|pair| pair[0] == pair[1]))
        .filter_map(|(address, register)| Some((*address, *register.values.first()?)))
        .collect();
    let texts: Vec<LearnedPoint> = text::runs(&constant)
        .into_iter()
        .map(|run| LearnedPoint {
            address: run.address,
            count: run.count,
            kind: "str",
            order: if run.swapped { Order::Badc } else { Order::Abcd },
            bits: 40.0,
            is_certain: true,
            reason: format!("constant text {:?}", run.text),
            rivals: Vec::new(),
        })
        .collect();
    let choose_points = |device_order: Option<Order>| {
        let mut all = texts.clone();
        for &address in registers.keys() {
            for width in [2u16, 4] {
                all.extend(best_hypothesis_at(blocks, address, width, device_order));
            }
        }
        choose_non_overlapping(all)
    };
    let first = choose_points(None);
    match usual_order(&first) {
        None => first,
        device_order => choose_points(device_order),
    }
}

/// The order that most of the certain points have: at least three of them, and two thirds of all.
fn usual_order(points: &[LearnedPoint]) -> Option<Order> {
    let orders: Vec<Order> =
        points.iter().filter(|point| point.is_certain && point.kind != "str").map(|point| point.order).collect();
    let votes = |order: Order| orders.iter().filter(|&&other| other == order).count();
    let (order, _) = Order::ALL.into_iter().max_by_key(|(order, _)| votes(*order))?;
    (votes(order) >= 3 && votes(order) * 3 >= orders.len() * 2).then_some(order)
}

/// The best hypothesis for `width` registers from an address, judged by the block with the most samples that contains
/// them.
fn best_hypothesis_at(blocks: &Blocks, address: u16, width: u16, device_order: Option<Order>) -> Option<LearnedPoint> {
    let block_contains = |first: u16, count: u16| {
        u32::from(first) <= u32::from(address) && u32::from(address) + u32::from(width) <= u32::from(first) + u32::from(count)
    };
    let (mut best, mut exact_requests, mut all_requests): (Option<(usize, &Block)>, u64, u64) = (None, 0, 0);
    for ((first, count), block) in blocks {
        if !block_contains(*first, *count) {
            continue;
        }
        all_requests += block.reads + block.writes;
        if (*first, *count) == (address, width) {
            exact_requests += block.reads + block.writes;
        }
        if best.is_none_or(|(_, other)| other.rows.len() < block.rows.len()) {
            best = Some((usize::from(address - first), block));
        }
    }
    let (at, block) = best?;
    let end = at + usize::from(width);
    let rows: Vec<&[u16]> = block.rows.iter().filter_map(|row| row.get(at..end)).collect();
    let hypotheses = rank_types(&rows, exact_requests as f64 / all_requests.max(1) as f64, device_order);
    let best_hypothesis = hypotheses.first()?;
    let rivals =
        hypotheses.iter().skip(1).take(2).map(|best_hypothesis| (best_hypothesis.kind.word(), best_hypothesis.order)).collect();
    Some(LearnedPoint {
        address,
        count: width,
        kind: best_hypothesis.kind.word(),
        order: best_hypothesis.order,
        bits: best_hypothesis.bits,
        is_certain: best_hypothesis.is_certain,
        reason: best_hypothesis.reason.clone(),
        rivals,
    })
}

/// Chooses the non-overlapping points with the largest total weight (weighted interval scheduling). A chosen point is
/// not certain if some set without it, containing a point that overlaps it, has nearly the same total.
fn choose_non_overlapping(mut all: Vec<LearnedPoint>) -> Vec<LearnedPoint> {
    all.sort_by_key(LearnedPoint::end);
    let last_before: Vec<usize> =
        all.iter().map(|candidate| all.partition_point(|other| other.end() <= u32::from(candidate.address))).collect();
    // best_of_first[i]: the best total of the first i points, sorted by their end.
    let mut best_of_first = vec![0.0f64; all.len() + 1];
    for (i, point) in all.iter().enumerate() {
        best_of_first[i + 1] = best_of_first[i].max(best_of_first[last_before[i]] + point.weight());
    }
    // best_from[address]: the best total of the points that begin at this address or later.
    let mut best_from: BTreeMap<u32, f64> = BTreeMap::new();
    let mut by_start: Vec<&LearnedPoint> = all.iter().collect();
    by_start.sort_by_key(|point| std::cmp::Reverse(point.address));
    let best_total_from =
        |best_from: &BTreeMap<u32, f64>, address: u32| best_from.range(address..).next().map_or(0.0, |(_, bits)| *bits);
    for point in by_start {
        let with = point.weight() + best_total_from(&best_from, point.end());
        let best = best_total_from(&best_from, u32::from(point.address)).max(with);
        best_from.insert(u32::from(point.address), best);
    }
    let best_total_with: Vec<f64> = all
        .iter()
        .zip(&last_before)
        .map(|(candidate, before)| best_of_first[*before] + candidate.weight() + best_total_from(&best_from, candidate.end()))
        .collect();
    let (mut chosen, mut remaining) = (Vec::new(), all.len());
    while remaining > 0 {
        let i = remaining - 1;
        if best_of_first[remaining] > best_of_first[i] {
            let mut point = all[i].clone();
            let rival = all.iter().zip(&best_total_with).filter(|(other, _)| other.overlaps(&point)).map(|(_, bits)| *bits);
            point.is_certain &= rival.fold(0.0, f64::max) + MIN_MARGIN_BITS <= best_total_with[i];
            chosen.push(point);
            remaining = last_before[i];
        } else {
            remaining = i;
        }
    }
    chosen.reverse();
    chosen
}

/// Pairs of registers of one block that change together: where one changes, the other does as well, at least nine times of
/// ten.
fn correlated_pairs(blocks: &Blocks) -> Vec<Json> {
    let mut found = Vec::new();
    for ((first, _), block) in blocks.iter().filter(|(_, block)| block.rows.len() > 8) {
        let width = block.rows.iter().map(Vec::len).min().unwrap_or(0);
        let changed: Vec<Vec<bool>> =
            (0..width).map(|i| block.rows.windows(2).map(|pair| pair[0][i] != pair[1][i]).collect()).collect();
        for a in 0..width {
            for b in a + 1..width {
                let both = changed[a].iter().zip(&changed[b]).filter(|(x, y)| **x && **y).count();
                let any = changed[a].iter().zip(&changed[b]).filter(|(x, y)| **x || **y).count();
                // A register that changes at nearly every sample coincides with all others by chance.
                if any > 4 && any * 2 < changed[a].len() && both * 10 >= any * 9 {
                    found.push(json!([usize::from(*first) + a, usize::from(*first) + b]));
                }
            }
        }
    }
    found
}
