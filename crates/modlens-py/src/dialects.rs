//! The table of dialects, by which recordings in text are read.

use std::sync::Arc;

use modlens_readers::chunk::Side;
use modlens_readers::text::{detect, Dialects as Core, Reader};
use modlens_recording::format;
use pyo3::exceptions::PyLookupError;
use pyo3::prelude::*;
use serde_json::{json, Value as Json};

use crate::arguments::{hex, value_error};

/// Bytes read from a log: line number, sender, time in ns, the bytes.
type EntryTuple = (u64, Option<&'static str>, Option<i64>, Vec<u8>);

/// Bytes that were not delivered: line number, the bytes, the reason.
type SkippedTuple = (u64, Vec<u8>, &'static str);

/// The word by which Python knows a sender.
fn side_name(side_name: Option<Side>) -> &'static str {
    match side_name {
        Some(Side::Sent) => "sent",
        Some(Side::Received) => "received",
        None => "either",
    }
}

/// The embedded dialects and those that users have added.
#[pyclass(module = "_modlens")]
pub struct Dialects {
    /// None, as long as these are the embedded ones, which are read from their table when somebody needs them.
    changed: Option<Core>,
}

impl Dialects {
    /// The table.
    pub(crate) fn core(&self) -> &Core {
        self.changed.as_ref().unwrap_or_else(|| Core::embedded())
    }
}

#[pymethods]
impl Dialects {
    #[new]
    fn new() -> Self {
        Self { changed: None }
    }

    fn load(&mut self, text: &str, origin: &str) -> PyResult<()> {
        let mut changed = self.core().clone();
        changed.load(text, origin).map_err(value_error)?;
        self.changed = Some(changed);
        Ok(())
    }

    fn rows(&self) -> String {
        let row = |row: &modlens_readers::text::Dialect| {
            let bytes: Vec<(&str, String)> = row.bytes.iter().map(|(who, bytes)| (side_name(*who), hex(bytes))).collect();
            json!({
                "name": row.name, "title": row.title, "clock": row.clock, "sample": row.sample.trim_matches('\n'), "bytes": bytes,
                "generic": row.generic, "checksum": !row.no_checksum,
            })
        };
        self.core().rows().map(|one| row(one)).collect::<Json>().to_string()
    }

    fn read(&self, format: &str, text: &[u8]) -> PyResult<(Vec<EntryTuple>, Vec<SkippedTuple>, u64)> {
        let mut reader = Reader::new(self.core().named(format).map_err(value_error)?, None, Arc::default());
        reader.look_ahead(text);
        reader.push(text);
        let mut found = Vec::new();
        while let Some((record, bytes)) = reader.next(true) {
            found.push((record.number, record.side.map(|who| side_name(Some(who))), record.time, bytes.to_vec()));
        }
        let left_out = reader.skipped().iter().map(|(line, bytes, reason)| (*line, bytes.clone(), *reason)).collect();
        Ok((found, left_out, reader.unread_lines().count))
    }

    fn detect(&self, py: Python<'_>, sample: &[u8], name: &str) -> Vec<detect::FormatGuess> {
        py.detach(|| detect::detect(sample, name, || self.core()))
    }

    /// The format that is chosen: its name, the confidence, the reason. `LookupError` with the name of a format that does not
    /// exist, `ValueError` where the recording does not fit.
    #[pyo3(signature = (sample, name, forced=None))]
    fn decide(&self, py: Python<'_>, sample: &[u8], name: &str, forced: Option<&str>) -> PyResult<detect::FormatGuess> {
        let decided = py.detach(|| format::decide(sample, name, forced, || self.core()));
        let found = decided.map_err(|refusal| match refusal {
            format::Refusal::NoSuchFormat(part) => PyLookupError::new_err(part),
            format::Refusal::Unfit(why) => value_error(why),
        })?;
        Ok((found.format, found.confidence, found.reason))
    }
}
