//! The search for line settings, and what words on a command line mean.

use modlens_engine::line_search::{self, LineSearch as Search, SearchOptions, SearchRead};
use modlens_protocol::line::LineSettings;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::{line_settings, SettingsTuple};
use crate::session::line_number;

/// A read as it was reported: port, bytes, time in ns, positions of marked bytes, whether bytes were lost before, whether the
/// recorder has it.
type ReadTuple<'py> = (usize, Bound<'py, PyBytes>, i64, Vec<u32>, bool, bool);
/// Settings, framing, evidence in words, and the reads made with them.
type FoundTuple<'py> = (String, &'static str, String, Vec<ReadTuple<'py>>);

/// Finds the settings of a line by listening.
#[pyclass(module = "_modlens")]
pub struct LineSearch {
    core: Search,
}

#[pymethods]
impl LineSearch {
    #[new]
    #[pyo3(signature = (*, marks_errors=true))]
    fn new(marks_errors: bool) -> Self {
        Self { core: Search::new(SearchOptions { marks_errors, ..SearchOptions::default() }) }
    }

    fn line(&self) -> String {
        self.core.line().to_string()
    }

    fn line_was_set(&mut self, now_ns: i64) {
        self.core.line_was_set(now_ns);
    }

    #[allow(clippy::too_many_arguments)] // The keywords of one Python call.
    #[pyo3(signature = (port, data, time_ns, *, line=None, errors=None, hole=false, recorded=false))]
    fn feed(
        &mut self,
        port: usize,
        data: &[u8],
        time_ns: i64,
        line: Option<&str>,
        errors: Option<Vec<u32>>,
        hole: bool,
        recorded: bool,
    ) -> PyResult<()> {
        let (line, errors) = (line_number(line)?, errors.unwrap_or_default());
        let bytes = data.to_vec();
        self.core.feed(SearchRead { port, line, time: time_ns, bytes, errors, follows_loss: hole, is_recorded: recorded });
        Ok(())
    }

    fn advance(&mut self, now_ns: i64) {
        self.core.advance(now_ns);
    }

    fn found<'py>(&self, py: Python<'py>) -> Option<FoundTuple<'py>> {
        let found = self.core.found()?;
        let reads = found.reads.iter().map(|read| read_tuple(py, read)).collect();
        Some((found.line.to_string(), found.mode.text(), found.evidence.clone(), reads))
    }

    fn heard<'py>(&self, py: Python<'py>) -> Vec<(String, ReadTuple<'py>)> {
        self.core.heard().map(|(line, read)| (line.to_string(), read_tuple(py, read))).collect()
    }

    fn take_messages(&mut self) -> Vec<String> {
        self.core.take_messages()
    }

    fn diagnosis(&self) -> String {
        self.core.diagnosis()
    }
}

fn read_tuple<'py>(py: Python<'py>, read: &SearchRead) -> ReadTuple<'py> {
    (read.port, PyBytes::new(py, &read.bytes), read.time, read.errors.clone(), read.follows_loss, read.is_recorded)
}

/// The rates that are searched, and how usual each is.
#[pyfunction]
pub fn usual_rates() -> Vec<(u32, f64)> {
    line_search::RATES.to_vec()
}

/// The rates that bytes received at another one look like, the most likely first.
#[pyfunction]
pub fn likely_rates(data: &[u8], receiver: u32) -> Vec<u32> {
    line_search::likely_rates(data, receiver)
}

/// Whether reads of a recording are Modbus at these settings: the framing, and the evidence in words.
#[pyfunction]
pub fn proof_in(py: Python<'_>, reads: Vec<(Vec<u8>, Option<i64>)>, line: SettingsTuple) -> PyResult<Option<(String, String)>> {
    let line: LineSettings = line_settings(line)?;
    let found = py.detach(|| line_search::proof_in(&reads, line));
    Ok(found.map(|(mode, proof)| (mode.text().to_owned(), proof)))
}
