//! Batches of decoded rows: the tables over one batch of the core.

use std::sync::{Arc, OnceLock};

use modlens_engine::records::Batch as CoreBatch;
use modlens_tables::columns::{Table as CoreTable, TableKind};
use pyo3::prelude::*;

use crate::table::{table, Table};

/// The rows that the session has decided since the last `take`.
#[pyclass(frozen, module = "_modlens")]
pub struct Batch {
    pub(crate) core: Arc<CoreBatch>,
    readings: OnceLock<CoreTable>,
}

impl Batch {
    /// A batch of Python's around one of the core.
    pub fn new(core: CoreBatch) -> Self {
        Self { core: Arc::new(core), readings: OnceLock::new() }
    }
}

#[pymethods]
impl Batch {
    #[getter]
    fn row_count(&self) -> usize {
        let core = &self.core;
        core.frames.len() + core.transaction_count() + core.findings.len() + core.connections.len() + core.diagnoses.len()
    }

    #[getter]
    fn frames(&self) -> Table {
        table(&self.core, TableKind::Frames)
    }

    #[getter]
    fn transactions(&self) -> Table {
        table(&self.core, TableKind::Transactions)
    }

    #[getter]
    fn readings(&self) -> Table {
        // The table counts its rows when it is made, which takes a pass over all transactions: it is made only once.
        let made = || CoreTable::new(Arc::clone(&self.core), TableKind::Readings);
        Table { core: self.readings.get_or_init(made).clone() }
    }

    #[getter]
    fn findings(&self) -> Table {
        table(&self.core, TableKind::Findings)
    }

    #[getter]
    fn connections(&self) -> Table {
        table(&self.core, TableKind::Connections)
    }

    #[getter]
    fn diagnoses(&self) -> Table {
        table(&self.core, TableKind::Diagnoses)
    }
}
