//! The reads of all live ports, in order of arrival, for the caller and for a recorder.
//!
//! Threads fill it without the caller's help. So the times are those of the reads, whatever the caller is doing, and no
//! bytes are lost while decoding, a file or the screen is slow.

use std::collections::VecDeque;
use std::io::{PipeWriter, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use modlens_pcapng::recording::PortRead;
use modlens_protocol::Ns;

use crate::clock::ClockChange;
use crate::feed::Feed;
use crate::queue::{Arrived, Read, Shared};

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
pub struct Inbox {
    shared: Arc<Shared>,
    listeners: Mutex<Vec<Listener>>,
}

impl Inbox {
    /// An inbox that holds so many bytes of memory of reads.
    pub fn new(limit: usize) -> Self {
        Self { shared: Arc::new(Shared::new(limit)), listeners: Mutex::default() }
    }

    /// Reads a copy of the descriptor in a thread of its own. `marked` takes the escapes of PARMRK apart (termios(3)). On
    /// systems where descriptors cannot be waited for, the caller reads the port and calls [`Inbox::put`].
    #[cfg(unix)]
    pub fn listen(&self, port: usize, fd: std::os::fd::BorrowedFd<'_>, marked: bool) -> std::io::Result<()> {
        let (stop_signal, stop) = std::io::pipe()?;
        let thread = crate::reader::start(Arc::clone(&self.shared), port, fd, stop_signal, marked)?;
        self.shared.queue().port(port);
        self.listeners().push(Listener { port, stop, thread });
        Ok(())
    }

    /// Queues what the caller has read just now; `None` is the end of the port.
    pub fn put(&self, port: usize, bytes: Option<Vec<u8>>) {
        let arrived = bytes.map_or(Arrived::End(0), |bytes| Arrived::Bytes { bytes, errors: Vec::new(), reader_sleeps: false });
        self.shared.push(port, crate::clock::monotonic_ns(), arrived);
    }

    /// Queues a read of another program, with the time that this has given it.
    pub fn put_dated(&self, port: usize, read: &PortRead<'_>) {
        let (bytes, errors) = (read.bytes.to_vec(), read.errors.to_vec());
        let arrived = Arrived::Dated { time: read.time, bytes, errors, follows_loss: read.hole };
        self.shared.push(port, crate::clock::monotonic_ns(), arrived);
    }

    /// Notes that the source of a port has queued all reads before this time.
    pub fn tell(&self, port: usize, time: Ns) {
        let mut queue = self.shared.queue();
        let told = &mut queue.port(port).told;
        *told = (*told).max(Some(time));
    }

    /// Up to which time each port that dates its reads has queued them.
    pub fn told_ns(&self) -> Vec<Ns> {
        self.shared.queue().ports.iter().filter_map(|port| port.told).collect()
    }

    /// Ends the thread of a port; what it has read stays in the queue.
    pub fn end(&self, port: usize) {
        let mut ended = Vec::new();
        let mut listeners = self.listeners();
        while let Some(at) = listeners.iter().position(|one| one.port == port) {
            ended.push(listeners.swap_remove(at));
        }
        drop(listeners);
        ended.into_iter().for_each(Listener::end);
    }

    /// Sends all further reads of a port to a recorder, and those that wait in the queue.
    pub fn record(&self, port: usize, feed: Feed, number: u32) {
        let mut queue = self.shared.queue();
        queue.port(port).recorder = Some((feed, number));
        let mut reads = std::mem::take(&mut queue.reads);
        for read in reads.iter_mut().filter(|read| read.port == port && !read.is_recorded) {
            read.is_recorded = queue.record(read);
        }
        queue.reads = reads;
    }

    /// Ends the recording of a port.
    pub fn stop_recording(&self, port: usize) {
        self.shared.queue().port(port).recorder = None;
    }

    /// Bytes were lost before what is read next at this port.
    pub fn hole(&self, port: usize) {
        self.shared.queue().lose(port);
    }

    /// The time of a character at a port: a line that is full is read less often then. 0 if it is not known.
    pub fn set_char_ns(&self, port: usize, char_ns: Ns) {
        self.shared.queue().port(port).char_ns = char_ns;
    }

    /// After so long without bytes no transaction is in progress, so that the times may jump with the wall clock.
    pub fn set_idle_ns(&self, idle_ns: Ns) {
        self.shared.queue().idle_ns = idle_ns;
    }

    /// Everything that has come in, waiting at most `timeout` for the first of it. Calls that give something are at least
    /// `every` apart: a busy line wakes the caller less often, unless all readers sleep between reads anyway. The first
    /// bytes after a silence are given at once.
    pub fn take(&self, timeout: Duration, every: Duration) -> VecDeque<Read> {
        let until = Instant::now() + timeout;
        let listening = self.listeners().len();
        let mut queue = self.shared.queue();
        let all_sleep = listening > 0 && queue.ports.iter().filter(|port| port.reader_sleeps).count() >= listening;
        let due = queue.last_taken.filter(|_| !all_sleep).map(|taken| taken + every);
        if let Some(left) = due.and_then(|due| due.checked_duration_since(Instant::now())) {
            drop(queue);
            std::thread::sleep(left);
            queue = self.shared.queue();
        }
        while queue.reads.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            queue = self.shared.wait(queue, left);
        }
        queue.has_waiter = false;
        queue.taken_clock = queue.clock.clone();
        if !queue.reads.is_empty() {
            queue.last_taken = Some(Instant::now());
        }
        queue.size = 0;
        std::mem::take(&mut queue.reads)
    }

    /// The time of this moment of the monotonic clock on the clock of the reads that were taken last. Reads that are waiting
    /// may have been timed by a clock that was set since.
    pub fn utc(&self, monotonic: Ns) -> Ns {
        self.shared.queue().taken_clock.utc(monotonic)
    }

    /// The present time on the clock of the reads that were taken last, in ns since 1970.
    pub fn now_ns(&self) -> Ns {
        self.utc(crate::clock::monotonic_ns())
    }

    /// What has happened to the clocks since the last call. Busy ports look at the clocks by themselves; where nothing is
    /// read, this does.
    pub fn check_clocks(&self) -> Vec<ClockChange> {
        let mut queue = self.shared.queue();
        let now = crate::clock::monotonic_ns();
        queue.check_clocks(now);
        if queue.reads.is_empty() {
            queue.taken_clock = queue.clock.clone();
        }
        std::mem::take(&mut queue.changes)
    }

    /// For tests: as if somebody had set the wall clock forward by `wall`, and the machine had slept for `suspended`.
    pub fn pretend(&self, wall: Ns, suspended: Ns) {
        self.shared.queue().pretended = (wall, suspended);
    }

    /// Bytes that did not fit into the queue.
    pub fn lost(&self) -> u64 {
        self.shared.queue().lost
    }

    /// Ends all threads; what they have read stays in the queue.
    pub fn close(&self) {
        let listeners = std::mem::take(&mut *self.listeners());
        listeners.into_iter().for_each(Listener::end);
    }

    fn listeners(&self) -> MutexGuard<'_, Vec<Listener>> {
        self.listeners.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Inbox {
    fn drop(&mut self) {
        self.close();
    }
}
