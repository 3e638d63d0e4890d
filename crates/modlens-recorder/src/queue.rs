//! What is queued between the readers of ports and the caller, and how it is timed and recorded on its way.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use modlens_pcapng::recording::PortRead;
use modlens_protocol::Ns;

use crate::clock::{Clock, ClockChange, Moment};
use crate::feed::Feed;

/// What a queued read counts towards the limit of the queue beside its bytes.
const READ_OVERHEAD_BYTES: usize = 96;

/// How often the clocks are compared.
const CHECK_INTERVAL_NS: Ns = 1_000_000_000;

/// After so long without bytes no transaction is in progress, unless the caller says otherwise.
const IDLE_NS: Ns = 1_500_000_000;

/// One read of a port, or its end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Read {
    /// The number of the port.
    pub port: usize,
    /// When the read returned, in ns since 1970.
    pub time: Ns,
    /// The bytes; `None` if the port has ended.
    pub bytes: Option<Vec<u8>>,
    /// Positions of marked bytes.
    pub errors: Vec<u32>,
    /// The number of the system's error with which the port has ended, 0 for none.
    pub error: u32,
    /// Bytes were lost before.
    pub follows_loss: bool,
    /// It went to a recorder.
    pub is_recorded: bool,
}

/// What a port has given.
pub enum Arrived {
    Bytes {
        bytes: Vec<u8>,
        errors: Vec<u32>,
        /// The reader sleeps after this read, so that reads are rare and each may wake the caller.
        reader_sleeps: bool,
    },
    /// A read of another program, with the time that this has given it.
    Dated {
        time: Ns,
        bytes: Vec<u8>,
        errors: Vec<u32>,
        /// Bytes were lost before these.
        follows_loss: bool,
    },
    /// The port has ended with this error.
    End(u32),
}

/// What is known of a port.
#[derive(Default)]
pub struct Port {
    /// Bytes were lost since its last queued read.
    pub has_loss: bool,
    /// Its reader sleeps between reads.
    pub reader_sleeps: bool,
    /// The time of a character, in ns; 0 if it is not known.
    pub char_ns: Ns,
    /// Where its reads are recorded, and its number there.
    pub recorder: Option<(Feed, u32)>,
    /// Bytes were lost since its last recorded read.
    pub has_recorded_loss: bool,
    /// All its reads before this time are queued, where its source dates them.
    pub told: Option<Ns>,
}

/// The reads that have not been taken yet.
pub struct Queue {
    pub reads: VecDeque<Read>,
    /// The memory of the reads, as `READ_OVERHEAD_BYTES` counts it.
    pub size: usize,
    /// Bytes that did not fit.
    pub lost: u64,
    pub ports: Vec<Port>,
    /// The caller waits for a read. It is woken only then, because waking a thread costs more than all else that a reader
    /// does.
    pub has_waiter: bool,
    /// When reads were last taken.
    pub last_taken: Option<Instant>,
    pub clock: Clock,
    /// The clock as it was when reads were last taken.
    pub taken_clock: Clock,
    pub changes: Vec<ClockChange>,
    /// When the clocks are compared next, and when the newest read came, on the monotonic clock.
    pub next_check: Ns,
    pub newest: Ns,
    pub idle_ns: Ns,
    /// By how much a test has set the wall clock, and for how long it pretends that the machine slept.
    pub pretended: (Ns, Ns),
}

impl Queue {
    fn new() -> Self {
        let now = Moment::now();
        let clock = Clock::new(now);
        Self {
            reads: VecDeque::new(),
            size: 0,
            lost: 0,
            ports: Vec::new(),
            has_waiter: false,
            last_taken: None,
            taken_clock: clock.clone(),
            clock,
            changes: Vec::new(),
            next_check: now.monotonic + CHECK_INTERVAL_NS,
            newest: now.monotonic,
            idle_ns: IDLE_NS,
            pretended: (0, 0),
        }
    }

    /// What is known of a port.
    pub fn port(&mut self, number: usize) -> &mut Port {
        if self.ports.len() <= number {
            self.ports.resize_with(number + 1, Port::default);
        }
        &mut self.ports[number]
    }

    /// Compares the clocks. Where times jump, or the machine has slept, what comes next follows a loss.
    pub fn check_clocks(&mut self, monotonic: Ns) {
        let mut now = Moment::now();
        now.wall += self.pretended.0;
        now.suspended += self.pretended.1;
        self.next_check = monotonic + CHECK_INTERVAL_NS;
        let before = self.clock.utc(monotonic);
        let change = self.clock.check(now, monotonic - self.newest > self.idle_ns);
        if change == ClockChange::default() {
            return;
        }
        for number in 0..self.ports.len() {
            if change.cuts_traffic {
                // What is in progress ends before the jump, so that no response time contains it.
                self.queue(Read { port: number, time: before, bytes: Some(Vec::new()), follows_loss: true, ..Read::default() });
            }
            if change.suspended_ns > 0 || change.cuts_traffic {
                self.lose(number);
            }
            if let (Some((feed, at)), 1..) = (&self.ports[number].recorder, change.followed_ns) {
                feed.mark_clock_step(*at, self.clock.utc(monotonic), change.followed_ns);
            }
        }
        self.changes.push(change);
    }

