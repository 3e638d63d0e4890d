//! Writes captures of decoded frames.

use modlens_writers::capture::{Capture as Core, CaptureOptions, Encapsulation};
use modlens_writers::BLOCK_BYTES;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::value_error;
use crate::batch::Batch;
use crate::lines::as_bytes;
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
