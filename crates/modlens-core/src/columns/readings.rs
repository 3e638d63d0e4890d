//! The readings table: a row a register or bit, and where a profile applies a row a value.

use serde_json::{Map, Value as Json};

use crate::columns::content::{read_data, read_range, row_of, write_data, write_range};
use crate::columns::tables::{bus, int, network, time, us};
use crate::columns::{Cell, Items};
use crate::points::{Bound, Compiled, Value};
use crate::profile::Space;
use crate::records::{Batch, Half, Transaction};

/// One row: which transaction, where in its block, which value of its plan.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// In `Batch::transactions`.
    txn: u32,
    /// In the plan of the transaction; `NONE` for a bare register or bit.
    compiled: u32,
    /// In the block.
    item: u16,
    /// Whether it was written.
    write: bool,
}

const NONE: u32 = u32::MAX;

pub(super) type ReadItem = for<'a> fn(&'a Batch, Reading) -> Cell<'a>;

pub(super) const READINGS: &[(&str, ReadItem)] = &[
    ("txn", |b, r| Cell::Int(txn(b, r).number as i64)),
    ("frame", |b, r| Cell::Int(half(b, r).frame as i64)),
    ("time", |b, r| time(b, txn(b, r).bus, half(b, r).start)),
    ("elapsed_us", |b, r| {
        let shift = txn(b, r).start.zip(txn(b, r).elapsed).map(|(start, elapsed)| start - elapsed);
        us(half(b, r).start.zip(shift).map(|(start, shift)| start - shift))
    }),
    ("bus", |b, r| Cell::Text(&bus(b, txn(b, r).bus).name)),
    ("client", |b, r| network(b, txn(b, r).bus, |net| Cell::Text(&net.client))),
    ("unit", |b, r| Cell::Int(i64::from(txn(b, r).unit))),
    ("function", |b, r| Cell::Int(i64::from(txn(b, r).function))),
    ("register_type", |b, r| row_of(b, txn(b, r)).and_then(|row| row.register_type.as_deref()).map_or(Cell::Null, Cell::Text)),
    ("address", |b, r| {
        let range = if r.write { write_range(b, txn(b, r)) } else { read_range(b, txn(b, r)) };
        int(range.map(|range| (i64::from(range.0) + i64::from(r.item)) & 0xFFFF))
    }),
    ("operation", |_, r| Cell::Word(if r.write { "write" } else { "read" })),
    ("status", |b, r| Cell::Word(txn(b, r).status.text())),
    ("raw", |b, r| raw(b, r).map_or(Cell::Null, Cell::Ints)),
    ("name", |b, r| compiled(b, r).map_or(Cell::Null, |compiled| Cell::Text(&compiled.name))),
    ("value", |b, r| match value(b, r) {
        Some(Value::Decimal(digits, 0)) if digits.unsigned_abs() < 1 << 53 => Cell::Int(digits as i64),
        other => other.and_then(|value| value.number()).map_or(Cell::Null, Cell::Float),
    }),
    ("value_text", |b, r| match value(b, r) {
        None | Some(Value::Missing) => Cell::Null,
        Some(value) => Cell::Value(value),
    }),
    ("unit_of_measure", |b, r| {
        let unit = point_of(b, r).and_then(|(bound, compiled)| bound.plan.point(compiled).unit.as_deref());
        unit.map_or(Cell::Null, Cell::Text)
    }),
];

/// The rows of a batch. Refused and unanswered writes are listed too, with their status.
pub(super) fn readings(batch: &Batch) -> Vec<Reading> {
    let mut rows = Vec::new();
    for (i, t) in batch.transactions.iter().enumerate() {
        for write in [true, false] {
            let txn = i as u32;
            block(batch, t, write, |item, compiled| {
                rows.push(Reading { txn, compiled: compiled.unwrap_or(NONE), item, write });
            });
        }
    }
    rows
}

/// The parts of what was written or read: registers, bits, and values of the plan.
fn block(batch: &Batch, t: &Transaction, write: bool, mut part: impl FnMut(u16, Option<u32>)) {
    let items = if write { write_data(batch, t) } else { read_data(batch, t) };
    let Some(items) = items else { return };
    let range = if write { write_range(batch, t) } else { read_range(batch, t) };
    let Some((first, _)) = range else { return };
    match (&t.points, row_of(batch, t).and_then(|row| Space::from_word(row.register_type.as_deref()?))) {
        (Some(bound), Some(space)) => bound.plan.block(space, first, items.len(), |step| part(step.item, step.compiled)),
        _ => (0..items.len()).for_each(|item| part(item as u16, None)),
    }
}

/// The named values of a transaction, as a map; those written first.
pub(super) fn named<'a>(batch: &'a Batch, t: &'a Transaction) -> Cell<'a> {
    let Some(bound) = &t.points else { return Cell::Null };
    let mut map = Map::new();
    for write in [true, false] {
        block(batch, t, write, |item, at| {
            let Some(compiled) = at.map(|at| bound.plan.compiled(at)) else { return };
            let value = value_at(batch, t, bound, compiled, (item, write));
            map.insert(compiled.name.clone(), value.map_or(Json::Null, |value| json(&value)));
        });
    }
    if map.is_empty() {
        Cell::Null
    } else {
        Cell::Map(Json::Object(map))
    }
}

