//! The table of functions, by which PDUs are decoded and encoded.

use std::sync::{Arc, OnceLock};

use modlens_protocol::functions::Functions as Core;
use modlens_protocol::pdu;
use pyo3::prelude::*;
use serde_json::Value as Json;

use crate::arguments::{change_if_valid, value_error};

/// The embedded functions and those that users have added.
#[pyclass(module = "_modlens")]
pub struct Functions {
    pub(crate) core: Arc<Core>,
    /// All rows as JSON, made when somebody asks: reports ask for each of their examples.
    rows: OnceLock<String>,
}

#[pymethods]
impl Functions {
    #[new]
    fn new() -> Self {
        Self { core: Arc::new(Core::default()), rows: OnceLock::new() }
    }

    fn load(&mut self, text: &str, origin: &str) -> PyResult<()> {
        self.rows = OnceLock::new();
        change_if_valid(&mut self.core, |functions| functions.load(text, origin, None))
    }

    fn load_vendor(&mut self, name: &str) -> PyResult<()> {
        self.rows = OnceLock::new();
        Arc::make_mut(&mut self.core).load_vendor(name).map_err(value_error)
    }

    fn rows(&self) -> &str {
        self.rows.get_or_init(|| self.core.rows().map(|row| row.source.clone()).collect::<Json>().to_string())
    }

    fn decode(&self, pdu: &[u8], direction: &str) -> PyResult<String> {
        Ok(pdu::describe(&self.core, pdu, is_response(direction)?).to_string())
    }

    fn encode(&self, function: u8, direction: &str, values: &str) -> PyResult<Vec<u8>> {
        let values: Json = serde_json::from_str(values).map_err(|e| value_error(e.to_string()))?;
        let values = values.as_object().ok_or_else(|| value_error("values must be a JSON object".into()))?;
        pdu::encode(&self.core, function, is_response(direction)?, values).map_err(value_error)
    }
}

/// Whether a direction is that of responses.
fn is_response(direction: &str) -> PyResult<bool> {
    match direction {
        "request" => Ok(false),
        "response" => Ok(true),
        other => Err(value_error(format!("direction {other:?} is neither request nor response"))),
    }
}
