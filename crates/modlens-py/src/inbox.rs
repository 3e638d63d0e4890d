//! Reads live ports: each port has a thread that only waits for bytes, reads them, takes the time and queues them.
//!
//! These threads do not need Python's lock. So the times are those of the reads, whatever the interpreter is doing, and
//! no bytes are lost while decoding, a file or the screen is slow. Nothing here can write to a port.

use std::collections::VecDeque;
use std::io::{pipe, PipeWriter, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use modlens_engine::session::Session as Core;
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::parmrk::ParmrkDecoder;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::session::Session;

/// The most bytes of one read.
const MAX_READ_BYTES: usize = 4096;

/// What a queued read counts towards the limit of the queue beside its bytes.
const READ_OVERHEAD_BYTES: usize = 96;

/// A read as Python gets it: port, time in ns, bytes (`None` if the port has ended), positions of marked bytes (or the
/// number of the error with which the port has ended), and whether bytes were lost before.
type ReadTuple<'py> = (usize, i64, Option<Bound<'py, PyBytes>>, Vec<u32>, bool);

/// The bus and line of a session to which the reads of a port go; `None` if Python wants them.
type Route = Option<(usize, u8)>;

/// One read of a port, or its end.
struct QueuedRead {
    port: usize,
    /// When the read returned.
    time: Ns,
    /// The bytes; `None` if the port has ended.
    data: Option<Vec<u8>>,
    /// Positions of marked bytes; at the end of a port the number of the error, 0 for none.
    error_positions: Vec<u32>,
    /// Bytes were lost before.
    follows_loss: bool,
    /// The reader sleeps after this read, so that reads are rare and each may wake the consumer.
    reader_sleeps: bool,
}

impl QueuedRead {
    fn new(port: usize, time: Ns, data: Option<Vec<u8>>, error_positions: Vec<u32>) -> Self {
        Self { port, time, data, error_positions, follows_loss: false, reader_sleeps: false }
    }
}

/// The reads that have not been taken yet.
#[derive(Default)]
struct Queue {
    reads: VecDeque<QueuedRead>,
    /// The memory of the reads, as `READ_OVERHEAD_BYTES` counts it.
    size: usize,
    /// Bytes that did not fit.
    lost: u64,
    /// Ports of which bytes were lost since their last queued read.
    ports_with_loss: Vec<usize>,
    /// Where the reads of each port go.
    routes: Vec<Route>,
    /// The time of a character at each of these ports, in ns.
    char_times_ns: Vec<Ns>,
    /// The consumer waits for a read. It is woken only then, because waking a thread costs more than all else that a
    /// reader does.
    has_waiter: bool,
    /// When reads were last taken.
    last_taken: Option<Instant>,
    /// The time of the newest read.
    newest: Ns,
    /// Ports whose reader sleeps between reads.
    sleeping_ports: Vec<usize>,
}

/// What readers and consumer share.
struct Shared {
    queue: Mutex<Queue>,
    /// Signalled when a read is queued that the consumer waits for.
    arrived: Condvar,
    /// The most memory of queued reads, in bytes.
    limit: usize,
}

