//! The raw recording of a tap, which a thread of the recorder's crate writes.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use modlens_pcapng::recording::PortRead;
use modlens_protocol::line::LineSettings;
use modlens_recorder::{Feed, RecordedPort, Recorder as Core, RecorderOptions, RecorderStatus, Retention, Rotation};
use pyo3::prelude::*;

use crate::arguments::value_error;

/// How a recording is going: file, trouble at the moment, trouble ever, bytes recorded, bytes lost, bytes waiting.
type StatusTuple = (String, Option<String>, bool, u64, u64, usize);

/// A raw recording that is being written.
#[pyclass(frozen, module = "_modlens")]
pub struct Recorder {
    core: Mutex<Core>,
    feed: Feed,
}

#[pymethods]
impl Recorder {
    #[new]
    #[pyo3(signature = (path, *, rotate_seconds=None, rotate_bytes=None, keep_segments=None, keep_bytes=None, memory=None))]
    fn new(
        path: &str,
        rotate_seconds: Option<u64>,
        rotate_bytes: Option<u64>,
        keep_segments: Option<usize>,
        keep_bytes: Option<u64>,
        memory: Option<usize>,
    ) -> PyResult<Self> {
        let mut options = RecorderOptions::new(path);
        options.rotation = match (rotate_seconds, rotate_bytes) {
            (Some(seconds), _) => Rotation::After(Duration::from_secs(seconds)),
            (None, Some(bytes)) => Rotation::Bytes(bytes),
            (None, None) => Rotation::Never,
        };
        options.retention = match (keep_segments, keep_bytes) {
            (Some(count), _) => Retention::Segments(count),
            (None, Some(bytes)) => Retention::Bytes(bytes),
            (None, None) => Retention::All,
        };
        options.memory = memory.unwrap_or(options.memory);
        let core = Core::start(options)?;
        Ok(Self { feed: core.feed(), core: Mutex::new(core) })
    }

    #[pyo3(signature = (name, bus, line=None, settings=None))]
    fn add_port(&self, name: String, bus: String, line: Option<String>, settings: Option<String>) -> PyResult<u32> {
        let settings = settings.as_deref().map(str::parse::<LineSettings>).transpose().map_err(value_error)?;
        Ok(self.feed.add_port(&RecordedPort { name, bus, line, settings }))
    }

    #[pyo3(signature = (port, time_ns, data, *, errors=None, hole=false))]
    fn write(&self, port: u32, time_ns: i64, data: &[u8], errors: Option<Vec<u32>>, hole: bool) {
        let errors = errors.unwrap_or_default();
        self.feed.write(port, &PortRead { time: time_ns, bytes: data, errors: &errors, hole });
    }

    fn status(&self) -> StatusTuple {
        status_tuple(self.core().status())
    }

    fn take_messages(&self) -> Vec<String> {
        self.core().take_messages()
    }

    fn flush(&self, py: Python<'_>, timeout: f64) -> bool {
        py.detach(|| self.core().flush(Duration::from_secs_f64(timeout.clamp(0.0, 3600.0))))
    }

    fn close(&self, py: Python<'_>, timeout: f64) -> StatusTuple {
        status_tuple(py.detach(|| self.core().close(Duration::from_secs_f64(timeout.clamp(0.0, 3600.0)))))
    }
}

impl Recorder {
    /// Where reads go that are to be recorded.
    pub(crate) fn feed(&self) -> Feed {
        self.feed.clone()
    }

    fn core(&self) -> MutexGuard<'_, Core> {
        self.core.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn status_tuple(status: RecorderStatus) -> StatusTuple {
    let file = status.file.to_string_lossy().into_owned();
    (file, status.trouble, status.had_trouble, status.recorded, status.lost, status.waiting)
}
