//! Reads live ports and records what it reads, without Python and without decoding.
//!
//! Two objects work together, and neither waits for the other or for its caller:
//!
//! - [`Inbox`] has a thread per port that only waits for bytes, reads them, takes the time and queues them. The caller
//!   takes the reads when it has time for them; what does not fit into the queue meanwhile is counted, and the next read
//!   says so.
//! - [`Recorder`] has a thread that writes the same reads to a raw recording (pcapng, `modlens_pcapng::recording`), with
//!   rotation and retention. The inbox hands it every read before the caller can see it. While the disk is full or the
//!   folder is gone, reads wait in its memory; what does not fit is counted, and the place is marked in the recording.
//!
//! So bytes are on their way to the disk before anything is decoded, and a caller that stands still costs rows, not bytes.
//!
//! ```no_run
//! # #[cfg(unix)]
//! # fn main() -> std::io::Result<()> {
//! use modlens_recorder::{Inbox, Recorder, RecorderOptions, RecordedPort, Rotation};
//! use std::os::fd::AsFd;
//! use std::time::Duration;
//!
//! let port = std::fs::File::open("/dev/ttyUSB0")?; // raw mode and line settings are up to the caller
//! let options = RecorderOptions { rotation: Rotation::Bytes(64_000_000), ..RecorderOptions::new("/var/lib/bus.pcapng") };
//! let recorder = Recorder::start(options)?; // fails where the first file cannot be created
//! let inbox = Inbox::new(1 << 24);
//! let at = recorder.add_port(RecordedPort { name: "/dev/ttyUSB0".into(), bus: "boiler".into(), ..RecordedPort::default() });
//! inbox.record(0, recorder.feed(), at);
//! inbox.listen(0, port.as_fd(), false)?; // a copy of the descriptor; true if the driver marks errors (PARMRK)
//! loop {
//!     for read in inbox.take(Duration::from_millis(50), Duration::ZERO) {
//!         match read.bytes {
//!             Some(bytes) => println!("{} {bytes:02x?}", read.time),
//!             None => { inbox.end(read.port); return Ok(()) } // the port is gone: open it, `inbox.hole`, `inbox.listen`
//!         }
//!     }
//!     inbox.check_clocks();
//!     for line in recorder.take_messages() { eprintln!("{line}"); }
//!     if let Some(trouble) = recorder.status().trouble { eprintln!("not recording: {trouble}"); }
//! }
//! # }
//! # #[cfg(not(unix))]
//! # fn main() {}
//! ```
//!
//! At the end: [`Inbox::close`], take what is left, then [`Recorder::close`], which waits for the disk no longer than it is
//! told. A program with a recorder ignores `SIGXFSZ`, as Python does, or a limit of the file size ends it.
//!
//! Times are UTC in nanoseconds and come from [`Clock`]: the monotonic clock, mapped to the wall clock. Where somebody sets
//! the wall clock, it is followed at the next pause of the line, or after [`clock::MAX_DELAY_NS`] on a line that never
//! pauses; the recording marks the place.

pub mod clock;
mod inbox;
mod queue;
#[cfg(unix)]
mod reader;
mod recorder;
mod segments;
mod writer;

pub use clock::{Clock, ClockChange};
pub use inbox::Inbox;
pub use queue::Read;
pub use recorder::{Feed, Recorder, RecorderOptions, RecorderStatus};
pub use segments::{RecordedPort, Retention, Rotation};
