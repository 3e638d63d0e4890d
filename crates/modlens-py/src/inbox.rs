//! Readers of ports: a thread each that does nothing but wait, read, look at the clock and queue.
//!
//! They are threads of the system and take no part in Python's lock, so a time is that of the read whatever the
//! interpreter does meanwhile, and nothing is lost while decoding, a file or the screen stalls. There is no way to write.

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

/// Bytes that a read takes at most.
const READ_SIZE: usize = 4096;

/// What a queued read costs beside its bytes.
const ITEM_COST: usize = 96;

/// (port, time, bytes or None at the end, places of marked bytes or the error's number, hole)
type Arrival<'py> = (usize, i64, Option<Bound<'py, PyBytes>>, Vec<u32>, bool);

/// Bus and line of a session; None where Python wants the reads.
type Route = Option<(usize, u8)>;

struct Item {
    port: usize,
    time: Ns,
    data: Option<Vec<u8>>,
    errors: Vec<u32>,
    hole: bool,
    /// The port is read so seldom that each read is worth a look.
    seldom: bool,
}

impl Item {
    fn new(port: usize, time: Ns, data: Option<Vec<u8>>, errors: Vec<u32>) -> Self {
        Self { port, time, data, errors, hole: false, seldom: false }
    }
}

#[derive(Default)]
struct Queue {
    items: VecDeque<Item>,
    size: usize,
    lost: u64,
    /// Ports of which something is missing since their last item.
    holes: Vec<usize>,
    /// Where the reads of each port go: bus and line.
    routes: Vec<Route>,
    /// How long a character takes at each of these ports.
    chars: Vec<Ns>,
    /// Somebody waits for the first item; to wake a thread costs more than all else that a reader does.
    awaited: bool,
    /// When items were last taken.
    taken: Option<Instant>,
    /// The time of the newest read.
    newest: Ns,
    /// Ports whose last read was one of those.
    seldom: Vec<usize>,
}

struct Shared {
    queue: Mutex<Queue>,
    arrived: Condvar,
    limit: usize,
}

