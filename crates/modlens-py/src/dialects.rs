//! The table of dialects.

use std::sync::Arc;

use modlens_core::chunk::Side;
use modlens_core::text::{detect, Dialects as Core};
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::session::hex;
use crate::wrong;

/// The embedded rows and further ones.
#[pyclass(module = "_modlens")]
pub struct Dialects {
    pub(crate) core: Arc<Core>,
}

#[pymethods]
impl Dialects {
    #[new]
    fn new() -> Self {
        Self { core: Arc::new(Core::default()) }
    }

    fn load(&mut self, text: &str, origin: &str) -> PyResult<()> {
        let core = Arc::make_mut(&mut self.core);
        let mut changed = core.clone();
        changed.load(text, origin).map_err(wrong)?;
        *core = changed;
        Ok(())
    }

    fn rows(&self) -> String {
        let side = |side: Option<Side>| match side {
            Some(Side::Sent) => "sent",
            Some(Side::Received) => "received",
            None => "either",
        };
        let row = |row: &modlens_core::text::Dialect| {
            let bytes: Vec<(&str, String)> = row.bytes.iter().map(|(who, bytes)| (side(*who), hex(bytes))).collect();
            json!({
                "name": row.name, "title": row.title, "clock": row.clock, "sample": row.sample.trim_matches('\n'), "bytes": bytes,
                "generic": row.generic, "checksum": !row.no_checksum,
            })
        };
        self.core.rows().map(|one| row(one)).collect::<Json>().to_string()
    }

    fn detect(&self, sample: &[u8], name: &str) -> Vec<detect::Guess> {
        detect::detect(sample, name, &self.core)
    }
}