    /// Bytes of a port were lost before what comes next.
    pub fn lose(&mut self, number: usize) {
        let port = self.port(number);
        (port.has_loss, port.has_recorded_loss) = (true, true);
    }

    /// Queues and records a read.
    fn queue(&mut self, mut read: Read) {
        read.is_recorded = self.record(&read);
        self.size += read.bytes.as_ref().map_or(0, Vec::len) + READ_OVERHEAD_BYTES;
        self.reads.push_back(read);
    }

    /// Records a read, if the port is recorded.
    pub fn record(&mut self, read: &Read) -> bool {
        let port = self.port(read.port);
        let Some((feed, number)) = &port.recorder else { return false };
        let hole = read.follows_loss || read.bytes.is_none() || std::mem::take(&mut port.has_recorded_loss);
        let bytes = read.bytes.as_deref().unwrap_or_default();
        feed.write(*number, &PortRead { time: read.time, bytes, errors: &read.errors, hole });
        true
    }
}

/// What readers and caller share.
pub struct Shared {
    queue: Mutex<Queue>,
    /// Signalled when a read is queued that the caller waits for.
    arrived: Condvar,
    /// The most memory of queued reads, in bytes.
    limit: usize,
}

impl Shared {
    /// An empty queue for so many bytes of memory.
    pub fn new(limit: usize) -> Self {
        Self { queue: Mutex::new(Queue::new()), arrived: Condvar::new(), limit }
    }

    /// Waits for a read that is queued, at most so long.
    pub fn wait<'a>(&self, mut queue: MutexGuard<'a, Queue>, timeout: Duration) -> MutexGuard<'a, Queue> {
        queue.has_waiter = true;
        self.arrived.wait_timeout(queue, timeout).unwrap_or_else(PoisonError::into_inner).0
    }

    /// The time of a character at a port, in ns; 0 if it is not known.
    #[cfg(unix)]
    pub fn char_ns(&self, port: usize) -> Ns {
        self.queue().port(port).char_ns
    }

    /// The queue, for as short a time as possible: readers wait for it.
    pub fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues what has arrived at this moment of the monotonic clock. If it does not fit, its bytes are recorded all the
    /// same, counted as lost, and the next read of the port says that bytes are missing before it. The end of a port always
    /// fits.
    pub fn push(&self, port: usize, monotonic: Ns, arrived: Arrived) {
        let mut queue = self.queue();
        if monotonic >= queue.next_check || monotonic - queue.newest > queue.idle_ns {
            queue.check_clocks(monotonic);
        }
        queue.newest = queue.newest.max(monotonic);
        let mut read = Read { port, time: queue.clock.utc(monotonic), ..Read::default() };
        match arrived {
            Arrived::End(error) => {
                let port = queue.port(port);
                // No read comes before the end, whatever clock dates it.
                read.time = read.time.max(port.told.take().unwrap_or(read.time));
                port.reader_sleeps = false;
                read.error = error;
            }
            Arrived::Bytes { bytes, errors, reader_sleeps } => {
                queue.port(port).reader_sleeps = reader_sleeps;
                (read.bytes, read.errors) = (Some(bytes), errors);
            }
            Arrived::Dated { time, bytes, errors, follows_loss } => {
                if follows_loss {
                    queue.lose(port);
                }
                (read.time, read.bytes, read.errors) = (time, Some(bytes), errors);
            }
        }
        let length = read.bytes.as_ref().map_or(0, Vec::len);
        if read.bytes.is_some() && queue.size + length + READ_OVERHEAD_BYTES > self.limit {
            queue.record(&read);
            queue.lost += length as u64;
            queue.port(port).has_loss = true;
            return;
        }
        let had_loss = read.bytes.is_some() && std::mem::take(&mut queue.port(port).has_loss);
        // The recording may be complete where the queue is not.
        read.is_recorded = queue.record(&read);
        read.follows_loss = had_loss;
        queue.size += length + READ_OVERHEAD_BYTES;
        queue.reads.push_back(read);
        let had_waiter = std::mem::take(&mut queue.has_waiter);
        drop(queue);
        if had_waiter {
            self.arrived.notify_one();
        }
    }
}
