//! Security rules, usage, and comparison.

use std::sync::Arc;

use modlens_watch::compare::compare;
use modlens_watch::rules::Rules;
use modlens_watch::usage::Usage;
use modlens_watch::usual::Usual;
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::arguments::value_error;
use crate::batch::Batch;

fn parsed(text: &str) -> PyResult<Json> {
    serde_json::from_str(text).map_err(|error| value_error(error.to_string()))
}

/// Who does what on the buses.
#[pyclass(module = "_modlens")]
pub struct Watch {
    rules: Rules,
    usage: Usage,
}

#[pymethods]
impl Watch {
    #[new]
    #[pyo3(signature = (rules="[]"))]
    fn new(rules: &str) -> PyResult<Self> {
        Ok(Self { rules: Rules::new(&parsed(rules)?).map_err(value_error)?, usage: Usage::default() })
    }

    fn add(&mut self, py: Python<'_>, batch: &Batch) {
        let core = Arc::clone(&batch.core);
        py.detach(|| {
            self.rules.observe(&core);
            self.usage.observe(&core);
        });
    }

    fn finish(&mut self) {
        self.rules.finish();
    }

    fn alerts(&self) -> String {
        json!({"alerts": self.rules.alerts(), "not_judged": self.rules.not_judged()}).to_string()
    }

    fn usage(&self) -> String {
        self.usage.json().to_string()
    }

    #[pyo3(signature = (usual, *, values=false))]
    fn compare(&self, usual: &str, values: bool) -> PyResult<String> {
        let usual = Usual::new(&parsed(usual)?).map_err(value_error)?;
        Ok(compare(&usual, &self.usage, values).to_string())
    }
}
