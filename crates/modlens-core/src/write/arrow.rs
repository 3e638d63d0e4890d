//! Rows as Arrow columns.

use std::sync::Arc;

use arrow_array::builder::{
    BooleanBuilder, Float64Builder, Int64Builder, ListBuilder, StringBuilder, TimestampNanosecondBuilder,
};
use arrow_array::{ArrayRef, Int32Array, ListArray, RecordBatch, StringArray};
use arrow_buffer::{Buffer, NullBufferBuilder, OffsetBuffer};
use arrow_schema::{DataType, Field, Schema, TimeUnit};

use crate::columns::{Cell, Items, Kind, Table, TableKind};
use crate::write::push_plain;

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
    batch_of(table, &all(table.kind))
}

/// Some columns of the rows as one record batch.
pub fn batch_of(table: &Table, columns: &[usize]) -> RecordBatch {
    let arrays = columns.iter().map(|&column| array(table, column, table.kind.columns()[column].kind)).collect();
    RecordBatch::try_new(Arc::new(schema_of(table.kind, columns)), arrays).expect("columns are built by the schema")
}

fn array(table: &Table, column: usize, kind: Kind) -> ArrayRef {
    let cells = (0..table.len()).map(|row| table.cell(row, column));
    match kind {
        Kind::Int => {
            let mut out = Int64Builder::with_capacity(table.len());
            cells.for_each(|cell| out.append_option(whole(&cell)));
            Arc::new(out.finish())
        }
        Kind::Us | Kind::Float => {
            let mut out = Float64Builder::with_capacity(table.len());
            cells.for_each(|cell| {
                out.append_option(match cell {
                    Cell::Us(ns) => Some(ns as f64 / 1000.0),
                    Cell::Float(value) => Some(value),
                    other => whole(&other).map(|n| n as f64),
                });
            });
            Arc::new(out.finish())
        }
        Kind::Time => {
            let mut out = TimestampNanosecondBuilder::with_capacity(table.len());
            cells.for_each(|cell| out.append_option(whole(&cell)));
            Arc::new(out.finish().with_timezone("UTC"))
        }
        Kind::Bool => {
            let mut out = BooleanBuilder::with_capacity(table.len());
            cells.for_each(|cell| out.append_option(if let Cell::Bool(yes) = cell { Some(yes) } else { None }));
            Arc::new(out.finish())
        }
        Kind::Text | Kind::Map => texts(table.len(), cells),
        Kind::Ints => ints(table.len(), cells),
        Kind::Texts => {
            let mut out = ListBuilder::new(StringBuilder::new());
            for cell in cells {
                if let Cell::Codes(codes) = cell {
                    for code in codes {
                        out.values().append_value(code.doc().code);
                    }
                }
                out.append(true);
            }
            Arc::new(out.finish())
        }
    }
}

/// Lists of numbers, with one look at the list for all of its numbers.
fn ints<'a>(rows: usize, cells: impl Iterator<Item = Cell<'a>>) -> ArrayRef {
    let mut values: Vec<i32> = Vec::new();
    let mut offsets = Vec::with_capacity(rows + 1);
    let mut nulls = NullBufferBuilder::new(rows);
    offsets.push(0);
    for cell in cells {
        match cell {
            Cell::Ints(Items::Words(bytes)) => {
                values.extend(bytes.chunks_exact(2).map(|word| i32::from(u16::from_be_bytes([word[0], word[1]]))));
                nulls.append_non_null();
            }
            Cell::Ints(items) => {
                values.extend((0..items.len()).map(|i| items.get(i)));
                nulls.append_non_null();
            }
            _ => nulls.append_null(),
        }
        offsets.push(values.len() as i32);
    }
    let item = Arc::new(Field::new("item", DataType::Int32, true));
    let values = Arc::new(Int32Array::from(values));
    Arc::new(ListArray::new(item, OffsetBuffer::new(offsets.into()), values, nulls.finish()))
}

/// Texts are written one behind the other, where they stay.
fn texts<'a>(rows: usize, cells: impl Iterator<Item = Cell<'a>>) -> ArrayRef {
    let mut values = Vec::with_capacity(rows * 16);
    let mut offsets = Vec::with_capacity(rows + 1);
    let mut nulls = NullBufferBuilder::new(rows);
    offsets.push(0);
    for cell in cells {
        match cell {
            Cell::Null => nulls.append_null(),
            Cell::Word(text) | Cell::Text(text) => {
                values.extend_from_slice(text.as_bytes());
                nulls.append_non_null();
            }
            other => {
                push_plain(&other, &mut values);
                nulls.append_non_null();
            }
        }
        offsets.push(values.len() as i32);
    }
    let offsets = OffsetBuffer::new(offsets.into());
    Arc::new(StringArray::new(offsets, Buffer::from_vec(values), nulls.finish()))
}

fn whole(cell: &Cell<'_>) -> Option<i64> {
    match cell {
        Cell::Int(n) | Cell::Time(n) => Some(*n),
        _ => None,
    }
}