impl Shared {
    /// The time of a character at a port with a route, in ns; 0 if it is not known.
    fn char_ns(&self, port: usize) -> Ns {
        self.queue().char_times_ns.get(port).copied().unwrap_or(0)
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues a read. If it does not fit, its bytes are counted as lost, and the next read of the port says that bytes are
    /// missing before it. The end of a port always fits.
    fn push(&self, mut read: QueuedRead) {
        let mut queue = self.queue();
        queue.newest = queue.newest.max(read.time);
        if queue.sleeping_ports.contains(&read.port) != read.reader_sleeps {
            queue.sleeping_ports.retain(|&port| port != read.port);
            queue.sleeping_ports.extend(read.reader_sleeps.then_some(read.port));
        }
        let cost = read.data.as_ref().map_or(0, Vec::len) + READ_OVERHEAD_BYTES;
        if read.data.is_some() && queue.size + cost > self.limit {
            queue.lost += read.data.map_or(0, |data| data.len() as u64);
            if !queue.ports_with_loss.contains(&read.port) {
                queue.ports_with_loss.push(read.port);
            }
            return;
        }
        if let Some(at) = queue.ports_with_loss.iter().position(|&port| port == read.port) {
            queue.ports_with_loss.swap_remove(at);
            read.follows_loss = true;
        }
        queue.size += cost;
        queue.reads.push_back(read);
        let had_waiter = std::mem::take(&mut queue.has_waiter);
        drop(queue);
        if had_waiter {
            self.arrived.notify_one();
        }
    }
}

/// The thread of one port.
struct Listener {
    port: usize,
    /// Writing to this pipe stops the thread.
    stop: PipeWriter,
    thread: JoinHandle<()>,
}

impl Listener {
    /// Stops the thread and waits for its end.
    fn end(mut self) {
        let _ = self.stop.write_all(b"s");
        let _ = self.thread.join();
    }
}

/// The reads of all ports, in order of arrival.
#[pyclass(module = "_modlens")]
pub struct Inbox {
    shared: Arc<Shared>,
    listeners: Mutex<Vec<Listener>>,
}

#[pymethods]
impl Inbox {
    #[new]
    #[pyo3(signature = (limit=1 << 26))]
    fn new(limit: usize) -> Self {
        let shared = Shared { queue: Mutex::default(), arrived: Condvar::new(), limit };
        Self { shared: Arc::new(shared), listeners: Mutex::default() }
    }

    #[pyo3(signature = (port, fd, *, marked=false))]
    fn listen(&self, port: usize, fd: i32, marked: bool) -> PyResult<()> {
        let (stop_signal, stop) = pipe()?;
        let thread = reader::start(Arc::clone(&self.shared), port, fd, stop_signal, marked)?;
        self.listeners().push(Listener { port, stop, thread });
        Ok(())
    }

    fn end(&self, py: Python<'_>, port: usize) {
        py.detach(|| {
            let mut ended = Vec::new();
            let mut listeners = self.listeners();
            while let Some(at) = listeners.iter().position(|one| one.port == port) {
                ended.push(listeners.swap_remove(at));
            }
            drop(listeners);
            ended.into_iter().for_each(Listener::end);
        });
    }

    fn put(&self, port: usize, time_ns: i64, data: Option<Vec<u8>>) {
        self.shared.push(QueuedRead::new(port, time_ns, data, Vec::new()));
    }

    #[pyo3(signature = (timeout, every=0.0))]
    fn take<'py>(&self, py: Python<'py>, timeout: f64, every: f64) -> Vec<ReadTuple<'py>> {
        read_tuples(py, py.detach(|| self.wait(Instant::now() + seconds(timeout), every)))
    }

    #[pyo3(signature = (port, bus, line, char_ns=0))]
    fn route(&self, port: usize, bus: usize, line: u8, char_ns: i64) {
        let mut queue = self.shared.queue();
        let ports = queue.routes.len().max(port + 1);
        queue.routes.resize(ports, None);
        queue.char_times_ns.resize(ports, 0);
        queue.routes[port] = Some((bus, line));
        queue.char_times_ns[port] = char_ns;
    }

    fn unroute(&self, port: usize) {
        if let Some(route) = self.shared.queue().routes.get_mut(port) {
            *route = None;
        }
    }

    #[pyo3(signature = (session, shift_ns, told_ns, timeout, every=0.0))]
    fn feed<'py>(
        &self,
        py: Python<'py>,
        mut session: PyRefMut<'_, Session>,
        shift_ns: i64,
        told_ns: i64,
        timeout: f64,
        every: f64,
    ) -> PyResult<Vec<ReadTuple<'py>>> {
        let routes = self.shared.queue().routes.clone();
        routes.iter().flatten().try_for_each(|(bus, _)| session.check_bus(*bus))?;
        let core = session.core();
        let rest = py.detach(|| {
            let begun = Instant::now();
            let until = begun + seconds(timeout);
            loop {
                let mut reads = self.wait(until, every);
                while let Some(read) = reads.front() {
                    let (Some(data), Some(Some(route))) = (&read.data, routes.get(read.port)) else { return reads };
                    feed_read(core, *route, read, data, shift_ns);
                    reads.pop_front();
                }
                core.poll(told_ns + begun.elapsed().as_nanos() as Ns);
                // The interpreter is entered only once there are rows to show, because that costs more than all of this.
                if core.pending_rows() > 0 || Instant::now() >= until {
                    return reads;
                }
            }
        });
        Ok(read_tuples(py, rest))
    }

    fn hole(&self, port: usize) {
        let mut queue = self.shared.queue();
        if !queue.ports_with_loss.contains(&port) {
            queue.ports_with_loss.push(port);
        }
    }

    fn newest(&self) -> Ns {
        self.shared.queue().newest
    }

    fn lost(&self) -> u64 {
        self.shared.queue().lost
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| {
            let listeners = std::mem::take(&mut *self.listeners());
            listeners.into_iter().for_each(Listener::end);
        });
    }
}