impl Shared {
    /// How long a character takes at a port with a route; 0 where that is not known.
    fn char_ns(&self, port: usize) -> Ns {
        self.queue().chars.get(port).copied().unwrap_or(0)
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues it; what does not fit any more is counted, and the port's next item says that something is missing.
    fn push(&self, mut item: Item) {
        let mut queue = self.queue();
        queue.newest = queue.newest.max(item.time);
        if queue.seldom.contains(&item.port) != item.seldom {
            queue.seldom.retain(|&port| port != item.port);
            queue.seldom.extend(item.seldom.then_some(item.port));
        }
        let cost = item.data.as_ref().map_or(0, Vec::len) + ITEM_COST;
        if item.data.is_some() && queue.size + cost > self.limit {
            queue.lost += item.data.map_or(0, |data| data.len() as u64);
            if !queue.holes.contains(&item.port) {
                queue.holes.push(item.port);
            }
            return;
        }
        if let Some(at) = queue.holes.iter().position(|&port| port == item.port) {
            queue.holes.swap_remove(at);
            item.hole = true;
        }
        queue.size += cost;
        queue.items.push_back(item);
        let awaited = std::mem::take(&mut queue.awaited);
        drop(queue);
        if awaited {
            self.arrived.notify_one();
        }
    }
}

struct Listener {
    port: usize,
    stop: PipeWriter,
    thread: JoinHandle<()>,
}

impl Listener {
    fn end(mut self) {
        let _ = self.stop.write_all(b"s");
        let _ = self.thread.join();
    }
}

/// What has come in at any of several ports, in order of arrival.
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
        let (stopped, stop) = pipe()?;
        let thread = reader::start(Arc::clone(&self.shared), port, fd, stopped, marked)?;
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
        self.shared.push(Item::new(port, time_ns, data, Vec::new()));
    }

    #[pyo3(signature = (timeout, every=0.0))]
    fn take<'py>(&self, py: Python<'py>, timeout: f64, every: f64) -> Vec<Arrival<'py>> {
        arrivals(py, py.detach(|| self.wait(Instant::now() + seconds(timeout), every)))
    }

    #[pyo3(signature = (port, bus, line, char_ns=0))]
    fn route(&self, port: usize, bus: usize, line: u8, char_ns: i64) {
        let mut queue = self.shared.queue();
        let ports = queue.routes.len().max(port + 1);
        queue.routes.resize(ports, None);
        queue.chars.resize(ports, 0);
        queue.routes[port] = Some((bus, line));
        queue.chars[port] = char_ns;
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
    ) -> PyResult<Vec<Arrival<'py>>> {
        let routes = self.shared.queue().routes.clone();
        routes.iter().flatten().try_for_each(|(bus, _)| session.check(*bus))?;
        let core = session.core();
        let rest = py.detach(|| {
            let begun = Instant::now();
            let until = begun + seconds(timeout);
            loop {
                let mut items = self.wait(until, every);
                while let Some(item) = items.front() {
                    let (Some(data), Some(Some(route))) = (&item.data, routes.get(item.port)) else { return items };
                    pass(core, *route, item, data, shift_ns);
                    items.pop_front();
                }
                core.poll(told_ns + begun.elapsed().as_nanos() as Ns);
                // Python is not asked for anything until there is something to show: its waking costs more than all of this.
                if core.pending_rows() > 0 || Instant::now() >= until {
                    return items;
                }
            }
        });
        Ok(arrivals(py, rest))
    }

    fn hole(&self, port: usize) {
        let mut queue = self.shared.queue();
        if !queue.holes.contains(&port) {
            queue.holes.push(port);
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

/// Gives a read to the session.
fn pass(core: &mut Core, (bus, line): (usize, u8), item: &Item, data: &[u8], shift_ns: Ns) {
    let times = Times::Read(item.time + shift_ns);
    if item.hole {
        // What time alone decides is decided before what came before is closed; `analyzer.live` does the same.
        core.feed(bus, &Chunk { line, times, follows_loss: true, ..Chunk::default() });
    }
    core.feed(
        bus,
        &Chunk { bytes: data, line, times, error_positions: &item.errors, follows_loss: item.hole, ..Chunk::default() },
    );
}

fn seconds(number: f64) -> Duration {
    Duration::from_secs_f64(number.clamp(0.0, 3600.0))
}

fn arrivals(py: Python<'_>, items: VecDeque<Item>) -> Vec<Arrival<'_>> {
    let bytes = |data: Vec<u8>| PyBytes::new(py, &data);
    items.into_iter().map(|item| (item.port, item.time, item.data.map(bytes), item.errors, item.hole)).collect()
}

impl Inbox {
    fn listeners(&self) -> MutexGuard<'_, Vec<Listener>> {
        self.listeners.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A busy line is looked at every so many seconds, which wakes one thread once, unless its reader waits as long; the first bytes after a silence
    /// are handed over as they come.
    fn wait(&self, until: Instant, every: f64) -> VecDeque<Item> {
        let listening = self.listeners().len();
        let mut queue = self.shared.queue();
        let seldom = listening > 0 && queue.seldom.len() == listening;
        let due = queue.taken.filter(|_| !seldom).map(|taken| taken + Duration::from_secs_f64(every.clamp(0.0, 1.0)));
        if let Some(left) = due.and_then(|due| due.checked_duration_since(Instant::now())) {
            drop(queue);
            std::thread::sleep(left);
            queue = self.shared.queue();
        }
        while queue.items.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return VecDeque::new();
            }
            queue.awaited = true;
            queue = self.shared.arrived.wait_timeout(queue, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        queue.awaited = false;
        queue.taken = Some(Instant::now());
        queue.size = 0;
        std::mem::take(&mut queue.items)
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

    use super::{Arc, Item, JoinHandle, Ns, ParmrkDecoder, PyResult, Shared, READ_SIZE};

    /// Starts the thread; it has a descriptor of its own, so that nobody can close it under its hands.
    pub fn start(shared: Arc<Shared>, port: usize, fd: i32, stop: PipeReader, marked: bool) -> PyResult<JoinHandle<()>> {
        // SAFETY: the caller keeps `fd` open during this call; it is duplicated before it returns. A number that is
        // not open is told by `dup` as an error.
        #[allow(unsafe_code)]
        let file = unsafe { BorrowedFd::borrow_raw(fd) }.try_clone_to_owned()?;
        let decoder = marked.then(ParmrkDecoder::default);
        let run = move || {
            let number = listen(&shared, port, &file, &stop, decoder);
            if let Some(number) = number {
                shared.push(Item::new(port, now(), None, vec![number]));
            }
        };
        Ok(std::thread::Builder::new().name(format!("modlens port {port}")).spawn(run)?)
    }

    /// Reads until the port ends (gives the error's number, 0 for none) or it is told to stop (None).
    fn listen(
        shared: &Shared,
        port: usize,
        file: &OwnedFd,
        stop: &PipeReader,
        mut decoder: Option<ParmrkDecoder>,
    ) -> Option<u32> {
        let mut buffer = [0u8; READ_SIZE];
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
            let (mut data, mut errors) = (Vec::with_capacity(length), Vec::new());
            match &mut decoder {
                Some(decoder) => decoder.push(&buffer[..length], &mut data, &mut errors),
                None => data.extend_from_slice(&buffer[..length]),
            }
            let rest = pace.sleep_after(length, time, shared.char_ns(port));
            if !data.is_empty() {
                shared.push(Item { seldom: !rest.is_zero(), ..Item::new(port, time, Some(data), errors) });
            }
            if !rest.is_zero() {
                std::thread::sleep(rest);
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

    /// Where there are no descriptors to wait for, Python reads and calls `put`.
    pub fn start(_: Arc<Shared>, _: usize, _: i32, _: PipeReader, _: bool) -> PyResult<JoinHandle<()>> {
        Err(pyo3::exceptions::PyNotImplementedError::new_err("descriptors can be read on POSIX only"))
    }
}
