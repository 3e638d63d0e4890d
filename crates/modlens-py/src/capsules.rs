//! Capsules of the Arrow C data interface, in which tables leave for other libraries without a copy in Python.

use std::sync::Arc;

use arrow_array::ffi::FFI_ArrowSchema;
use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{RecordBatch, RecordBatchReader};
use arrow_schema::{ArrowError, SchemaRef};
use modlens_tables::columns::TableKind;
use modlens_writers::arrow::schema;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

/// Batches of one stream, in order.
pub type Batches = Box<dyn Iterator<Item = Result<RecordBatch, ArrowError>> + Send>;

/// The batches of a table together with its schema, as Arrow's stream interface wants them.
struct Reader {
    kind: TableKind,
    batches: Batches,
}

impl Iterator for Reader {
    type Item = Result<RecordBatch, ArrowError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.batches.next()
    }
}

impl RecordBatchReader for Reader {
    fn schema(&self) -> SchemaRef {
        Arc::new(schema(self.kind))
    }
}

/// A capsule with a stream of these batches, which are rows of a table of this kind.
pub fn stream_capsule(py: Python<'_>, kind: TableKind, batches: Batches) -> PyResult<Bound<'_, PyCapsule>> {
    let stream = FFI_ArrowArrayStream::new(Box::new(Reader { kind, batches }));
    PyCapsule::new_with_value(py, stream, c"arrow_array_stream")
}

/// A capsule with the schema of a table of this kind.
pub fn schema_capsule(py: Python<'_>, kind: TableKind) -> PyResult<Bound<'_, PyCapsule>> {
    let schema = FFI_ArrowSchema::try_from(&schema(kind)).map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
    PyCapsule::new_with_value(py, schema, c"arrow_schema")
}
