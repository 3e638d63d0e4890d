//! Arrow C streams over an iterator of tables.

use arrow_array::{RecordBatch, RecordBatchReader};
use modlens_arrow::batch::{all_columns, BatchBuilder};
use modlens_tables::columns::{Table as Core, TableKind};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::arguments::value_error;
use crate::capsule::stream_capsule;
use crate::table::{column_indices, Table};

/// A batch has at least so many rows, if there are and `BATCH_BYTES` allow it: to hand one over costs as much as making a thousand
/// rows.
const BATCH_ROWS: usize = 2048;

/// A batch with more bytes ends within a table. More would not stay in the processor's cache until somebody reads them.
const BATCH_BYTES: usize = 1 << 19;

/// Reads record batches from a Python iterator of tables.
struct TableReader {
    kind: TableKind,
    batches: BatchBuilder,
    tables: Py<PyAny>,
    /// A table of which some rows have no batch yet, and the first of them.
    begun: Option<(Core, usize)>,
    /// What went wrong after the rows of the last batch.
    error: Option<PyErr>,
}

impl Iterator for TableReader {
    type Item = Result<RecordBatch, arrow_schema::ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        Python::attach(|py| {
            let found = self.next_batch(py);
            found.map_err(|error| arrow_schema::ArrowError::ExternalError(Box::new(error))).transpose()
        })
    }
}

impl TableReader {
    /// The columns of the iterator's next tables; none at its end. Rows in front of an error come first.
    fn next_batch(&mut self, py: Python<'_>) -> PyResult<Option<RecordBatch>> {
        if let Some(error) = self.error.take() {
            return Err(error);
        }
        if let Err(error) = self.add_tables(py) {
            if self.batches.rows() == 0 {
                return Err(error);
            }
            self.error = Some(error);
        }
        Ok((self.batches.rows() > 0).then(|| self.batches.finish()))
    }

    /// Adds tables until the batch has enough rows or bytes, or there are none left.
    fn add_tables(&mut self, py: Python<'_>) -> PyResult<()> {
        let mut tables = self.tables.bind(py).try_iter()?;
        while self.batches.rows() < BATCH_ROWS && self.batches.bytes() < BATCH_BYTES {
            let (table, next) = match self.begun.take() {
                Some(begun) => begun,
                None => match tables.next() {
                    Some(item) => (self.core(&item?)?, 0),
                    None => break,
                },
            };
            let batches = &mut self.batches;
            let end = py.detach(|| add_rows(batches, &table, next));
            self.begun = (end < table.len()).then_some((table, end));
        }
        Ok(())
    }

    /// The table that the iterator gave.
    fn core(&self, item: &Bound<'_, PyAny>) -> PyResult<Core> {
        let table = &item.cast::<Table>()?.get().core;
        if table.kind != self.kind {
            return Err(value_error(format!("a stream of {} got {}", self.kind.name(), table.kind.name())));
        }
        Ok(table.clone())
    }
}

/// Adds rows from this one on until the batch has as many bytes as it should; gives the first that is left.
fn add_rows(batches: &mut BatchBuilder, table: &Core, mut next: usize) -> usize {
    while next < table.len() && batches.bytes() < BATCH_BYTES {
        let end = table.len().min(next + BATCH_ROWS);
        batches.add(table, next..end);
        next = end;
    }
    next
}

impl RecordBatchReader for TableReader {
    fn schema(&self) -> arrow_schema::SchemaRef {
        self.batches.schema()
    }
}

/// A lazy Arrow stream over an iterator of tables.
#[pyclass(frozen, module = "_modlens")]
pub struct ArrowStream {
    kind: TableKind,
    columns: Vec<usize>,
    tables: Py<PyAny>,
}

#[pymethods]
impl ArrowStream {
    #[new]
    #[pyo3(signature = (name, tables, columns=None))]
    fn new(name: &str, tables: Py<PyAny>, columns: Option<Vec<String>>) -> PyResult<Self> {
        let kind = TableKind::from_name(name).ok_or_else(|| value_error(format!("no table {name:?}")))?;
        let columns = columns.map_or_else(|| Ok(all_columns(kind)), |keys| column_indices(kind, &keys))?;
        Ok(Self { kind, columns, tables })
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        let batches = BatchBuilder::new(self.kind, &self.columns);
        stream_capsule(py, TableReader { kind: self.kind, batches, tables: self.tables.clone_ref(py), begun: None, error: None })
    }
}
