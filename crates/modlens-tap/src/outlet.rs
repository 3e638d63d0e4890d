//! Outputs after threads, so that the tap never waits for whoever reads them.
//!
//! A pipe may have a reader that has stopped, a FIFO may have none, a disk may hang: what is written waits in memory
//! instead, and what does not fit there is dropped and counted.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

/// The memory of what nobody has read, in bytes.
const LIMIT: usize = 1 << 24;
/// After a signal, a reader that takes nothing for so long gets no more.
const PATIENCE: Duration = Duration::from_secs(1);
/// What is written at once.
const WRITE_BYTES: usize = 1 << 16;

#[derive(Default)]
struct State {
    blocks: VecDeque<Vec<u8>>,
    /// Bytes that wait, those that are being written among them.
    size: usize,
    written: u64,
    dropped: u64,
    error: Option<io::Error>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An output that a thread writes.
pub struct Outlet {
    shared: Arc<Shared>,
}

impl Outlet {
    /// Starts the thread, which opens the output: to open a FIFO waits for its reader.
    pub fn start(open: impl FnOnce() -> io::Result<File> + Send + 'static) -> io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let ours = Arc::clone(&shared);
        std::thread::Builder::new().name("modlens output".into()).spawn(move || write_all(&ours, open()))?;
        Ok(Self { shared })
    }

    /// Leaves whole lines to the thread. An error of the thread is returned once.
    pub fn write(&self, lines: &[u8]) -> io::Result<()> {
        let mut state = self.shared.state();
        if let Some(error) = state.error.take() {
            return Err(error);
        }
        if state.size + lines.len() > LIMIT {
            state.dropped += lines.len() as u64;
        } else if !lines.is_empty() {
            state.size += lines.len();
            state.blocks.push_back(lines.to_vec());
            self.shared.changed.notify_all();
        }
        Ok(())
    }

    /// Waits until everything is written, or, after a signal, until nothing more is to be expected; returns the bytes that
    /// were dropped.
    pub fn drain(&self, stop: &AtomicBool) -> io::Result<u64> {
        let mut state = self.shared.state();
        while state.size > 0 && state.error.is_none() {
            let before = state.written;
            let waited = self
                .shared
                .changed
                .wait_timeout_while(state, PATIENCE, |state| state.size > 0 && state.written == before && state.error.is_none());
            let timed_out;
            (state, timed_out) = waited.unwrap_or_else(PoisonError::into_inner);
            if timed_out.timed_out() && stop.load(Ordering::Relaxed) {
                break;
            }
        }
        match state.error.take() {
            Some(error) => Err(error),
            None => Ok(state.dropped + state.size as u64),
        }
    }
}

/// The thread. After an error it ends, and a file ends with the last whole block.
fn write_all(shared: &Shared, out: io::Result<File>) {
    let done = out.and_then(|mut out| loop {
        let mut state = shared.state();
        while state.blocks.is_empty() {
            state = shared.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        let block = state.blocks.pop_front().unwrap_or_default();
        drop(state);
        let regular = out.metadata().ok().filter(std::fs::Metadata::is_file);
        for part in block.chunks(WRITE_BYTES) {
            if let Err(error) = out.write_all(part) {
                if let Some(before) = regular {
                    let _ = out.set_len(before.len());
                }
                return Err::<(), _>(error);
            }
            let mut state = shared.state();
            state.size -= part.len();
            state.written += part.len() as u64;
            shared.changed.notify_all();
        }
    });
    shared.state().error = done.err();
    shared.changed.notify_all();
}

/// Standard error.
static MESSAGES: OnceLock<Option<Outlet>> = OnceLock::new();

/// Reports the user something, on standard error. Where that is not possible there is nobody to tell.
pub fn say(text: &str) {
    let open = || Ok(File::from(rustix::io::dup(rustix::stdio::stderr())?));
    if let Some(outlet) = MESSAGES.get_or_init(|| Outlet::start(open).ok()) {
        let _ = outlet.write(format!("{text}\n").as_bytes());
    }
}

/// Waits for the reader of standard error.
pub fn drain_messages(stop: &AtomicBool) {
    if let Some(Some(outlet)) = MESSAGES.get() {
        let _ = outlet.drain(stop);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_nobody_reads_is_bounded_counted_and_given_up_after_a_signal() {
        let (reader, writer) = io::pipe().unwrap();
        let outlet = Outlet::start(move || Ok(File::from(std::os::fd::OwnedFd::from(writer)))).unwrap();
        let block = vec![b'x'; 1 << 20];
        for _ in 0..20 {
            outlet.write(&block).unwrap();
        }
        let begun = std::time::Instant::now();
        let dropped = outlet.drain(&AtomicBool::new(true)).unwrap();
        assert!(begun.elapsed() < 3 * PATIENCE);
        // A pipe takes 64 KiB by itself.
        assert!(dropped > 19 << 20, "{dropped}");
        drop(reader);
    }

    #[test]
    fn an_error_is_returned_once() {
        let outlet = Outlet::start(|| Err(io::ErrorKind::NotFound.into())).unwrap();
        assert!(outlet.write(b"a\n").and_then(|()| outlet.drain(&AtomicBool::new(false)).map(drop)).is_err());
        assert!(outlet.write(b"b\n").is_ok());
    }
}
