//! Writes Parquet and Arrow files.

use std::sync::{Mutex, PoisonError};

use modlens_arrow::files::RowFile as Core;
use modlens_tables::columns::TableKind;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::value_error;
use crate::lines::as_bytes;
use crate::table::Table;

/// A Parquet or Arrow file of rows of one table.
#[pyclass(frozen, module = "_modlens")]
pub struct RowFile {
    kind: TableKind,
    /// The writers of arrow-rs are not `Sync`, as Python demands of its objects, so a lock guards them.
    core: Mutex<Core>,
}

/// The error of a writer, which is a fault of the program.
fn runtime_error(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

#[pymethods]
impl RowFile {
    #[new]
    fn new(format: &str, table: &str, columns: Vec<String>) -> PyResult<Self> {
        let kind = TableKind::from_name(table).ok_or_else(|| value_error(format!("no table {table:?}")))?;
        let columns = columns.iter().map(|key| kind.column(key)).collect::<Result<_, _>>().map_err(value_error)?;
        let version = env!("CARGO_PKG_VERSION");
        let core = match format {
            "arrow" => Core::arrow(kind, columns, version),
            "parquet" => Core::parquet(kind, columns, version),
            other => return Err(value_error(format!("format {other:?} is neither arrow nor parquet"))),
        };
        Ok(Self { kind, core: Mutex::new(core.map_err(runtime_error)?) })
    }

    fn rows<'py>(&self, py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyBytes>> {
        if table.core.kind != self.kind {
            return Err(value_error(format!("a file of {} got {}", self.kind.name(), table.core.kind.name())));
        }
        let mut done = Ok(());
        let bytes = as_bytes(py, |out| done = self.core.lock().unwrap_or_else(PoisonError::into_inner).rows(&table.core, out));
        done.map(|()| bytes).map_err(runtime_error)
    }

    fn end<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut out = Vec::new();
        py.detach(|| self.core.lock().unwrap_or_else(PoisonError::into_inner).end(&mut out)).map_err(runtime_error)?;
        Ok(PyBytes::new(py, &out))
    }
}