/// Feeds a read to the session.
fn feed_read(core: &mut Core, (bus, line): (usize, u8), read: &QueuedRead, data: &[u8], shift_ns: Ns) {
    let times = Times::Read(read.time + shift_ns);
    if read.follows_loss {
        // The loss is fed first, without bytes: it closes what came before only after everything has been decided that time
        // alone decides. `analyzer.live` does the same.
        core.feed(bus, &Chunk { line, times, follows_loss: true, ..Chunk::default() });
    }
    core.feed(
        bus,
        &Chunk {
            bytes: data,
            line,
            times,
            error_positions: &read.error_positions,
            follows_loss: read.follows_loss,
            ..Chunk::default()
        },
    );
}

/// A time-out in seconds, of at most an hour.
fn seconds(number: f64) -> Duration {
    Duration::from_secs_f64(number.clamp(0.0, 3600.0))
}

fn read_tuples(py: Python<'_>, reads: VecDeque<QueuedRead>) -> Vec<ReadTuple<'_>> {
    let bytes = |data: Vec<u8>| PyBytes::new(py, &data);
    reads.into_iter().map(|read| (read.port, read.time, read.data.map(bytes), read.error_positions, read.follows_loss)).collect()
}

impl Inbox {
    fn listeners(&self) -> MutexGuard<'_, Vec<Listener>> {
        self.listeners.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for reads until `until` and takes all of them. Reads are taken at most every `every` seconds, so that a busy
    /// line wakes the consumer once for several reads, unless all readers sleep between reads anyway. The first bytes after
    /// a silence are taken at once.
    fn wait(&self, until: Instant, every: f64) -> VecDeque<QueuedRead> {
        let listening = self.listeners().len();
        let mut queue = self.shared.queue();
        let all_sleep = listening > 0 && queue.sleeping_ports.len() == listening;
        let due = queue.last_taken.filter(|_| !all_sleep).map(|taken| taken + Duration::from_secs_f64(every.clamp(0.0, 1.0)));
        if let Some(left) = due.and_then(|due| due.checked_duration_since(Instant::now())) {
            drop(queue);
            std::thread::sleep(left);
            queue = self.shared.queue();
        }
        while queue.reads.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return VecDeque::new();
            }
            queue.has_waiter = true;
            queue = self.shared.arrived.wait_timeout(queue, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        queue.has_waiter = false;
        queue.last_taken = Some(Instant::now());
        queue.size = 0;
        std::mem::take(&mut queue.reads)
    }
}

impl Drop for Inbox {
    fn drop(&mut self) {
        for listener in std::mem::take(&mut *self.listeners()) {
            listener.end();
        }
    }
}

#[cfg(unix)]
mod reader {
    use std::io::PipeReader;
    use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

    use modlens_readers::pace::ReadPacer;
    use rustix::event::{poll, PollFd, PollFlags};
    use rustix::io::Errno;
    use rustix::time::{clock_gettime, ClockId};

    use super::{Arc, JoinHandle, Ns, ParmrkDecoder, PyResult, QueuedRead, Shared, MAX_READ_BYTES};

    /// Starts the thread of a port. It gets a duplicate of the descriptor, so that closing `fd` does not affect it.
    pub fn start(shared: Arc<Shared>, port: usize, fd: i32, stop: PipeReader, marked: bool) -> PyResult<JoinHandle<()>> {
        // SAFETY: the caller keeps `fd` open during this call, and it is duplicated before the call returns. For a number
        // that is not open `dup` returns an error.
        #[allow(unsafe_code)]
        let file = unsafe { BorrowedFd::borrow_raw(fd) }.try_clone_to_owned()?;
        let decoder = marked.then(ParmrkDecoder::default);
        let run = move || {
            let error_number = listen(&shared, port, &file, &stop, decoder);
            if let Some(error_number) = error_number {
                shared.push(QueuedRead::new(port, now(), None, vec![error_number]));
            }
        };
        Ok(std::thread::Builder::new().name(format!("modlens port {port}")).spawn(run)?)
    }

    /// Reads until the port ends (returns the number of the error, 0 for none) or until it is stopped (returns `None`).
    fn listen(
        shared: &Shared,
        port: usize,
        file: &OwnedFd,
        stop: &PipeReader,
        mut decoder: Option<ParmrkDecoder>,
    ) -> Option<u32> {
        let mut buffer = [0u8; MAX_READ_BYTES];
        let mut pace = ReadPacer::default();
        loop {
            let mut ready = [PollFd::new(file, PollFlags::IN), PollFd::from_borrowed_fd(stop.as_fd(), PollFlags::IN)];
            match poll(&mut ready, None) {
                Err(Errno::INTR) => continue,
                Err(error) => return Some(error.raw_os_error().unsigned_abs()),
                Ok(_) => {}
            }
            if !ready[1].revents().is_empty() {
                return None;
            }
            let length = match rustix::io::read(file, &mut buffer) {
                Err(Errno::INTR | Errno::AGAIN) => continue,
                Err(error) => return Some(error.raw_os_error().unsigned_abs()),
                Ok(0) => return Some(0),
                Ok(length) => length,
            };
            let time = now();
            let (mut data, mut error_positions) = (Vec::with_capacity(length), Vec::new());
            match &mut decoder {
                Some(decoder) => decoder.push(&buffer[..length], &mut data, &mut error_positions),
                None => data.extend_from_slice(&buffer[..length]),
            }
            let sleep = pace.sleep_after(length, time, shared.char_ns(port));
            if !data.is_empty() {
                shared.push(QueuedRead {
                    reader_sleeps: !sleep.is_zero(),
                    ..QueuedRead::new(port, time, Some(data), error_positions)
                });
            }
            if !sleep.is_zero() {
                std::thread::sleep(sleep);
            }
        }
    }

    fn now() -> Ns {
        let time = clock_gettime(ClockId::Monotonic);
        time.tv_sec * 1_000_000_000 + time.tv_nsec
    }
}

#[cfg(not(unix))]
mod reader {
    use std::io::PipeReader;

    use super::{Arc, JoinHandle, PyResult, Shared};

    /// Descriptors cannot be waited for on this system, so Python reads the port and calls `put`.
    pub fn start(_: Arc<Shared>, _: usize, _: i32, _: PipeReader, _: bool) -> PyResult<JoinHandle<()>> {
        Err(pyo3::exceptions::PyNotImplementedError::new_err("descriptors can be read on POSIX only"))
    }
}
