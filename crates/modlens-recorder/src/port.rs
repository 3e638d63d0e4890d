//! What a live run needs of a port, and what its errors mean.

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::sync::Arc;

use modlens_protocol::line::LineSettings;

use crate::inbox::Inbox;

/// Counts of a driver, by the name of the counter.
pub type Counts = BTreeMap<String, u64>;

/// An open port, which is only read. Dropping it closes it.
pub trait Port: Send {
    /// Starts to queue what arrives, as reads of this port.
    fn listen(&mut self, inbox: &Arc<Inbox>, number: usize) -> Result<(), String>;

    /// Changes the line settings while the port is read.
    fn set_line(&mut self, line: LineSettings) -> Result<(), String>;

    /// Whether it has line settings at all: raw TCP has none.
    fn takes_line_settings(&self) -> bool {
        true
    }

    /// Whether the driver marks bytes with line errors (PARMRK, termios(3)).
    fn marks_errors(&self) -> bool {
        false
    }

    /// The line settings, where the port knows them because another program reads the line.
    fn line(&self) -> Option<LineSettings> {
        None
    }

    /// The driver's counts of damaged and lost bytes since the system started; empty where it has none.
    fn counters(&self) -> Counts {
        Counts::new()
    }

    /// Whether its reads are those of both lines of a bus: those of line A have its number, those of B the next one.
    fn has_two_lines(&self) -> bool {
        false
    }

    /// What limits the resolution of its times or its passivity, and what to do about it; empty where nothing does.
    fn advice(&self) -> String {
        String::new()
    }

    /// Ends a thread of its own, if it has one; what that has read stays in the inbox.
    fn stop(&mut self) {}
}

/// Opens a port by its name. Without settings they are not known yet.
pub type Opener = Box<dyn FnMut(&str, Option<LineSettings>) -> Result<Box<dyn Port>, String> + Send>;

/// Why a port cannot be used, and what the user can do about it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortError {
    /// The name of the port.
    pub port: String,
    /// The reason.
    pub reason: String,
}

impl fmt::Display for PortError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: {}", self.port, self.reason)
    }
}

/// What the user can do about an error of the system, by its number as on this system.
pub fn advice(number: i32, line: Option<LineSettings>) -> Option<String> {
    let error = io::Error::from_raw_os_error(number);
    let text = match (error.kind(), line) {
        (io::ErrorKind::NotFound, _) => "no such port; check the name and the cable; modlens ports lists those that are here",
        (io::ErrorKind::PermissionDenied, _) => "no permission to open it; on Linux join its group (often dialout), log in again",
        (io::ErrorKind::ResourceBusy | io::ErrorKind::WouldBlock, _) => "the port is in use by another program; close it first",
        (io::ErrorKind::IsADirectory, _) => "a directory, not a serial port",
        (io::ErrorKind::ConnectionRefused, _) => "the connection was refused; check address and port number",
        (io::ErrorKind::InvalidInput, Some(line)) => return Some(format!("the port does not take the settings {line}")),
        _ => return system_advice(number),
    };
    Some(text.to_owned())
}

/// Like `advice`, for errors that Rust's library has no name for.
fn system_advice(number: i32) -> Option<String> {
    #[cfg(unix)]
    {
        use rustix::io::Errno;
        if number == Errno::NOTTY.raw_os_error() {
            return Some("not a serial port; use `modlens decode` for recordings".into());
        }
        if number == Errno::IO.raw_os_error() {
            return Some("the port was lost; was the adapter unplugged?".into());
        }
    }
    let _ = number;
    None
}

/// The reason for an error of the system.
pub fn reason(error: &io::Error, line: Option<LineSettings>) -> String {
    let known = error.raw_os_error().and_then(|number| advice(number, line));
    known.unwrap_or_else(|| format!("the port cannot be used: {error}"))
}

/// The reason for the end of a port, from the number of the system's error (0 where it is not known).
pub fn loss_reason(number: u32) -> String {
    let known = (number != 0).then(|| advice(number as i32, None)).flatten();
    known.unwrap_or_else(|| "the port was lost; was the adapter unplugged?".into())
}
