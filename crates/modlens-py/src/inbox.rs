//! Live ports: the reads that the recorder's crate queues, for Python and straight to the session.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use modlens_engine::session::Session as Core;
use modlens_readers::chunk::{Chunk, Times};
use modlens_recorder::clock::monotonic_ns;
use modlens_recorder::{ClockChange, Inbox as Reads, Read};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::recorder::Recorder;
use crate::session::Session;

/// A read as Python gets it: port, time in ns since 1970, bytes (`None` if the port has ended), positions of marked bytes
/// (or the number of the error with which the port has ended), whether bytes were lost before, whether it is recorded.
type ReadTuple<'py> = (usize, i64, Option<Bound<'py, PyBytes>>, Vec<u32>, bool, bool);

/// The bus and line of a session to which the reads of a port go; `None` if Python wants them.
type Route = Option<(usize, u8)>;

/// The reads of all ports, in order of arrival.
#[pyclass(frozen, module = "_modlens")]
pub struct Inbox {
    reads: Reads,
    routes: Mutex<Vec<Route>>,
}

#[pymethods]
impl Inbox {
    #[new]
    #[pyo3(signature = (limit=1 << 26))]
    fn new(limit: usize) -> Self {
        Self { reads: Reads::new(limit), routes: Mutex::default() }
    }

    #[cfg(unix)]
    #[pyo3(signature = (port, fd, *, marked=false))]
    fn listen(&self, port: usize, fd: i32, marked: bool) -> PyResult<()> {
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

    fn end(&self, py: Python<'_>, port: usize) {
        py.detach(|| self.reads.end(port));
    }

    fn put(&self, port: usize, data: Option<Vec<u8>>) {
        self.reads.put(port, data);
    }

    #[pyo3(signature = (timeout, every=0.0))]
    fn take<'py>(&self, py: Python<'py>, timeout: f64, every: f64) -> Vec<ReadTuple<'py>> {
        read_tuples(py, py.detach(|| self.reads.take(seconds(timeout), between(every))))
    }

    #[pyo3(signature = (port, bus, line, char_ns=0))]
    fn route(&self, port: usize, bus: usize, line: u8, char_ns: i64) {
        let mut routes = self.routes();
        let ports = routes.len().max(port + 1);
        routes.resize(ports, None);
        routes[port] = Some((bus, line));
        self.reads.set_char_ns(port, char_ns);
    }

    fn unroute(&self, port: usize) {
        if let Some(route) = self.routes().get_mut(port) {
            *route = None;
        }
    }

    fn record(&self, port: usize, recorder: &Recorder, number: u32) {
        self.reads.record(port, recorder.feed(), number);
    }

    fn stop_recording(&self, port: usize) {
        self.reads.stop_recording(port);
    }

    #[pyo3(signature = (session, lag_ns, timeout, every=0.0))]
    fn feed<'py>(
        &self,
        py: Python<'py>,
        mut session: PyRefMut<'_, Session>,
        lag_ns: i64,
        timeout: f64,
        every: f64,
    ) -> PyResult<Vec<ReadTuple<'py>>> {
        let routes = self.routes().clone();
        routes.iter().flatten().try_for_each(|(bus, _)| session.check_bus(*bus))?;
        let core = session.core();
        let rest = py.detach(|| {
            let until = Instant::now() + seconds(timeout);
            loop {
                let mut reads = self.reads.take(until.saturating_duration_since(Instant::now()), between(every));
                while let Some(read) = reads.front() {
                    let (Some(data), Some(Some(route))) = (&read.bytes, routes.get(read.port)) else { return reads };
                    feed_read(core, *route, read, data);
                    reads.pop_front();
                }
                core.poll(self.reads.utc(monotonic_ns()) - lag_ns);
                // The interpreter is entered only once there are rows to show, because that costs more than all of this.
                if core.pending_rows() > 0 || Instant::now() >= until {
                    return reads;
                }
            }
        });
        Ok(read_tuples(py, rest))
    }

    fn hole(&self, port: usize) {
        self.reads.hole(port);
    }

    fn set_idle_ns(&self, idle_ns: i64) {
        self.reads.set_idle_ns(idle_ns);
    }

    fn now_ns(&self) -> i64 {
        self.reads.now_ns()
    }

    fn check_clocks(&self) -> Vec<(i64, i64, i64, bool)> {
        let tuple = |change: ClockChange| (change.step_ns, change.suspended_ns, change.followed_ns, change.cuts_traffic);
        self.reads.check_clocks().into_iter().map(tuple).collect()
    }

    fn pretend(&self, wall_ns: i64, suspended_ns: i64) {
        self.reads.pretend(wall_ns, suspended_ns);
    }

    fn lost(&self) -> u64 {
        self.reads.lost()
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.reads.close());
    }
}

impl Inbox {
    fn routes(&self) -> MutexGuard<'_, Vec<Route>> {
        self.routes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Feeds a read to the session.
fn feed_read(core: &mut Core, (bus, line): (usize, u8), read: &Read, data: &[u8]) {
    let times = Times::Read(read.time);
    if read.follows_loss {
        // The loss is fed first, without bytes: it closes what came before only after everything has been decided that time
        // alone decides. `analyzer.live_run` and the recorder do the same.
        core.feed(bus, &Chunk { line, times, follows_loss: true, ..Chunk::default() });
    }
    if data.is_empty() {
        return;
    }
    core.feed(
        bus,
        &Chunk { bytes: data, line, times, error_positions: &read.errors, follows_loss: read.follows_loss, ..Chunk::default() },
    );
}

/// A timeout in seconds, of at most an hour.
fn seconds(number: f64) -> Duration {
    Duration::from_secs_f64(number.clamp(0.0, 3600.0))
}

/// The least time between two calls, of at most a second.
fn between(number: f64) -> Duration {
    Duration::from_secs_f64(number.clamp(0.0, 1.0))
}

fn read_tuples(py: Python<'_>, reads: VecDeque<Read>) -> Vec<ReadTuple<'_>> {
    let tuple = |read: Read| {
        let positions = if read.bytes.is_none() { vec![read.error] } else { read.errors };
        let data = read.bytes.map(|data| PyBytes::new(py, &data));
        (read.port, read.time, data, positions, read.follows_loss, read.is_recorded)
    };
    reads.into_iter().map(tuple).collect()
}
