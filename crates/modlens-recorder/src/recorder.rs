//! The thread that writes a recording, and what is waiting for it.

use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use modlens_pcapng::recording::PortRead;
use modlens_protocol::Ns;

use crate::feed::{Feed, ReadSink};
use crate::segments::{Names, RecordedPort, Retention, Rotation};
use crate::writer::{Block, Item, Place, Writer};

/// The thread lets so much time pass between two writes, so that a busy line costs few of them.
const BETWEEN_WRITES: Duration = Duration::from_millis(4);

/// How often it is tried again to write to a full disk, and looked whether the file is still there.
const RETRY: Duration = Duration::from_secs(1);

/// What a waiting block counts towards the limit beside its bytes.
const BLOCK_OVERHEAD_BYTES: usize = 64;

/// How a recording is made.
#[derive(Clone, Debug)]
pub struct RecorderOptions {
    /// The file; `.pcapng` is appended if its name has another suffix.
    pub path: PathBuf,
    /// What writes it, as `modlens 1.0`.
    pub application: String,
    /// When a segment ends.
    pub rotation: Rotation,
    /// Which segments stay.
    pub retention: Retention,
    /// The memory of blocks that wait for the disk, in bytes.
    pub memory: usize,
}

impl RecorderOptions {
    /// One file without an end, and 16 MiB of memory: two hours of a line that is full at 9600 baud.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        let application = format!("modlens {}", env!("CARGO_PKG_VERSION"));
        let (rotation, retention) = (Rotation::Never, Retention::All);
        Self { path: path.into(), application, rotation, retention, memory: 1 << 24 }
    }
}

/// How a recording is going.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecorderStatus {
    /// The file that is written.
    pub file: PathBuf,
    /// Why nothing can be written at the moment.
    pub trouble: Option<String>,
    /// There was trouble, now or before.
    pub had_trouble: bool,
    /// Bytes of the line that are in the recording.
    pub recorded: u64,
    /// Bytes of the line that are missing in it.
    pub lost: u64,
    /// Bytes of memory of what waits to be written.
    pub waiting: usize,
}

/// What the thread and its callers share.
#[derive(Default)]
struct State {
    items: VecDeque<Item>,
    ports: u32,
    /// Ports of which reads are missing since their last block.
    ports_with_loss: Vec<u32>,
    status: RecorderStatus,
    messages: Vec<String>,
    has_waiter: bool,
    is_closing: bool,
    has_ended: bool,
}

struct Shared {
    state: Mutex<State>,
    /// Signalled when something is queued, and when the thread has written it.
    changed: Condvar,
    memory: usize,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State>, timeout: Duration) -> MutexGuard<'a, State> {
        self.changed.wait_timeout(state, timeout).unwrap_or_else(PoisonError::into_inner).0
    }
}

/// Writes reads of ports to a raw recording, in a thread of its own. Nothing here waits for the disk but `flush` and
/// `close`.
pub struct Recorder {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Recorder {
    /// Creates the first file and starts the thread.
    pub fn start(options: RecorderOptions) -> io::Result<Self> {
        let names = Names::new(&options.path, options.rotation != Rotation::Never);
        let mut writer = Writer::new(names, options.application, options.rotation, options.retention);
        writer.open()?;
        let status = RecorderStatus { file: writer.name().to_owned(), ..RecorderStatus::default() };
        let state = State { status, messages: std::mem::take(&mut writer.messages), ..State::default() };
        let shared = Arc::new(Shared { state: Mutex::new(state), changed: Condvar::new(), memory: options.memory });
        let mut worker =
            Worker { shared: Arc::clone(&shared), writer, pending: VecDeque::new(), trouble_since: None, last_time: 0 };
        let thread = std::thread::Builder::new().name("modlens recorder".into()).spawn(move || worker.run())?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Where its reads go.
    pub fn feed(&self) -> Feed {
        Feed::from(self.shared.clone() as Arc<dyn ReadSink>)
    }

    /// How the recording is going.
    pub fn status(&self) -> RecorderStatus {
        self.shared.state().status.clone()
    }

    /// Sentences for the user since the last call: files that have begun, trouble and its end.
    pub fn take_messages(&self) -> Vec<String> {
        std::mem::take(&mut self.shared.state().messages)
    }

    /// Waits until everything is written that was there before the call; false if it is not after `timeout`.
    pub fn flush(&self, timeout: Duration) -> bool {
        let until = Instant::now() + timeout;
        let mut state = self.shared.state();
        while state.status.waiting > 0 || !state.items.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() || state.has_ended {
                return false;
            }
            self.shared.changed.notify_all();
            state = self.shared.wait(state, left.min(BETWEEN_WRITES));
        }
        true
    }

    /// Writes what is waiting and closes the file, waiting for the disk no longer than `timeout`. What the disk does not
    /// take is counted as lost.
    pub fn close(&mut self, timeout: Duration) -> RecorderStatus {
        let until = Instant::now() + timeout;
        let mut state = self.shared.state();
        state.is_closing = true;
        self.shared.changed.notify_all();
        while !state.has_ended {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                state.status.had_trouble = true;
                return state.status.clone();
            }
            state = self.shared.wait(state, left);
        }
        let status = state.status.clone();
        drop(state);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
        status
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.close(RETRY);
    }
}

impl ReadSink for Shared {
    fn add_port(&self, port: RecordedPort) -> u32 {
        let mut state = self.state();
        state.items.push_back(Item::Port(port));
        state.ports += 1;
        state.ports - 1
    }

