//! Rows as Arrow columns.
#![allow(clippy::inline_always)] // See `Put`.

use std::mem::ManuallyDrop;
use std::ops::Range;
use std::sync::Arc;

use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int32Array, Int64Array, ListArray, RecordBatch, StringArray, TimestampNanosecondArray,
};
use arrow_buffer::{Buffer, NullBufferBuilder, OffsetBuffer};
use arrow_schema::{DataType, Field, Schema, TimeUnit};

use crate::columns::{Cell, Items, Kind, Put, RowRef, Table, TableKind};
use crate::pdu::push_hex;
use crate::write::{push_plain, push_short, push_source};

/// The schema of a table.
pub fn schema(kind: TableKind) -> Schema {
    schema_of(kind, &all(kind))
}

/// The schema of some of its columns.
pub fn schema_of(kind: TableKind, columns: &[usize]) -> Schema {
    let columns = columns.iter().map(|&column| &kind.columns()[column]);
    Schema::new(columns.map(|column| Field::new(&column.key, data_type(column.kind), true)).collect::<Vec<_>>())
}

fn all(kind: TableKind) -> Vec<usize> {
    (0..kind.columns().len()).collect()
}

fn data_type(kind: Kind) -> DataType {
    let list = |item| DataType::List(Arc::new(Field::new("item", item, true)));
    match kind {
        Kind::Int => DataType::Int64,
        Kind::Us | Kind::Float => DataType::Float64,
        Kind::Time => DataType::Timestamp(TimeUnit::Nanosecond, Some("UTC".into())),
        Kind::Bool => DataType::Boolean,
        Kind::Text | Kind::Map => DataType::Utf8,
        Kind::Ints => list(DataType::Int32),
        Kind::Texts => list(DataType::Utf8),
    }
}

/// The rows of a table as one record batch.
pub fn batch(table: &Table) -> RecordBatch {
    batch_of(table, 0..table.len(), &all(table.kind))
}

/// Some columns of some rows as one record batch.
pub fn batch_of(table: &Table, rows: Range<usize>, columns: &[usize]) -> RecordBatch {
    let rows: Vec<RowRef<'_>> = rows.map(|row| table.row(row)).collect();
    let arrays = columns.iter().map(|&column| array(&rows, table.kind, column)).collect();
    RecordBatch::try_new(Arc::new(schema_of(table.kind, columns)), arrays).expect("columns are built by the schema")
}