/// A number where a number says it, else the letters.
fn json(value: &Value<'_>) -> Json {
    match value {
        Value::Decimal(digits, 0) => i64::try_from(*digits).map_or_else(|_| value.text().into(), Json::from),
        Value::Decimal(..) | Value::Single(_) | Value::Double(_) => {
            // The shortest number that reads back the same; NaN and the like are letters.
            let text = value.text().unwrap_or_default();
            serde_json::from_str(&text).unwrap_or(Json::String(text))
        }
        other => other.text().map_or(Json::Null, Json::String),
    }
}

fn txn(batch: &Batch, reading: Reading) -> &Transaction {
    &batch.transactions[reading.txn as usize]
}

fn half(batch: &Batch, reading: Reading) -> &Half {
    let t = txn(batch, reading);
    if reading.write {
        &t.request
    } else {
        &t.response
    }
}

fn point_of(batch: &Batch, reading: Reading) -> Option<(&Bound, &Compiled)> {
    if reading.compiled == NONE {
        return None;
    }
    let bound = txn(batch, reading).points.as_deref()?;
    Some((bound, bound.plan.compiled(reading.compiled)))
}

fn compiled(batch: &Batch, reading: Reading) -> Option<&Compiled> {
    point_of(batch, reading).map(|(_, compiled)| compiled)
}

/// The registers or the bit of a row.
fn raw(batch: &Batch, reading: Reading) -> Option<Items<'_>> {
    part(batch, txn(batch, reading), (reading.item, reading.write), compiled(batch, reading).map_or(1, |point| point.width))
}

fn part<'a>(batch: &'a Batch, t: &Transaction, (item, write): (u16, bool), width: u16) -> Option<Items<'a>> {
    let items = if write { write_data(batch, t) } else { read_data(batch, t) }?;
    let (first, last) = (usize::from(item), usize::from(item) + usize::from(width));
    if last > items.len() {
        return None;
    }
    Some(match items {
        Items::Words(bytes) => Items::Words(&bytes[2 * first..2 * last]),
        other => Items::One(other.get(first)),
    })
}

fn value_at<'a>(batch: &Batch, t: &Transaction, bound: &'a Bound, point: &'a Compiled, at: (u16, bool)) -> Option<Value<'a>> {
    Some(match part(batch, t, at, point.width)? {
        Items::Words(bytes) => bound.value(point, bytes),
        // A single write carries its register as a number.
        Items::One(number) if !bound.plan.point(point).space.bits() => bound.value(point, &(number as u16).to_be_bytes()),
        bit => bound.bit(point, bit.get(0)),
    })
}

fn value(batch: &Batch, reading: Reading) -> Option<Value<'_>> {
    match point_of(batch, reading) {
        Some((bound, compiled)) => value_at(batch, txn(batch, reading), bound, compiled, (reading.item, reading.write)),
        None => raw(batch, reading).map(|items| Value::Decimal(i128::from(items.get(0)), 0)),
    }
}

/// A value or a bare register or bit of a transaction, for those who go through all of them.
pub struct Part<'a> {
    /// The transaction.
    pub transaction: &'a Transaction,
    /// Which table.
    pub space: Space,
    /// Its first register or bit.
    pub address: u16,
    /// Whether it was written.
    pub write: bool,
    /// The value of the plan and its index, where it is one.
    pub compiled: Option<(u32, &'a Compiled)>,
    /// Its registers; one byte for a bit.
    pub raw: Vec<u8>,
}

impl Part<'_> {
    /// Converts it.
    pub fn value(&self) -> Value<'_> {
        let bound = self.transaction.points.as_deref();
        match (self.compiled, bound, &self.raw[..]) {
            (Some((_, compiled)), Some(bound), [bit]) => bound.bit(compiled, i32::from(*bit)),
            (Some((_, compiled)), Some(bound), bytes) => bound.value(compiled, bytes),
            (_, _, bytes) => Value::Decimal(bytes.iter().fold(0, |number, &byte| number << 8 | i128::from(byte)), 0),
        }
    }
}

/// Every value of a batch, by transaction; those written first.
pub fn each_value(batch: &Batch, mut part: impl FnMut(Part<'_>)) {
    for t in &batch.transactions {
        let Some(space) = row_of(batch, t).and_then(|row| Space::from_word(row.register_type.as_deref()?)) else { continue };
        for write in [true, false] {
            let range = if write { write_range(batch, t) } else { read_range(batch, t) };
            let Some((first, _)) = range else { continue };
            block(batch, t, write, |item, at| {
                let compiled = at.and_then(|at| Some((at, t.points.as_ref()?.plan.compiled(at))));
                let width = compiled.map_or(1, |(_, compiled)| compiled.width);
                let Some(items) = self::part(batch, t, (item, write), width) else { return };
                let raw = match items {
                    Items::Words(bytes) => bytes.to_vec(),
                    Items::One(number) if !space.bits() => (number as u16).to_be_bytes().to_vec(),
                    bit => vec![bit.get(0) as u8],
                };
                part(Part { transaction: t, space, address: first.wrapping_add(item), write, compiled, raw });
            });
        }
    }
}
