//! What traffic tells of a device: which registers are asked for, in which blocks, what their values do, and which of
//! them belong together. The result is a skeleton of a profile, with the evidence.

use std::collections::BTreeMap;

use serde_json::{json, Value as Json};

use crate::columns::{read_data, read_range, row_of, write_data, write_range, Items};
use modlens_engine::records::{Batch, Transaction};
use modlens_profiles::learn::{judge, text, AHEAD};
use modlens_profiles::profile::Order;
use modlens_protocol::register_type::Space;
use modlens_protocol::status::Status;

/// Samples of a block that are kept: the first ones.
const SAMPLES: usize = 512;

/// Collects blocks of registers over a whole recording.
#[derive(Debug, Default)]
pub struct Survey {
    units: BTreeMap<(u8, Space), Blocks>,
}

/// The blocks of one table of one unit, by first register and quantity.
type Blocks = BTreeMap<(u16, u16), Block>;

#[derive(Debug, Default)]
struct Block {
    reads: u64,
    writes: u64,
    exceptions: BTreeMap<u8, u64>,
    rows: Vec<Vec<u16>>,
}

impl Survey {
    /// The transactions of a batch.
    pub fn add(&mut self, batch: &Batch) {
        for t in &batch.transactions {
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

    /// What was learnt of each unit, as JSON.
    pub fn json(&self) -> Json {
        self.units.iter().map(|((unit, space), blocks)| table(*unit, *space, blocks)).collect()
    }
}

impl Block {
    fn put(&mut self, t: &Transaction, items: Option<Items<'_>>) {
        if let Some(code) = t.exception {
            *self.exceptions.entry(code).or_default() += 1;
        }
        let Some(items) = items.filter(|_| self.rows.len() < SAMPLES) else { return };
        self.rows.push((0..items.len()).map(|i| items.get(i) as u16).collect());
    }
}

fn table(unit: u8, space: Space, blocks: &Blocks) -> Json {
    let listed: Vec<Json> = blocks
        .iter()
        .map(|((first, count), block)| {
            json!({"first": first, "count": count, "reads": block.reads, "writes": block.writes, "exceptions": block.exceptions})
        })
        .collect();
    let mut points = Vec::new();
    let mut registers: BTreeMap<u16, Register> = BTreeMap::new();
    for ((first, _), block) in blocks {
        for row in &block.rows {
            for (i, &value) in row.iter().enumerate() {
                registers.entry(first.wrapping_add(i as u16)).or_default().put(value, block);
            }
        }
    }
    if !space.bits() {
        points = claims(blocks, &registers);
    }
    let singles: Vec<Json> = registers.iter().map(|(address, register)| register.json(*address)).collect();
    json!({
        "unit": unit, "register_type": space.long(), "space": space.short(), "blocks": listed, "registers": singles,
        "points": points.iter().map(Found::json).collect::<Vec<_>>(), "together": together(blocks),
    })
}

/// What one register did.
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

    fn json(&self, address: u16) -> Json {
        let mut distinct = self.values.clone();
        distinct.sort_unstable();
        distinct.dedup();
        let changes = self.values.windows(2).filter(|pair| pair[0] != pair[1]).count();
        let rising = self.values.windows(2).all(|pair| pair[1].wrapping_sub(pair[0]) < 0x1000);
        // Around zero a signed quantity jumps from 65535 to 0.
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

/// Registers that belong together.
#[derive(Clone, Debug)]
struct Found {
    address: u16,
    count: u16,
    kind: &'static str,
    order: Order,
    bits: f64,
    sure: bool,
    reason: String,
    rivals: Vec<(&'static str, Order)>,
}

impl Found {
    fn end(&self) -> u32 {
        u32::from(self.address) + u32::from(self.count)
    }

    /// Whether another claim takes some of its registers.
    fn overlaps(&self, other: &Self) -> bool {
        let same = (self.address, self.count) == (other.address, other.count);
        !same && u32::from(self.address) < other.end() && u32::from(other.address) < self.end()
    }

    /// What nothing else comes near counts more than what is a guess.
    fn worth(&self) -> f64 {
        if self.sure {
            self.bits
        } else {
            self.bits / 4.0
        }
    }

    fn json(&self) -> Json {
        let rivals: Vec<Json> = self.rivals.iter().map(|(kind, order)| json!({"type": kind, "order": order.word()})).collect();
        json!({
            "address": self.address, "count": self.count, "type": self.kind, "order": self.order.word(),
            "bits": (self.bits * 10.0).round() / 10.0, "sure": self.sure, "reason": self.reason, "rivals": rivals,
        })
    }
}

/// The best set of claims that do not overlap.
fn claims(blocks: &Blocks, registers: &BTreeMap<u16, Register>) -> Vec<Found> {
    let constant: BTreeMap<u16, u16> = registers
        .iter()
        .filter(|(_, register)| register.values.windows(2).all(|pair| pair[0] == pair[1]))
        .filter_map(|(address, register)| Some((*address, *register.values.first()?)))
        .collect();
    let texts: Vec<Found> = text::runs(&constant)
        .into_iter()
        .map(|run| Found {
            address: run.address,
            count: run.count,
            kind: "str",
            order: if run.swapped { Order::Badc } else { Order::Abcd },
            bits: 40.0,
            sure: true,
            reason: format!("constant letters: {:?}", run.text),
            rivals: Vec::new(),
        })
        .collect();
    let chosen = |usual: Option<Order>| {
        let mut all = texts.clone();
        for &address in registers.keys() {
            for width in [2u16, 4] {
                all.extend(window(blocks, address, width, usual));
            }
        }
        best_set(all)
    };
    let first = chosen(None);
    match usual_order(&first) {
        None => first,
        usual => chosen(usual),
    }
}

/// The order that the device has for most of what is sure.
fn usual_order(claims: &[Found]) -> Option<Order> {
    let sure: Vec<Order> = claims.iter().filter(|claim| claim.sure && claim.kind != "str").map(|claim| claim.order).collect();
    let votes = |order: Order| sure.iter().filter(|&&other| other == order).count();
    let (order, _) = Order::ALL.into_iter().max_by_key(|(order, _)| votes(*order))?;
    (votes(order) >= 3 && votes(order) * 3 >= sure.len() * 2).then_some(order)
}

fn window(blocks: &Blocks, address: u16, width: u16, usual: Option<Order>) -> Option<Found> {
    let holds = |first: u16, count: u16| {
        u32::from(first) <= u32::from(address) && u32::from(address) + u32::from(width) <= u32::from(first) + u32::from(count)
    };
    let (mut best, mut just, mut all): (Option<(usize, &Block)>, u64, u64) = (None, 0, 0);
    for ((first, count), block) in blocks {
        if !holds(*first, *count) {
            continue;
        }
        all += block.reads + block.writes;
        if (*first, *count) == (address, width) {
            just += block.reads + block.writes;
        }
        if best.is_none_or(|(_, other)| other.rows.len() < block.rows.len()) {
            best = Some((usize::from(address - first), block));
        }
    }
    let (at, block) = best?;
    let end = at + usize::from(width);
    let rows: Vec<&[u16]> = block.rows.iter().filter_map(|row| row.get(at..end)).collect();
    let claims = judge(&rows, just as f64 / all.max(1) as f64, usual);
    let claim = claims.first()?;
    let rivals = claims.iter().skip(1).take(2).map(|claim| (claim.kind.word(), claim.order)).collect();
    Some(Found {
        address,
        count: width,
        kind: claim.kind.word(),
        order: claim.order,
        bits: claim.bits,
        sure: claim.sure,
        reason: claim.reason.clone(),
        rivals,
    })
}

/// Weighted interval scheduling: the claims without overlap that have the most bits together. One that another set of
/// claims comes near without is not sure.
fn best_set(mut all: Vec<Found>) -> Vec<Found> {
    all.sort_by_key(Found::end);
    let before: Vec<usize> = all.iter().map(|one| all.partition_point(|other| other.end() <= u32::from(one.address))).collect();
    // front[i]: of the first i claims.
    let mut front = vec![0.0f64; all.len() + 1];
    for (i, found) in all.iter().enumerate() {
        front[i + 1] = front[i].max(front[before[i]] + found.worth());
    }
    // back[at]: of the claims that begin at or behind an address.
    let mut back: BTreeMap<u32, f64> = BTreeMap::new();
    let mut by_start: Vec<&Found> = all.iter().collect();
    by_start.sort_by_key(|found| std::cmp::Reverse(found.address));
    let behind = |back: &BTreeMap<u32, f64>, at: u32| back.range(at..).next().map_or(0.0, |(_, bits)| *bits);
    for found in by_start {
        let with = found.worth() + behind(&back, found.end());
        let best = behind(&back, u32::from(found.address)).max(with);
        back.insert(u32::from(found.address), best);
    }
    let through: Vec<f64> =
        all.iter().zip(&before).map(|(one, at)| front[*at] + one.worth() + behind(&back, one.end())).collect();
    let (mut chosen, mut at) = (Vec::new(), all.len());
    while at > 0 {
        let i = at - 1;
        if front[at] > front[i] {
            let mut found = all[i].clone();
            let rival = all.iter().zip(&through).filter(|(other, _)| other.overlaps(&found)).map(|(_, bits)| *bits);
            found.sure &= rival.fold(0.0, f64::max) + AHEAD <= through[i];
            chosen.push(found);
            at = before[i];
        } else {
            at = i;
        }
    }
    chosen.reverse();
    chosen
}

/// Pairs of registers of one block that change at the same samples, nine times of ten at least.
fn together(blocks: &Blocks) -> Vec<Json> {
    let mut found = Vec::new();
    for ((first, _), block) in blocks.iter().filter(|(_, block)| block.rows.len() > 8) {
        let width = block.rows.iter().map(Vec::len).min().unwrap_or(0);
        let moves: Vec<Vec<bool>> =
            (0..width).map(|i| block.rows.windows(2).map(|pair| pair[0][i] != pair[1][i]).collect()).collect();
        for a in 0..width {
            for b in a + 1..width {
                let both = moves[a].iter().zip(&moves[b]).filter(|(x, y)| **x && **y).count();
                let any = moves[a].iter().zip(&moves[b]).filter(|(x, y)| **x || **y).count();
                // What changes at every sample goes along with everything.
                if any > 4 && any * 2 < moves[a].len() && both * 10 >= any * 9 {
                    found.push(json!([usize::from(*first) + a, usize::from(*first) + b]));
                }
            }
        }
    }
    found
}
