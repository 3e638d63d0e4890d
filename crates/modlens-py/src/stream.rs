//! Arrow C streams over an iterator of tables.

use std::sync::Arc;

use arrow_array::{RecordBatch, RecordBatchReader};
use modlens_arrow::batch::{all_columns, batch_of, schema_of};
use modlens_tables::columns::TableKind;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::arguments::value_error;
use crate::capsule::stream_capsule;
use crate::table::{column_indices, Table};

/// Reads record batches from a Python iterator of tables.
struct TableReader {
    kind: TableKind,
    columns: Vec<usize>,
    tables: Py<PyAny>,
}

impl Iterator for TableReader {
    type Item = Result<RecordBatch, arrow_schema::ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        Python::attach(|py| {
            let found = next_table(self.tables.bind(py), self.kind, &self.columns);
            found.map_err(|error| arrow_schema::ArrowError::ExternalError(Box::new(error))).transpose()
        })
    }
}

/// The columns of the iterator's next table; none at its end.
fn next_table(iterator: &Bound<'_, PyAny>, kind: TableKind, columns: &[usize]) -> PyResult<Option<RecordBatch>> {
    let Some(item) = iterator.try_iter()?.next() else { return Ok(None) };
    let item = item?;
    let table = item.cast::<Table>()?.get();
    if table.core.kind != kind {
        return Err(value_error(format!("a stream of {} got {}", kind.name(), table.core.kind.name())));
    }
    let core = &table.core;
    Ok(Some(iterator.py().detach(|| batch_of(core, 0..core.len(), columns))))
}

impl RecordBatchReader for TableReader {
    fn schema(&self) -> arrow_schema::SchemaRef {
        Arc::new(schema_of(self.kind, &self.columns))
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
        stream_capsule(py, TableReader { kind: self.kind, columns: self.columns.clone(), tables: self.tables.clone_ref(py) })
    }
}
