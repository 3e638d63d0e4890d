//! Rows as Arrow record batches.

use std::ops::Range;
use std::sync::Arc;

use arrow_array::RecordBatch;
use arrow_schema::{DataType, Field, Schema, SchemaRef, TimeUnit};

use crate::array_in_making::{in_making, ArrayInMaking};
use crate::rows_to_columns::RowsToColumns;
use modlens_tables::columns::{ColumnType, Table, TableKind};

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
    let mut batches = BatchBuilder::new(table.kind, columns);
    batches.add(table, rows);
    batches.finish()
}

/// Makes record batches of rows, which may come from several tables of a kind.
pub struct BatchBuilder {
    schema: SchemaRef,
    arrays: Vec<Box<dyn ArrayInMaking>>,
    adding: RowsToColumns,
    rows: usize,
}

impl BatchBuilder {
    /// For some columns of a table.
    pub fn new(kind: TableKind, columns: &[usize]) -> Self {
        let arrays = columns.iter().map(|&column| in_making(kind, column)).collect();
        Self { schema: Arc::new(schema_of(kind, columns)), arrays, adding: RowsToColumns::default(), rows: 0 }
    }

    /// The schema of the batches.
    pub fn schema(&self) -> SchemaRef {
        Arc::clone(&self.schema)
    }

    /// The rows that the next batch has so far.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// The bytes of their values so far.
    pub fn bytes(&self) -> usize {
        self.arrays.iter().map(|array| array.bytes()).sum()
    }

    /// Appends rows of a table.
    pub fn add(&mut self, table: &Table, rows: Range<usize>) {
        self.rows += rows.len();
        self.adding.add(table, rows, &mut self.arrays);
    }

    /// The batch of the rows so far; the next one begins.
    pub fn finish(&mut self) -> RecordBatch {
        self.rows = 0;
        let arrays = self.arrays.iter_mut().map(|array| array.finish()).collect();
        RecordBatch::try_new(self.schema(), arrays).expect("columns are built by the schema")
    }
}
