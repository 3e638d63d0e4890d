//! Writes rows as Arrow record batches.

use std::ops::Range;
use std::sync::Arc;

use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int32Array, Int64Array, ListArray, RecordBatch, StringArray, TimestampNanosecondArray,
};
use arrow_buffer::{Buffer, OffsetBuffer};
use arrow_schema::{DataType, Field, Schema, TimeUnit};

use crate::values::{ColumnBuilder, TakeNothing};
use modlens_tables::columns::{CellSink, ColumnReader, ColumnType, ExchangeRef, RowChunk, RowRef, Table, TableKind};

/// The schema of a table.
pub fn schema(kind: TableKind) -> Schema {
    schema_of(kind, &all_columns(kind))
}

/// The schema of some columns of a table.
pub fn schema_of(kind: TableKind, columns: &[usize]) -> Schema {
    let columns = columns.iter().map(|&column| &kind.columns()[column]);
    Schema::new(columns.map(|column| Field::new(&column.key, data_type(column.kind), true)).collect::<Vec<_>>())
}

/// The indices of all columns of a table.
pub fn all_columns(kind: TableKind) -> Vec<usize> {
    (0..kind.columns().len()).collect()
}

/// The Arrow type of a column.
fn data_type(kind: ColumnType) -> DataType {
    let list = |item| DataType::List(Arc::new(Field::new("item", item, true)));
    match kind {
        ColumnType::Int => DataType::Int64,
        ColumnType::Us | ColumnType::Float => DataType::Float64,
        ColumnType::Time => DataType::Timestamp(TimeUnit::Nanosecond, Some("UTC".into())),
        ColumnType::Bool => DataType::Boolean,
        ColumnType::Text | ColumnType::Map => DataType::Utf8,
        ColumnType::Ints => list(DataType::Int32),
        ColumnType::Texts => list(DataType::Utf8),
    }
}

/// The rows of a table as one record batch.
pub fn batch(table: &Table) -> RecordBatch {
    batch_of(table, 0..table.len(), &all_columns(table.kind))
}

/// Some columns of some rows as one record batch.
pub fn batch_of(table: &Table, rows: Range<usize>, columns: &[usize]) -> RecordBatch {
    let mut making: Vec<Box<dyn ArrayInMaking>> =
        columns.iter().map(|&column| in_making(table.kind, column, rows.len())).collect();
    let has_compact_value: Vec<bool> = columns.iter().map(|&column| table.has_compact_value(column)).collect();
    table.each_chunk(rows, |rows| {
        for (array, has_compact_value) in making.iter_mut().zip(&has_compact_value) {
            match rows {
                RowChunk::Whole(rows) => array.take(rows),
                RowChunk::Compact(exchanges) if *has_compact_value => array.take_exchanges(exchanges),
                RowChunk::Compact(exchanges) => array.take_nothing(exchanges.len()),
            }
        }
    });
    let arrays = making.into_iter().map(ArrayInMaking::finish).collect();
    RecordBatch::try_new(Arc::new(schema_of(table.kind, columns)), arrays).expect("columns are built by the schema")
}

/// An array of a column that gets its values.
trait ArrayInMaking {
    /// Appends the values of further rows.
    fn take(&mut self, rows: &[RowRef<'_>]);

    /// Appends the values of further compact exchanges.
    fn take_exchanges(&mut self, exchanges: &[ExchangeRef<'_>]);

    /// Appends so many rows without a value.
    fn take_nothing(&mut self, rows: usize);

    /// The array.
    fn finish(self: Box<Self>) -> ArrayRef;
}

struct Column<T, F>
where
    ColumnBuilder<T>: CellSink + TakeNothing + 'static,
{
    values: ColumnBuilder<T>,
    reader: ColumnReader<ColumnBuilder<T>>,
    finish: F,
}

impl<T, F: FnOnce(ColumnBuilder<T>) -> ArrayRef> ArrayInMaking for Column<T, F>
where
    ColumnBuilder<T>: CellSink + TakeNothing + 'static,
{
    fn take(&mut self, rows: &[RowRef<'_>]) {
        self.values.take(rows, &self.reader);
    }

    fn take_exchanges(&mut self, exchanges: &[ExchangeRef<'_>]) {
        self.reader.pass_exchanges(exchanges, &mut self.values);
    }

    fn take_nothing(&mut self, rows: usize) {
        self.values.take_nothing(rows);
    }

    fn finish(self: Box<Self>) -> ArrayRef {
        (self.finish)(self.values)
    }
}

/// The array of a column of this table, which will get so many rows.
fn in_making(table: TableKind, column: usize, rows: usize) -> Box<dyn ArrayInMaking> {
    fn of<T: 'static>(
        (table, column, rows): (TableKind, usize, usize),
        finish: impl FnOnce(ColumnBuilder<T>) -> ArrayRef + 'static,
    ) -> Box<dyn ArrayInMaking>
    where
        ColumnBuilder<T>: CellSink + TakeNothing + 'static,
    {
        Box::new(Column { values: ColumnBuilder::with_capacity(rows), reader: table.reader(column), finish })
    }
    let place = (table, column, rows);
    match table.columns()[column].kind {
        kind @ (ColumnType::Int | ColumnType::Time) => of(place, move |values| integer_array(values, kind)),
        ColumnType::Us | ColumnType::Float => of(place, float_array),
        ColumnType::Bool => of(place, bool_array),
        ColumnType::Text | ColumnType::Map => of(place, text_array),
        ColumnType::Ints => of(place, int_list_array),
        ColumnType::Texts => of(place, text_list_array),
    }
}

fn integer_array(column: ColumnBuilder<i64>, kind: ColumnType) -> ArrayRef {
    let ColumnBuilder { items: values, mut nulls, .. } = column;
    if kind == ColumnType::Time {
        Arc::new(TimestampNanosecondArray::new(values.into(), nulls.finish()).with_timezone("UTC"))
    } else {
        Arc::new(Int64Array::new(values.into(), nulls.finish()))
    }
}

fn float_array(column: ColumnBuilder<f64>) -> ArrayRef {
    let ColumnBuilder { items: values, mut nulls, .. } = column;
    Arc::new(Float64Array::new(values.into(), nulls.finish()))
}

fn bool_array(column: ColumnBuilder<bool>) -> ArrayRef {
    let ColumnBuilder { items: values, mut nulls, .. } = column;
    Arc::new(BooleanArray::new(values.into(), nulls.finish()))
}

/// The texts are already stored one after the other, so they are not copied.
fn text_array(column: ColumnBuilder<u8>) -> ArrayRef {
    let ColumnBuilder { items: values, mut nulls, offsets } = column;
    Arc::new(StringArray::new(OffsetBuffer::new(offsets.into()), Buffer::from_vec(values), nulls.finish()))
}

fn int_list_array(column: ColumnBuilder<i32>) -> ArrayRef {
    let ColumnBuilder { items: values, mut nulls, offsets } = column;
    let item = Arc::new(Field::new("item", DataType::Int32, true));
    let values = Arc::new(Int32Array::from(values));
    Arc::new(ListArray::new(item, OffsetBuffer::new(offsets.into()), values, nulls.finish()))
}

fn text_list_array(column: ColumnBuilder<&'static str>) -> ArrayRef {
    let ColumnBuilder { items: values, mut nulls, offsets } = column;
    let item = Arc::new(Field::new("item", DataType::Utf8, true));
    let values = Arc::new(StringArray::from(values));
    Arc::new(ListArray::new(item, OffsetBuffer::new(offsets.into()), values, nulls.finish()))
}
