//! Recordings in text: lines in, bytes with times out. Knows nothing of Modbus but its checksums.
//!
//! A dialect is a row of analyzer/sources/dialects.toml (`dialect`), whose templates (`template`) find bytes in lines by a
//! notation (`notation`) and times (`stamp`, `date`). The `reader` goes through lines, `deliver` decides where records
//! begin and what is a printed copy, `detect` which rows a text needs, `suspicion` what it is instead.
//!
//! A line that is no record is counted, and the first three are kept; nothing is dropped in silence.

mod chunks;
mod clean;
mod clock;
mod date;
mod deliver;
pub mod detect;
mod dialect;
mod evidence;
mod front;
mod notation;
mod reader;
mod stamp;
mod starts;
pub mod suspicion;
mod template;
mod unwrap;

use crate::chunk::Side;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

pub use clock::{day_of, ClockSettings, Kind};
pub use dialect::{Dialect, Dialects, TABLE};
pub use reader::{LeftOut, Reader};

/// What one record of a recording is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Record {
    /// When.
    pub time: Option<Ns>,
    /// Who.
    pub side: Option<Side>,
    /// Which line of a two-line tap.
    pub line: u8,
    /// A frame is not expected to reach across its start.
    pub record: bool,
    /// Bytes are missing before it.
    pub hole: bool,
    /// It is one frame, printed without checksum.
    pub no_checksum: bool,
    /// The framing that its bytes prove.
    pub framing: Option<Mode>,
    /// Which of several devices it belongs to: an index of `Reader::keys`, 0 for none.
    pub key: usize,
    /// Line number in the file, from 1.
    pub number: u64,
    /// The clock, as far as the lines up to this one have shown it.
    pub clock: Clock,
}
