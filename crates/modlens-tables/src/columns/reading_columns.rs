//! The columns of the readings table: a row per register or bit, or per value where a profile applies.

use serde_json::{Map, Value as Json};

use crate::columns::bus_cells::{bus, network, time, us};
use crate::columns::cell::{Cell, Items};
use crate::columns::function_rows::row_of;
use crate::columns::reading_rows::{each_part, ReadingRef};
use crate::columns::transaction_view::TransactionView;
use modlens_engine::records::{Batch, FrameRef, Transaction};
use modlens_profiles::points::{CompiledPoint, PlanInstance, Value};
use modlens_protocol::register_type::Space;

pub(super) type ReadItem = for<'a> fn(&'a Batch, ReadingRef<'a>) -> Cell<'a>;

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
    ("address", |_, r| Cell::Int(i64::from(r.entry.address))),
    ("operation", |_, r| Cell::Word(if r.block.is_write { "write" } else { "read" })),
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
        let unit = point_of(b, r).and_then(|(instance, compiled)| instance.plan.point(compiled).unit.as_deref());
        unit.map_or(Cell::Null, Cell::Text)
    }),
];

/// Columns that have the same value in all rows of a block.
pub(super) const BLOCK_COLUMNS: [&str; 11] =
    ["txn", "frame", "time", "elapsed_us", "bus", "client", "unit", "function", "register_type", "operation", "status"];

/// The named values of a transaction as a JSON object, those written first; null if there are none.
pub(super) fn named<'a>(batch: &'a Batch, exchange: TransactionView<'_>, instance: &PlanInstance) -> Cell<'a> {
    let mut map = Map::new();
    for is_write in [true, false] {
        each_part(batch, exchange, is_write, |items, item, entry| {
            let Some(compiled) = entry.compiled_index().map(|at| instance.plan.compiled_point(at)) else { return };
            let value = value_of(items, item, instance, compiled);
            map.insert(compiled.name.clone(), value.map_or(Json::Null, |value| json(&value)));
        });
    }
    if map.is_empty() {
        Cell::Null
    } else {
        Cell::Map(Json::Object(map))
    }
}

/// A value as JSON: a number where JSON has an exact one, otherwise text.
fn json(value: &Value<'_>) -> Json {
    match value {
        Value::Decimal(digits, 0) => i64::try_from(*digits).map_or_else(|_| value.text().into(), Json::from),
        Value::Decimal(..) | Value::Single(_) | Value::Double(_) => {
            // The shortest text of the number. JSON has no NaN and infinity, which become text.
            let text = value.text().unwrap_or_default();
            serde_json::from_str(&text).unwrap_or(Json::String(text))
        }
        other => other.text().map_or(Json::Null, Json::String),
    }
}

/// The transaction of a row.
fn txn<'a>(batch: &'a Batch, at: ReadingRef<'_>) -> &'a Transaction {
    &batch.all_transactions()[at.block.txn as usize]
}

/// The frame that carried the value: the request for a write, the response for a read.
fn half<'a>(batch: &'a Batch, at: ReadingRef<'_>) -> &'a FrameRef {
    let t = txn(batch, at);
    if at.block.is_write {
        &t.request
    } else {
        &t.response
    }
}

/// The plan and the point of a row, if a profile has one for it.
fn point_of<'a>(batch: &'a Batch, at: ReadingRef<'_>) -> Option<(&'a PlanInstance, &'a CompiledPoint)> {
    let (index, instance) = (at.entry.compiled_index()?, txn(batch, at).points.as_deref()?);
    Some((instance, instance.plan.compiled_point(index)))
}

fn compiled<'a>(batch: &'a Batch, at: ReadingRef<'_>) -> Option<&'a CompiledPoint> {
    point_of(batch, at).map(|(_, compiled)| compiled)
}

