//! What makes lines of rows, as Python sees it.

use modlens_tables::columns::TableKind;
use pyo3::prelude::*;

use crate::arguments::value_error;
use crate::lines::{Encoder, Pieces};
use crate::table::Table;

/// Makes lines of rows of a table, batch by batch.
#[pyclass(frozen, module = "_modlens")]
pub struct LineEncoder {
    core: Encoder,
}

#[pymethods]
impl LineEncoder {
    #[new]
    fn new(format: &str, table: &str, columns: Vec<String>) -> PyResult<Self> {
        let kind = TableKind::from_name(table).ok_or_else(|| value_error(format!("no table {table:?}")))?;
        Ok(Self { core: Encoder::new(format, kind, &columns)? })
    }

    #[pyo3(signature = (table, *, header=false))]
    fn pieces(&self, table: &Table, header: bool) -> PyResult<Pieces> {
        if table.core.kind != self.core.kind {
            return Err(value_error(format!("lines of {} got {}", self.core.kind.name(), table.core.kind.name())));
        }
        Ok(self.core.pieces(&table.core, header))
    }
}
