//! The server of a tap, which a thread of the recorder's crate runs.

use std::sync::{Mutex, MutexGuard, PoisonError};

use modlens_recorder::{Feed, Server as Core, ServerOptions};
use pyo3::prelude::*;

use crate::arguments::value_error;

/// Serves the reads of a live run.
#[pyclass(frozen, module = "_modlens")]
pub struct Server {
    core: Mutex<Core>,
}

#[pymethods]
impl Server {
    #[new]
    #[pyo3(signature = (place, *, token=None, memory=None, page=None))]
    fn new(place: &str, token: Option<String>, memory: Option<usize>, page: Option<&[u8]>) -> PyResult<Self> {
        let options = match page {
            None => ServerOptions::parse(place, token),
            Some(page) => ServerOptions::with_page(place, token, page.into()),
        };
        let mut options = options.map_err(value_error)?;
        options.memory = memory.unwrap_or(options.memory);
        Ok(Self { core: Mutex::new(Core::start(options)?) })
    }

    #[getter]
    fn address(&self) -> String {
        self.core().address().to_string()
    }

    #[getter]
    fn url(&self) -> String {
        self.core().url()
    }

    fn take_messages(&self) -> Vec<String> {
        self.core().take_messages()
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.core().close());
    }
}

impl Server {
    /// Where reads go that are served.
    pub(crate) fn feed(&self) -> Feed {
        self.core().feed()
    }

    fn core(&self) -> MutexGuard<'_, Core> {
        self.core.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
