//! The doctor by bus and day.

use modlens_diagnosis::days::Days as Core;
use pyo3::prelude::*;

use crate::batch::Batch;

/// What the doctor says of each bus and day.
#[pyclass(module = "_modlens")]
pub struct Days {
    core: Core,
}

#[pymethods]
impl Days {
    #[new]
    #[pyo3(signature = (kept=None))]
    fn new(kept: Option<usize>) -> Self {
        Self { core: Core::new(kept) }
    }

    fn add(&mut self, py: Python<'_>, batch: &Batch) {
        py.detach(|| self.core.observe(&batch.core));
    }

    fn rows(&self, py: Python<'_>) -> String {
        serde_json::Value::from(py.detach(|| self.core.rows())).to_string()
    }
}
