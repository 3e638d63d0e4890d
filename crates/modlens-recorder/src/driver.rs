//! Calls to Linux' serial drivers that no library wraps: modem lines, error counters, latency.
//!
//! FTDI chips hold bytes back until their latency timer expires, 16 ms by default. `ASYNC_LOW_LATENCY` makes the kernel set
//! it to 1 ms, and makes other drivers deliver bytes at once.

use std::io;
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};

use rustix::io::Errno;
use rustix::ioctl::{ioctl, Getter, Opcode, Setter, Updater};

use crate::port::Counts;

// Numbers of asm-generic/ioctls.h, which MIPS and PowerPC alone do not share.
const TIOCMBIC: Opcode = 0x5417;
const TIOCGSERIAL: Opcode = 0x541E;
const TIOCSSERIAL: Opcode = 0x541F;
const TIOCGICOUNT: Opcode = 0x545D;

const TIOCM_DTR: i32 = 0x002;
const TIOCM_RTS: i32 = 0x004;
const ASYNC_LOW_LATENCY: i32 = 0x2000;

/// `serial_struct` of linux/serial.h takes at most so many words, of which the fifth has the flags.
const SERIAL_WORDS: usize = 32;
const FLAGS: usize = 4;

/// The words of `serial_icounter_struct` (linux/serial.h).
const COUNTER_WORDS: usize = 20;
/// Those that count damaged or lost bytes.
const COUNTERS: [(&str, usize); 5] = [("frame", 6), ("overrun", 7), ("parity", 8), ("brk", 9), ("buf_overrun", 10)];

/// A longer latency timer, in ms, limits the resolution of times.
const MAX_TIMER_MS: u32 = 2;

/// Lowers DTR and RTS. A port without modem lines is no error.
#[allow(unsafe_code)]
pub fn lower_modem_lines(port: BorrowedFd<'_>) -> io::Result<()> {
    // SAFETY: TIOCMBIC reads an `int` of the modem lines to lower (TIOCM(2const)).
    let done = unsafe { ioctl(port, Setter::<TIOCMBIC, i32>::new(TIOCM_DTR | TIOCM_RTS)) };
    match done {
        Err(Errno::NOTTY | Errno::INVAL | Errno::OPNOTSUPP) => Ok(()),
        done => Ok(done?),
    }
}

/// The driver's error counters since the system started, by name; empty where it has none.
#[allow(unsafe_code)]
pub fn counters(port: BorrowedFd<'_>) -> Counts {
    // SAFETY: TIOCGICOUNT writes a `serial_icounter_struct`, which is twenty `int`s.
    let counts = unsafe { ioctl(port, Getter::<TIOCGICOUNT, [i32; COUNTER_WORDS]>::new()) };
    let Ok(counts) = counts else { return Counts::new() };
    COUNTERS.iter().map(|&(name, at)| (name.to_owned(), u64::from(counts[at] as u32))).collect()
}

/// Asks the driver to deliver bytes at once; what limits the resolution of times afterwards, in words.
pub fn reduce_latency(port: BorrowedFd<'_>, name: &str) -> String {
    set_low_latency(port);
    if latency_timer(name).is_some_and(|timer| timer >= MAX_TIMER_MS) {
        // Only root may.
        let _ = std::fs::write(timer_file(name), "1\n");
    }
    match latency_timer(name) {
        Some(timer) if timer >= MAX_TIMER_MS => format!(
            "the adapter holds bytes back for up to {timer} ms: pauses and response times below {} ms are unreliable; \
             to fix this as root: echo 1 > {}",
            2 * timer,
            timer_file(name).display()
        ),
        _ => String::new(),
    }
}

/// Sets `ASYNC_LOW_LATENCY`, where the driver knows it and the user may.
#[allow(unsafe_code)]
fn set_low_latency(port: BorrowedFd<'_>) {
    let mut settings = [0i32; SERIAL_WORDS];
    // SAFETY: TIOCGSERIAL writes a `serial_struct`, which is shorter than these words.
    let found = unsafe { ioctl(port, Updater::<TIOCGSERIAL, _>::new(&mut settings)) };
    if found.is_ok() && settings[FLAGS] & ASYNC_LOW_LATENCY == 0 {
        settings[FLAGS] |= ASYNC_LOW_LATENCY;
        // SAFETY: TIOCSSERIAL reads a `serial_struct`; this is the one that the kernel has just filled in.
        let _ = unsafe { ioctl(port, Setter::<TIOCSSERIAL, [i32; SERIAL_WORDS]>::new(settings)) };
    }
}

/// Milliseconds for which the adapter may hold bytes back; `None` where it has no such timer.
pub fn latency_timer(name: &str) -> Option<u32> {
    std::fs::read_to_string(timer_file(name)).ok()?.trim().parse().ok()
}

fn timer_file(name: &str) -> PathBuf {
    let path = std::fs::canonicalize(name).unwrap_or_else(|_| name.into());
    Path::new("/sys/class/tty").join(path.file_name().unwrap_or_default()).join("device/latency_timer")
}
