//! Readers that another thread uses while the session decides what they have read.

use modlens_engine::session::{BorrowedReader, ReadBlock as Core};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;

/// The reader of a recording, lent by its session.
#[pyclass(module = "_modlens")]
pub struct Reader {
    /// `None` once it was given back.
    lent: Option<BorrowedReader>,
}

impl Reader {
    pub fn new(lent: BorrowedReader) -> Self {
        Self { lent: Some(lent) }
    }

    /// The reader of the core, which cannot be used from here any more.
    pub fn give_back(&mut self) -> Option<BorrowedReader> {
        self.lent.take()
    }
}

#[pymethods]
impl Reader {
    /// Several blocks at once, because each call has to get the lock of the interpreter back.
    fn read(&mut self, py: Python<'_>, blocks: Vec<PyBackedBytes>) -> PyResult<Vec<ReadBlock>> {
        let lent = self.lent.as_mut().ok_or_else(|| PyValueError::new_err("the session has taken its reader back"))?;
        Ok(py.detach(|| blocks.iter().map(|block| ReadBlock { core: lent.read(block) }).collect()))
    }
}

/// What a reader has found in one block of a recording.
#[pyclass(frozen, module = "_modlens")]
pub struct ReadBlock {
    pub(crate) core: Core,
}
