//! Reads recordings in text form: lines go in, bytes with timestamps come out.
//!
//! A dialect is a row of analyzer/sources/dialects.toml (`dialect`). Its templates (`template`) find bytes written in a
//! certain notation (`notation`) and timestamps (`timestamps`, `date`) in a line. `reader` applies the templates line by line,
//! `entries` assembles the bytes of one or several lines into entries and drops printed duplicates, `detect` chooses the
//! rows that a text needs, and `foreign_protocols` names the protocol of a text that is not Modbus, `foreign_texts` its
//! format. All that this module knows
//! about Modbus is how to verify that a run of bytes is a whole frame (`frame_evidence`).
//!
//! Lines that no row can read are read by what checksums prove in them (`proved`). What is left is counted, and the lines
//! that hold most hex are kept as examples, so that nothing is dropped silently.

mod anchors;
mod cached_second;
mod chunk_log;
mod clean;
mod clock;
mod date;
mod decimal;
pub mod detect;
mod dialect;
mod direction_words;
mod encapsulation;
mod entries;
pub mod foreign_protocols;
mod foreign_texts;
mod frame_evidence;
mod header_run;
mod json_times;
mod notation;
mod oddities;
mod prefix;
mod proved;
mod reader;
mod reports;
mod role;
mod sample;
mod signal;
mod template;
mod ticks;
mod timestamps;

use crate::chunk::Side;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

pub use clock::{day_of, ClockKind, ClockSettings};
pub use dialect::{Dialect, Dialects, TABLE};
pub use entries::SkippedBytes;
pub use reader::{unread_says, Reader, UnreadLines};
pub use reports::Said;

/// What a text log says about one run of bytes. The bytes themselves are returned beside it.
#[derive(Clone, Copy, Debug, Default)]
pub struct LogEntry {
    /// When the bytes were logged; `None` where the log has no timestamp.
    pub time: Option<Ns>,
    /// Who sent the bytes; `None` where the log does not say.
    pub side: Option<Side>,
    /// Which line of a two-line tap they came from: 1 is A, 2 is B, 0 is the only line.
    pub line: u8,
    /// A frame may start here, and none is expected to continue across this place. False for bytes that continue the
    /// entry before.
    pub starts_record: bool,
    /// Bytes are missing from the log before these.
    pub follows_loss: bool,
    /// The bytes are one frame that was printed without its checksum.
    pub lacks_checksum: bool,
    /// The framing that a valid checksum or length proves for these bytes; `None` where none or several do.
    pub proven_framing: Option<Mode>,
    /// Which of several devices the line names: 1 is the first of `Reader::keys`, 0 means that it names none.
    pub key: usize,
    /// Number of the line in the file, from 1.
    pub number: u64,
    /// What the timestamps up to this line show the log's clock to be.
    pub clock: Clock,
}
