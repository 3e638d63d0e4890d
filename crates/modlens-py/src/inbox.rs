//! The reads of live ports, for ports that Python reads and for tests of ports.

use std::sync::Arc;
use std::time::Duration;

use modlens_pcapng::recording::PortRead;
use modlens_recorder::{Inbox as Reads, Read};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

/// A read as Python gets it: port, time in ns since 1970, bytes (`None` if the port has ended), positions of marked bytes
/// (or the number of the error with which the port has ended), whether bytes were lost before, whether it is recorded.
type ReadTuple<'py> = (usize, i64, Option<Bound<'py, PyBytes>>, Vec<u32>, bool, bool);

/// The reads of all ports, in order of arrival.
#[pyclass(frozen, module = "_modlens")]
pub struct Inbox {
    pub(crate) reads: Arc<Reads>,
}

#[pymethods]
impl Inbox {
    #[new]
    #[pyo3(signature = (limit=1 << 26))]
    fn new(limit: usize) -> Self {
        Self { reads: Arc::new(Reads::new(limit)) }
    }

    #[cfg(unix)]
    #[pyo3(signature = (port, fd, *, marked=false))]
    fn listen(&self, port: usize, fd: i32, marked: bool) -> PyResult<()> {
        if fd < 0 {
            // -1 is what a closed socket has; `BorrowedFd` forbids it.
            return Err(pyo3::exceptions::PyOSError::new_err(format!("{fd} is not an open descriptor")));
        }
        // SAFETY: the caller keeps `fd` open during this call, and it is duplicated before the call returns. For a number
        // that is not open `dup` returns an error.
        #[allow(unsafe_code)]
        let fd = unsafe { std::os::fd::BorrowedFd::borrow_raw(fd) };
        Ok(self.reads.listen(port, fd, marked)?)
    }

    #[cfg(not(unix))]
    #[pyo3(signature = (port, fd, *, marked=false))]
    fn listen(&self, port: usize, fd: i32, marked: bool) -> PyResult<()> {
        let _ = (port, fd, marked);
        Err(pyo3::exceptions::PyNotImplementedError::new_err("descriptors can be read on POSIX only"))
    }

    #[pyo3(signature = (port, data, time_ns=None))]
    fn put(&self, port: usize, data: Option<Vec<u8>>, time_ns: Option<i64>) {
        match data.as_ref().zip(time_ns) {
            Some((bytes, time)) => self.reads.put_dated(port, &PortRead { time, bytes, ..PortRead::default() }),
            None => self.reads.put(port, data),
        }
    }

    fn tell(&self, port: usize, time_ns: i64) {
        self.reads.tell(port, time_ns);
    }

    fn hole(&self, port: usize) {
        self.reads.hole(port);
    }

    fn take<'py>(&self, py: Python<'py>, timeout: f64) -> Vec<ReadTuple<'py>> {
        let timeout = Duration::from_secs_f64(timeout.clamp(0.0, 3600.0));
        let reads = py.detach(|| self.reads.take(timeout, Duration::ZERO));
        reads.into_iter().map(|read| read_tuple(py, read)).collect()
    }

    fn now_ns(&self) -> i64 {
        self.reads.now_ns()
    }

    fn lost(&self) -> u64 {
        self.reads.lost()
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.reads.close());
    }
}

fn read_tuple(py: Python<'_>, read: Read) -> ReadTuple<'_> {
    let positions = if read.bytes.is_none() { vec![read.error] } else { read.errors };
    let data = read.bytes.map(|data| PyBytes::new(py, &data));
    (read.port, read.time, data, positions, read.follows_loss, read.is_recorded)
}
