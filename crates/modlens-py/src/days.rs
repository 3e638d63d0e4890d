//! The doctor by bus and day.

use modlens_diagnosis::bus_day;
use modlens_diagnosis::days::Days as Core;
use pyo3::prelude::*;

use crate::arguments::value_error;
use crate::batch::Batch;

/// What the doctor reports about each bus and day.
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

    fn changed(&mut self, py: Python<'_>) -> Vec<(String, String)> {
        py.detach(|| self.core.changed())
    }
}

/// The columns of the flat row of a bus and day, with their meaning.
#[pyfunction]
pub fn bus_day_columns() -> Vec<(&'static str, &'static str)> {
    bus_day::COLUMNS.to_vec()
}

/// The flat row of a bus and day, from an item of `Days.rows`, both as JSON.
#[pyfunction]
pub fn bus_day_row(day: &str) -> PyResult<String> {
    let day = serde_json::from_str(day).map_err(|error| value_error(error.to_string()))?;
    Ok(bus_day::bus_day(&day).to_string())
}
