//! Arrow C streams.

use std::sync::Arc;

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{RecordBatch, RecordBatchReader};
use modlens_tables::columns::TableKind;
use modlens_writers::arrow::{batch, schema};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::table::Table;
use crate::wrong;

/// Where a stream's batches come from.
pub enum Batches {
    /// One that is there.
    One(Option<RecordBatch>),
    /// An iterator of tables.
    Iterator(Py<PyAny>),
}

struct Reader {
    kind: TableKind,
    batches: Batches,
}

impl Iterator for Reader {
    type Item = Result<RecordBatch, arrow_schema::ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.batches {
            Batches::One(one) => one.take().map(Ok),
            Batches::Iterator(iterator) => Python::attach(|py| {
                let found = next_table(iterator.bind(py), self.kind);
                found.map_err(|error| arrow_schema::ArrowError::ExternalError(Box::new(error))).transpose()
            }),
        }
    }
}

fn next_table(iterator: &Bound<'_, PyAny>, kind: TableKind) -> PyResult<Option<RecordBatch>> {
    let Some(item) = iterator.try_iter()?.next() else { return Ok(None) };
    let item = item?;
    let table = item.cast::<Table>()?.get();
    if table.core.kind != kind {
        return Err(wrong(format!("a stream of {} got {}", kind.name(), table.core.kind.name())));
    }
    Ok(Some(batch(&table.core)))
}

impl RecordBatchReader for Reader {
    fn schema(&self) -> arrow_schema::SchemaRef {
        Arc::new(schema(self.kind))
    }
}

/// A capsule with a stream of these batches.
pub fn stream_capsule(py: Python<'_>, kind: TableKind, batches: Batches) -> PyResult<Bound<'_, PyCapsule>> {
    let stream = FFI_ArrowArrayStream::new(Box::new(Reader { kind, batches }));
    PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
}

/// A lazy Arrow stream over an iterator of tables.
#[pyclass(frozen, module = "_modlens")]
pub struct ArrowStream {
    kind: TableKind,
    tables: Py<PyAny>,
}

#[pymethods]
impl ArrowStream {
    #[new]
    fn new(name: &str, tables: Py<PyAny>) -> PyResult<Self> {
        let kind = TableKind::from_name(name).ok_or_else(|| wrong(format!("no table {name:?}")))?;
        Ok(Self { kind, tables })
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        stream_capsule(py, self.kind, Batches::Iterator(self.tables.clone_ref(py)))
    }
}
