//! The array of a column that gets its values.

use arrow_array::ArrayRef;

use crate::arrays::{bool_array, float_array, int_array, int_list_array, text_array, text_list_array, time_array};
use crate::column_values::{ColumnItem, ColumnValues, HasRows, TakeRows};
use crate::given::GivenItems;
use crate::values::ColumnBuilder;
use modlens_tables::columns::{CellSink, ColumnType, TableKind};

/// An array of a column that gets its values.
pub(super) trait ArrayInMaking: HasRows + Send {
    /// The bytes of the values of all rows so far.
    fn bytes(&self) -> usize;

    /// The array of all rows so far; the next one begins.
    fn finish(&mut self) -> ArrayRef;
}

struct Column<T> {
    rows: ColumnValues<T>,
    given: GivenItems,
    array: fn(ColumnBuilder<T>) -> ArrayRef,
}

impl<T: ColumnItem> HasRows for Column<T>
where
    ColumnBuilder<T>: CellSink,
{
    fn rows(&mut self) -> &mut dyn TakeRows {
        &mut self.rows
    }
}

impl<T: ColumnItem> ArrayInMaking for Column<T>
where
    ColumnBuilder<T>: CellSink,
{
    fn bytes(&self) -> usize {
        size_of_val(&*self.rows.values.items)
    }

    fn finish(&mut self) -> ArrayRef {
        let next = self.rows.values.next(self.given.take());
        let array = (self.array)(std::mem::replace(&mut self.rows.values, next));
        self.given.add(&array);
        array
    }
}

/// The array of a column of this table.
pub(super) fn in_making(table: TableKind, column: usize) -> Box<dyn ArrayInMaking> {
    fn of<T: ColumnItem>(rows: ColumnValues<T>, array: fn(ColumnBuilder<T>) -> ArrayRef) -> Box<dyn ArrayInMaking>
    where
        ColumnBuilder<T>: CellSink,
    {
        Box::new(Column { rows, given: GivenItems::default(), array })
    }
    match table.columns()[column].kind {
        ColumnType::Int => of(ColumnValues::new(table, column), int_array),
        ColumnType::Time => of(ColumnValues::new(table, column), time_array),
        ColumnType::Us | ColumnType::Float => of(ColumnValues::new(table, column), float_array),
        ColumnType::Bool => of(ColumnValues::new(table, column), bool_array),
        ColumnType::Text | ColumnType::Map => of(ColumnValues::new(table, column), text_array),
        ColumnType::Ints => of(ColumnValues::new(table, column), int_list_array),
        ColumnType::Texts => of(ColumnValues::new(table, column), text_list_array),
    }
}
