//! The thread of a port: waits for bytes, reads them, takes the time. It cannot write to the port.

use std::io::PipeReader;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::thread::JoinHandle;

use modlens_readers::pace::ReadPacer;
use modlens_readers::parmrk::ParmrkDecoder;
use rustix::event::{poll, PollFd, PollFlags};
use rustix::io::Errno;

use crate::clock::monotonic_ns;
use crate::queue::{Arrived, Shared};

/// The most bytes of one read.
const MAX_READ_BYTES: usize = 4096;

/// Starts the thread of a port. It gets a duplicate of the descriptor, so that closing `fd` does not affect it.
pub fn start(
    shared: Arc<Shared>,
    port: usize,
    fd: BorrowedFd<'_>,
    stop: PipeReader,
    marked: bool,
) -> std::io::Result<JoinHandle<()>> {
    let file = fd.try_clone_to_owned()?;
    let decoder = marked.then(ParmrkDecoder::default);
    let run = move || {
        #[cfg(target_os = "linux")]
        crate::priority::raise();
        if let Some(error) = listen(&shared, port, &file, &stop, decoder) {
            shared.push(port, monotonic_ns(), Arrived::End(error));
        }
    };
    std::thread::Builder::new().name(format!("modlens port {port}")).spawn(run)
}

/// Reads until the port ends (returns the number of the error, 0 for none) or until it is stopped (returns `None`).
fn listen(shared: &Shared, port: usize, file: &OwnedFd, stop: &PipeReader, mut decoder: Option<ParmrkDecoder>) -> Option<u32> {
    let mut buffer = [0u8; MAX_READ_BYTES];
    let mut pace = ReadPacer::default();
    loop {
        let mut ready = [PollFd::new(file, PollFlags::IN), PollFd::from_borrowed_fd(stop.as_fd(), PollFlags::IN)];
        match poll(&mut ready, None) {
            Err(Errno::INTR) => continue,
            Err(error) => return Some(error.raw_os_error().unsigned_abs()),
            Ok(_) => {}
        }
        // What has arrived before the stop is still read.
        let is_stopped = !ready[1].revents().is_empty();
        if is_stopped && ready[0].revents().is_empty() {
            return None;
        }
        let length = match rustix::io::read(file, &mut buffer) {
            Err(Errno::INTR | Errno::AGAIN) if !is_stopped => continue,
            Err(Errno::INTR | Errno::AGAIN) => return None,
            Err(error) => return Some(error.raw_os_error().unsigned_abs()),
            Ok(0) => return Some(0),
            Ok(length) => length,
        };
        let time = monotonic_ns();
        let (mut bytes, mut errors) = (Vec::with_capacity(length), Vec::new());
        match &mut decoder {
            Some(decoder) => decoder.push(&buffer[..length], &mut bytes, &mut errors),
            None => bytes.extend_from_slice(&buffer[..length]),
        }
        let sleep = pace.sleep_after(length, time, shared.char_ns(port));
        if !bytes.is_empty() {
            shared.push(port, time, Arrived::Bytes { bytes, errors, reader_sleeps: !sleep.is_zero() });
        }
        if is_stopped {
            return None;
        }
        if !sleep.is_zero() {
            std::thread::sleep(sleep);
        }
    }
}