fn array(rows: &[RowRef<'_>], table: TableKind, column: usize) -> ArrayRef {
    match table.columns()[column].kind {
        kind @ (Kind::Int | Kind::Time) => wholes(filled(rows, table, column), kind),
        Kind::Us | Kind::Float => numbers(filled(rows, table, column)),
        Kind::Bool => truths(filled(rows, table, column)),
        Kind::Text | Kind::Map => texts(filled(rows, table, column)),
        Kind::Ints => lists(filled(rows, table, column)),
        Kind::Texts => codes(filled(rows, table, column)),
    }
}

/// One value after the other: how many, where each ends, which are null.
struct Values<T> {
    items: Vec<T>,
    nulls: NullBufferBuilder,
    /// Of lists and texts.
    offsets: Vec<i32>,
}

/// A column of this kind with the values of all rows.
fn filled<T>(rows: &[RowRef<'_>], table: TableKind, column: usize) -> Values<T>
where
    Values<T>: Put + 'static,
{
    let mut offsets = Vec::with_capacity(rows.len() + 1);
    offsets.push(0);
    let nulls = NullBufferBuilder::new(rows.len());
    let mut values = Values { items: Vec::with_capacity(rows.len()), nulls, offsets };
    let reader = table.reader(column);
    for row in rows {
        row.pass(&reader, &mut values);
    }
    values
}

impl<T: Clone + Default> Values<T> {
    #[inline(always)]
    fn one(&mut self, value: Option<T>) {
        self.nulls.append(value.is_some());
        self.items.push(value.unwrap_or_default());
    }

    #[inline(always)]
    fn end(&mut self, there: bool) {
        self.offsets.push(self.items.len() as i32);
        self.nulls.append(there);
    }
}

impl Put for Values<i64> {
    #[inline(always)]
    fn put(&mut self, cell: Cell<'_>) {
        self.one(match *ManuallyDrop::new(cell) {
            Cell::Int(n) | Cell::Time(n) => Some(n),
            _ => None,
        });
    }
}

fn wholes(column: Values<i64>, kind: Kind) -> ArrayRef {
    let Values { items: values, mut nulls, .. } = column;
    if kind == Kind::Time {
        Arc::new(TimestampNanosecondArray::new(values.into(), nulls.finish()).with_timezone("UTC"))
    } else {
        Arc::new(Int64Array::new(values.into(), nulls.finish()))
    }
}

impl Put for Values<f64> {
    #[inline(always)]
    fn put(&mut self, cell: Cell<'_>) {
        self.one(match *ManuallyDrop::new(cell) {
            Cell::Us(ns) => Some(ns as f64 / 1000.0),
            Cell::Float(value) => Some(value),
            Cell::Int(n) | Cell::Time(n) => Some(n as f64),
            _ => None,
        });
    }
}

fn numbers(column: Values<f64>) -> ArrayRef {
    let Values { items: values, mut nulls, .. } = column;
    Arc::new(Float64Array::new(values.into(), nulls.finish()))
}

impl Put for Values<bool> {
    #[inline(always)]
    fn put(&mut self, cell: Cell<'_>) {
        self.one(if let Cell::Bool(yes) = *ManuallyDrop::new(cell) { Some(yes) } else { None });
    }
}

fn truths(column: Values<bool>) -> ArrayRef {
    let Values { items: values, mut nulls, .. } = column;
    Arc::new(BooleanArray::new(values.into(), nulls.finish()))
}

impl Put for Values<u8> {
    #[inline(always)]
    fn put(&mut self, cell: Cell<'_>) {
        let cell = ManuallyDrop::new(cell);
        match *cell {
            Cell::Null => return self.end(false),
            Cell::Word(text) | Cell::Text(text) => push_short(text.as_bytes(), &mut self.items),
            Cell::Hex(bytes) => push_hex(bytes, &mut self.items),
            Cell::Source(file, place, number) => push_source(file, place, number, &mut self.items),
            _ => push_plain(&ManuallyDrop::into_inner(cell), &mut self.items),
        }
        self.end(true);
    }
}

/// Texts are written one behind the other, where they stay.
fn texts(column: Values<u8>) -> ArrayRef {
    let Values { items: values, mut nulls, offsets } = column;
    Arc::new(StringArray::new(OffsetBuffer::new(offsets.into()), Buffer::from_vec(values), nulls.finish()))
}

/// Lists of numbers, with one look at the list for all of its numbers.
impl Put for Values<i32> {
    #[inline(always)]
    fn put(&mut self, cell: Cell<'_>) {
        let Cell::Ints(items) = *ManuallyDrop::new(cell) else { return self.end(false) };
        match items {
            Items::Words(bytes) => {
                self.items.extend(bytes.chunks_exact(2).map(|word| i32::from(u16::from_be_bytes([word[0], word[1]]))));
            }
            items => self.items.extend((0..items.len()).map(|i| items.get(i))),
        }
        self.end(true);
    }
}

fn lists(column: Values<i32>) -> ArrayRef {
    let Values { items: values, mut nulls, offsets } = column;
    let item = Arc::new(Field::new("item", DataType::Int32, true));
    let values = Arc::new(Int32Array::from(values));
    Arc::new(ListArray::new(item, OffsetBuffer::new(offsets.into()), values, nulls.finish()))
}

impl Put for Values<&'static str> {
    #[inline(always)]
    fn put(&mut self, cell: Cell<'_>) {
        if let Cell::Codes(codes) = *ManuallyDrop::new(cell) {
            self.items.extend(codes.iter().map(|code| code.doc().code));
        }
        self.end(true);
    }
}

fn codes(column: Values<&'static str>) -> ArrayRef {
    let Values { items: values, mut nulls, offsets } = column;
    let item = Arc::new(Field::new("item", DataType::Utf8, true));
    let values = Arc::new(StringArray::from(values));
    Arc::new(ListArray::new(item, OffsetBuffer::new(offsets.into()), values, nulls.finish()))
}
