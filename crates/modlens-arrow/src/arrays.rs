//! The values of a column as an array.

use std::sync::{Arc, OnceLock};

use arrow_array::{
    ArrayRef, BooleanArray, Float64Array, Int32Array, Int64Array, ListArray, StringArray, TimestampNanosecondArray,
};
use arrow_buffer::{ArrowNativeType, BooleanBuffer, Buffer, NullBuffer, OffsetBuffer, ScalarBuffer};
use arrow_schema::{DataType, Field};

use crate::values::{ColumnBuilder, Item};

/// Of so many rows the vectors of a column without a value are the same memory for all columns and batches.
const ROWS_OF_NOTHING: usize = 1 << 14;

/// So many bytes that are 0.
fn zeros(bytes: usize) -> Buffer {
    static SHARED: OnceLock<Buffer> = OnceLock::new();
    let shared = SHARED.get_or_init(|| Buffer::from_vec(vec![0u64; ROWS_OF_NOTHING]));
    if bytes <= shared.len() {
        shared.slice_with_length(0, bytes)
    } else {
        Buffer::from_vec(vec![0u64; bytes.div_ceil(8)])
    }
}

/// Which of so many rows have a value: none.
fn no_values(rows: usize) -> Option<NullBuffer> {
    (rows > 0).then(|| NullBuffer::new(BooleanBuffer::new(zeros(rows.div_ceil(8)), 0, rows)))
}

/// One value a row, and which rows have one.
fn values<T: Item + ArrowNativeType>(mut column: ColumnBuilder<T>) -> (ScalarBuffer<T>, Option<NullBuffer>) {
    if let Some(rows) = column.rows_of_nothing() {
        return (ScalarBuffer::new(zeros(rows * size_of::<T>()), 0, rows), no_values(rows));
    }
    column.add_nothing();
    (column.items.into(), column.validity.finish())
}

/// Where the items of each row end, and which rows have a value.
fn ends<T: Item>(column: &mut ColumnBuilder<T>) -> (OffsetBuffer<i32>, Option<NullBuffer>) {
    if let Some(rows) = column.rows_of_nothing() {
        return (OffsetBuffer::new(ScalarBuffer::new(zeros((rows + 1) * 4), 0, rows + 1)), no_values(rows));
    }
    column.add_nothing();
    (OffsetBuffer::new(std::mem::take(&mut column.offsets).into()), column.validity.finish())
}

pub(super) fn int_array(column: ColumnBuilder<i64>) -> ArrayRef {
    let (values, nulls) = values(column);
    Arc::new(Int64Array::new(values, nulls))
}

pub(super) fn time_array(column: ColumnBuilder<i64>) -> ArrayRef {
    let (values, nulls) = values(column);
    Arc::new(TimestampNanosecondArray::new(values, nulls).with_timezone("UTC"))
}

pub(super) fn float_array(column: ColumnBuilder<f64>) -> ArrayRef {
    let (values, nulls) = values(column);
    Arc::new(Float64Array::new(values, nulls))
}

pub(super) fn bool_array(mut column: ColumnBuilder<bool>) -> ArrayRef {
    column.add_nothing();
    Arc::new(BooleanArray::new(column.items.into(), column.validity.finish()))
}

/// The texts are already stored one after the other, so they are not copied.
pub(super) fn text_array(mut column: ColumnBuilder<u8>) -> ArrayRef {
    let (ends, nulls) = ends(&mut column);
    Arc::new(StringArray::new(ends, Buffer::from_vec(column.items), nulls))
}

pub(super) fn int_list_array(mut column: ColumnBuilder<i32>) -> ArrayRef {
    let (ends, nulls) = ends(&mut column);
    let item = Arc::new(Field::new("item", DataType::Int32, true));
    Arc::new(ListArray::new(item, ends, Arc::new(Int32Array::from(column.items)), nulls))
}

pub(super) fn text_list_array(mut column: ColumnBuilder<&'static str>) -> ArrayRef {
    let (ends, nulls) = ends(&mut column);
    let item = Arc::new(Field::new("item", DataType::Utf8, true));
    Arc::new(ListArray::new(item, ends, Arc::new(StringArray::from(column.items)), nulls))
}
