//! Writes captures of decoded frames, and raw recordings of the reads of a tap.

use modlens_protocol::line::LineSettings;
use modlens_writers::capture::{Capture as Core, CaptureOptions, Encapsulation};
use modlens_writers::recording;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::value_error;
use crate::batch::Batch;
use crate::lines::{as_bytes, BLOCK_BYTES};
use crate::table::Table;

/// A writer of frames as pcapng or pcap.
#[pyclass(module = "_modlens")]
pub struct Capture {
    core: Core,
}

#[pymethods]
impl Capture {
    #[new]
    #[pyo3(signature = (style="udp", *, classic=false, live=false, context=0))]
    fn new(style: &str, classic: bool, live: bool, context: usize) -> PyResult<Self> {
        let found = Encapsulation::ALL.iter().find(|(name, _)| *name == style).map(|(_, style)| *style);
        let style = found.ok_or_else(|| {
            let known: Vec<&str> = Encapsulation::ALL.iter().map(|(name, _)| *name).collect();
            value_error(format!("style {style:?} is not one of {}", known.join(", ")))
        })?;
        let application = format!("modlens {}", env!("CARGO_PKG_VERSION"));
        Ok(Self { core: Core::new(CaptureOptions { style, classic, live, context, application }) })
    }

    #[pyo3(signature = (batch, kept=None))]
    fn put(&mut self, py: Python<'_>, batch: &Batch, kept: Option<&Table>) {
        py.detach(|| self.core.add_batch(&batch.core, kept.map(|table| &table.core)));
    }

    fn more<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        as_bytes(py, |out| self.core.append_ready(BLOCK_BYTES, out))
    }

    fn end<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyBytes> {
        as_bytes(py, |out| self.core.finish(out))
    }

    #[getter]
    fn written(&self) -> u64 {
        self.core.written
    }
}

/// A port of a raw recording: name of the port, number of its bus, name of the bus, line (A or B), line settings.
type RecordedPort = (String, usize, String, Option<String>, Option<String>);

/// The beginning of a file of a raw recording, with the descriptions of its ports.
#[pyfunction]
pub fn recording_head<'py>(
    py: Python<'py>,
    session: &str,
    segment: u64,
    ports: Vec<RecordedPort>,
) -> PyResult<Bound<'py, PyBytes>> {
    let mut out = Vec::new();
    recording::head(&format!("modlens {}", env!("CARGO_PKG_VERSION")), session, segment, &mut out);
    ports.iter().try_for_each(|port| push_port(port, &mut out))?;
    Ok(PyBytes::new(py, &out))
}

/// The description of a further port for a raw recording that has begun.
#[pyfunction]
#[pyo3(signature = (port, bus, name, line=None, settings=None))]
pub fn recording_port(
    py: Python<'_>,
    port: String,
    bus: usize,
    name: String,
    line: Option<String>,
    settings: Option<String>,
) -> PyResult<Bound<'_, PyBytes>> {
    let mut out = Vec::new();
    push_port(&(port, bus, name, line, settings), &mut out)?;
    Ok(PyBytes::new(py, &out))
}

/// Appends the description of a port.
fn push_port((port, bus, name, line, settings): &RecordedPort, out: &mut Vec<u8>) -> PyResult<()> {
    let settings = settings.as_deref().map(str::parse::<LineSettings>).transpose().map_err(value_error)?;
    recording::port(port, (*bus, name), line.as_deref(), settings.as_ref(), out);
    Ok(())
}

/// The block of a raw recording for one read.
#[pyfunction]
#[pyo3(signature = (port, time_ns, data, *, errors=None, hole=false))]
pub fn recording_read<'py>(
    py: Python<'py>,
    port: u32,
    time_ns: i64,
    data: &[u8],
    errors: Option<Vec<u32>>,
    hole: bool,
) -> Bound<'py, PyBytes> {
    let mut out = Vec::with_capacity(data.len() + 64);
    let errors = errors.unwrap_or_default();
    recording::read(port, &recording::PortRead { time: time_ns, bytes: data, errors: &errors, hole }, &mut out);
    PyBytes::new(py, &out)
}