/// The registers or the bit of a row, as on the wire.
fn raw<'a>(batch: &'a Batch, at: ReadingRef<'_>) -> Option<Items<'a>> {
    slice_of(&at.block.items(batch), at.index_in_block() as u16, compiled(batch, at).map_or(1, |point| point.width))
}

/// `width` registers from index `item` of a block, or one bit; `None` if the block ends before.
#[inline]
fn slice_of<'a>(items: &Items<'a>, item: u16, width: u16) -> Option<Items<'a>> {
    let (first, last) = (usize::from(item), usize::from(item) + usize::from(width));
    if last > items.len() {
        return None;
    }
    Some(match items {
        Items::Words(bytes) => Items::Words(&bytes[2 * first..2 * last]),
        other => Items::One(other.get(first)),
    })
}

/// The value of a point at index `item` of a block.
fn value_of<'p>(items: &Items<'_>, item: u16, instance: &'p PlanInstance, point: &'p CompiledPoint) -> Option<Value<'p>> {
    Some(match slice_of(items, item, point.width)? {
        Items::Words(bytes) => instance.value(point, bytes),
        // The register of a single write is stored as a number.
        Items::One(number) if !instance.plan.point(point).space.is_bits() => {
            instance.value(point, &(number as u16).to_be_bytes())
        }
        bit => instance.bit(point, bit.get(0)),
    })
}

/// The value of a row: that of its point, or the bare register or bit.
fn value<'a>(batch: &'a Batch, at: ReadingRef<'_>) -> Option<Value<'a>> {
    match point_of(batch, at) {
        Some((instance, compiled)) => value_of(&at.block.items(batch), at.index_in_block() as u16, instance, compiled),
        None => raw(batch, at).map(|items| Value::Decimal(i128::from(items.get(0)), 0)),
    }
}

/// A value, or a register or bit without a point, for code that visits all values of a batch.
pub struct ReadingView<'a> {
    /// Its transaction.
    pub transaction: &'a Transaction,
    /// The table that it belongs to.
    pub space: Space,
    /// The address of its first register or bit.
    pub address: u16,
    /// Whether it was written rather than read.
    pub is_write: bool,
    /// The compiled point and its index in the plan, if it has one.
    pub compiled: Option<(u32, &'a CompiledPoint)>,
    /// Its registers as on the wire; one byte for a bit.
    pub raw: Vec<u8>,
}

impl ReadingView<'_> {
    /// The converted value.
    pub fn value(&self) -> Value<'_> {
        let instance = self.transaction.points.as_deref();
        match (self.compiled, instance, &self.raw[..]) {
            (Some((_, compiled)), Some(instance), [bit]) => instance.bit(compiled, i32::from(*bit)),
            (Some((_, compiled)), Some(instance), bytes) => instance.value(compiled, bytes),
            (_, _, bytes) => Value::Decimal(bytes.iter().fold(0, |number, &byte| number << 8 | i128::from(byte)), 0),
        }
    }
}

/// Calls `slice_of` for every value of a batch, by transaction, those written first.
pub fn each_value(batch: &Batch, mut visit: impl FnMut(ReadingView<'_>)) {
    for t in batch.all_transactions() {
        let Some(space) = row_of(batch, t).and_then(|row| row.space) else { continue };
        for is_write in [true, false] {
            each_part(batch, TransactionView::new(batch, t), is_write, |items, item, entry| {
                let compiled = entry.compiled_index().and_then(|at| Some((at, t.points.as_ref()?.plan.compiled_point(at))));
                let width = compiled.map_or(1, |(_, compiled)| compiled.width);
                let Some(items) = slice_of(items, item, width) else { return };
                let raw = match items {
                    Items::Words(bytes) => bytes.to_vec(),
                    Items::One(number) if !space.is_bits() => (number as u16).to_be_bytes().to_vec(),
                    bit => vec![bit.get(0) as u8],
                };
                visit(ReadingView { transaction: t, space, address: entry.address, is_write, compiled, raw });
            });
        }
    }
}