    /// Records a read of a port. Where memory is full, its bytes are counted as lost, and the next block of the port says
    /// that bytes are missing before it.
    fn write(&self, port: u32, read: &PortRead<'_>) {
        let mut state = self.state();
        let lost = state.ports_with_loss.iter().position(|&one| one == port);
        let block = Block::of(port, &PortRead { hole: read.hole || lost.is_some(), ..*read });
        let cost = cost_of(&block);
        if state.has_ended || state.status.waiting + cost > self.memory {
            state.status.lost += read.bytes.len() as u64;
            if lost.is_none() {
                state.ports_with_loss.push(port);
            }
            return;
        }
        if let Some(at) = lost {
            state.ports_with_loss.swap_remove(at);
        }
        self.push(state, block);
    }

    fn mark_clock_step(&self, port: u32, time: Ns, step: Ns) {
        self.push(self.state(), Block::of_clock_step(port, time, step));
    }
}

impl Shared {
    fn push(&self, mut state: MutexGuard<'_, State>, block: Block) {
        state.status.waiting += cost_of(&block);
        state.items.push_back(Item::Block(block));
        if std::mem::take(&mut state.has_waiter) {
            drop(state);
            self.changed.notify_all();
        }
    }
}

/// The thread.
struct Worker {
    shared: Arc<Shared>,
    writer: Writer,
    /// What was queued and is not written yet.
    pending: VecDeque<Item>,
    trouble_since: Option<Instant>,
    /// The time of the newest block that was written.
    last_time: Ns,
}

impl Worker {
    fn run(&mut self) {
        let mut next_look = Instant::now() + RETRY;
        loop {
            let is_closing = self.take(next_look);
            if Instant::now() >= next_look || is_closing {
                next_look = Instant::now() + RETRY;
                self.look_for_file();
            } else if self.trouble_since.is_some() {
                continue;
            }
            self.write();
            if is_closing {
                return self.end();
            }
            std::thread::sleep(BETWEEN_WRITES);
        }
    }

    /// Waits for items until then and takes them; whether the recording is to end.
    fn take(&mut self, until: Instant) -> bool {
        let shared = Arc::clone(&self.shared);
        let mut state = shared.state();
        let has_trouble = self.trouble_since.is_some();
        while !state.is_closing && (state.items.is_empty() || has_trouble) {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            state.has_waiter = !has_trouble;
            state = shared.wait(state, left);
        }
        state.has_waiter = false;
        self.pending.append(&mut state.items);
        state.is_closing
    }

    /// Begins a new file where the present one has been moved or deleted.
    fn look_for_file(&mut self) {
        let name = self.writer.name().display().to_string();
        if self.writer.check_place() == Place::Deleted {
            let mut state = self.shared.state();
            state.status.had_trouble = true;
            state.messages.push(format!("{name}: the file was deleted, and the recording in it is lost"));
            let ports = state.ports;
            drop(state);
            for port in (0..ports).rev() {
                let block = Block::of(port, &PortRead { time: self.last_time, hole: true, ..PortRead::default() });
                self.shared.state().status.waiting += cost_of(&block);
                self.pending.push_front(Item::Block(block));
            }
        }
    }

    fn write(&mut self) {
        let (mut freed, mut recorded, last) = (0, 0, &mut self.last_time);
        let mut count = |item: &Item| {
            if let Item::Block(block) = item {
                freed += cost_of(block);
                recorded += block.line_bytes;
                *last = block.time;
            }
        };
        let done = self.writer.open().and_then(|()| self.writer.write(&mut self.pending, &mut count));
        let shared = Arc::clone(&self.shared);
        let mut state = shared.state();
        state.status.waiting -= freed;
        state.status.recorded += recorded;
        self.report(&mut state, done);
        drop(state);
        shared.changed.notify_all();
    }

    /// Says that trouble begins or ends.
    fn report(&mut self, state: &mut State, done: io::Result<()>) {
        let files = std::mem::take(&mut self.writer.messages);
        match (done, self.trouble_since) {
            (Ok(()), None) => state.messages.extend(files),
            (Ok(()), Some(since)) => {
                let missing = match state.status.lost {
                    0 => "nothing is missing".to_owned(),
                    lost => format!("{lost} bytes are missing in all"),
                };
                let name = self.writer.name().display();
                state.messages.push(format!("recording again to {name} after {} s; {missing}", since.elapsed().as_secs()));
                (state.status.trouble, self.trouble_since) = (None, None);
            }
            (Err(error), since) => {
                let sentence = format!("{}: {}", self.writer.name().display(), reason(&error));
                if since.is_none() {
                    state.messages.push(format!("{sentence}; the recording waits in memory for it"));
                }
                self.trouble_since = Some(since.unwrap_or_else(Instant::now));
                state.status.had_trouble = true;
                state.status.trouble = Some(sentence);
            }
        }
        self.writer.name().clone_into(&mut state.status.file);
    }

    fn end(&mut self) {
        let mut state = self.shared.state();
        let blocks = self.pending.iter().chain(&state.items);
        let lost: u64 = blocks.map(|item| if let Item::Block(block) = item { block.line_bytes } else { 0 }).sum();
        state.status.lost += lost;
        state.has_ended = true;
        drop(state);
        self.shared.changed.notify_all();
    }
}

/// What a waiting block counts towards the limit of memory.
fn cost_of(block: &Block) -> usize {
    block.bytes.len() + BLOCK_OVERHEAD_BYTES
}

/// What the user can do about an error of a file.
fn reason(error: &io::Error) -> String {
    let words = match error.kind() {
        io::ErrorKind::StorageFull => "no space left",
        io::ErrorKind::QuotaExceeded => "the quota is exhausted",
        io::ErrorKind::FileTooLarge => "the file may not grow further",
        io::ErrorKind::NotFound => "its folder is gone",
        io::ErrorKind::PermissionDenied => "no permission to write it",
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only",
        _ => return format!("cannot be written: {error}"),
    };
    words.to_owned()
}
