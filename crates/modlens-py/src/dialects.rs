//! The table of dialects.

use std::sync::Arc;

use modlens_readers::chunk::Side;
use modlens_readers::text::{detect, Dialects as Core, Reader};
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::arguments::{hex, value_error};

/// A byte string of a log: line number, who sent it, when, the bytes.
type Found = (u64, Option<&'static str>, Option<i64>, Vec<u8>);

/// One that is not delivered: line number, the bytes, why.
type LeftOut = (u64, Vec<u8>, &'static str);

fn side(side: Option<Side>) -> &'static str {
    match side {
        Some(Side::Sent) => "sent",
        Some(Side::Received) => "received",
        None => "either",
    }
}

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
        changed.load(text, origin).map_err(value_error)?;
        *core = changed;
        Ok(())
    }

    fn rows(&self) -> String {
        let row = |row: &modlens_readers::text::Dialect| {
            let bytes: Vec<(&str, String)> = row.bytes.iter().map(|(who, bytes)| (side(*who), hex(bytes))).collect();
            json!({
                "name": row.name, "title": row.title, "clock": row.clock, "sample": row.sample.trim_matches('\n'), "bytes": bytes,
                "generic": row.generic, "checksum": !row.no_checksum,
            })
        };
        self.core.rows().map(|one| row(one)).collect::<Json>().to_string()
    }

    fn read(&self, format: &str, text: &[u8]) -> PyResult<(Vec<Found>, Vec<LeftOut>, u64)> {
        let mut reader = Reader::new(self.core.named(format).map_err(value_error)?, None, Arc::default());
        reader.look_ahead(text);
        reader.push(text);
        let mut found = Vec::new();
        while let Some((record, bytes)) = reader.next(true) {
            found.push((record.number, record.side.map(|who| side(Some(who))), record.time, bytes.to_vec()));
        }
        let left_out = reader.skipped().iter().map(|(line, bytes, reason)| (*line, bytes.clone(), *reason)).collect();
        Ok((found, left_out, reader.unparsed))
    }

    fn detect(&self, sample: &[u8], name: &str) -> Vec<detect::FormatGuess> {
        detect::detect(sample, name, &self.core)
    }
}
