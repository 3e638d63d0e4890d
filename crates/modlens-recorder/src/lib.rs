//! Listens to live ports: opens them, reads them, records what was read, and feeds the engine.
//!
//! - [`LiveRun`] is the loop of every tap. It opens ports, finds line settings by listening, feeds the engine, and waits for
//!   ports that are lost. It is the same for the command in Python and for `modlens-tap`.
//! - [`Inbox`] has a thread per port that only waits for bytes, reads them, takes the time and queues them. What does not fit
//!   into the queue is counted, and the next read says so.
//! - [`Recorder`] has a thread that writes the same reads to a raw recording (pcapng, `modlens_pcapng::recording`), with
//!   rotation and retention. The inbox hands it every read before the loop can see it. While the disk is full or the folder
//!   is gone, reads wait in its memory; what does not fit is counted, and the place is marked in the recording.
//!
//! - [`Server`] passes the same reads on to other programs over TCP, as a stream of pcapng, and [`Remote`] is the port that
//!   reads such a stream.
//!
//! So bytes are on their way to the disk before anything is decoded, and a loop that stands still costs rows, not bytes.
//!
//! ```no_run
//! # #[cfg(target_os = "linux")]
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use modlens_engine::records::Bus;
//! use modlens_engine::session::{BusOptions, Session, WantedTables};
//! use modlens_protocol::source::{Clock, Place};
//! use modlens_recorder::{LiveOptions, LiveRun, Recorder, RecorderOptions, TappedBus, Tty};
//! use std::time::Duration;
//!
//! let wanted = WantedTables { frames: false, transactions: true, findings: false };
//! let mut session = Session::new(Default::default(), wanted, true, None);
//! let (name, source) = ("boiler".into(), "/dev/ttyUSB0".into());
//! let bus = Bus { name, source, place: Place::Offset, clock: Clock::Utc, line: None, network: None };
//! let options = BusOptions { bus, mode: None, line: None, resolution: None, rule: None };
//! let buses = vec![TappedBus { ports: vec!["/dev/ttyUSB0".into()], options }];
//! let opener = Box::new(|name: &str, line| Ok(Box::new(Tty::open(name, line)?) as _));
//! let mut run = LiveRun::open(buses, opener, LiveOptions::default(), &mut session).map_err(|error| error.to_string())?;
//! let recorder = Recorder::start(RecorderOptions::new("/var/lib/bus.pcapng"))?; // fails where it cannot be created
//! run.record(recorder.feed());
//! loop {
//!     run.step(&mut session, Duration::from_millis(50)).map_err(|error| error.to_string())?;
//!     let batch = session.take(); // the rows that were decided
//!     for line in run.take_messages().into_iter().chain(recorder.take_messages()) { eprintln!("{line}"); }
//!     # drop(batch);
//! }
//! # }
//! # #[cfg(not(target_os = "linux"))]
//! # fn main() {}
//! ```
//!
//! At the end: [`LiveRun::finish`], take what is left, then [`Recorder::close`], which waits for the disk no longer than it is
//! told. A program with a recorder ignores `SIGXFSZ`, as Python does, or a limit of the file size ends it.
//!
//! Times are UTC in nanoseconds and come from [`Clock`]: the monotonic clock, mapped to the wall clock. Where somebody sets
//! the wall clock, it is followed at the next pause of the line, or after [`clock::MAX_DELAY_NS`] on a line that never
//! pauses; the recording marks the place.

pub mod clock;
#[cfg(target_os = "linux")]
mod driver;
mod feed;
mod inbox;
mod live;
mod port;
#[cfg(target_os = "linux")]
mod priority;
mod queue;
#[cfg(unix)]
mod reader;
mod recorder;
mod remote;
mod segments;
mod serve;
#[cfg(target_os = "linux")]
mod tty;
mod writer;

pub use clock::{Clock, ClockChange};
#[cfg(target_os = "linux")]
pub use driver::latency_timer;
pub use feed::{Feed, ReadSink};
pub use inbox::Inbox;
pub use live::{LiveOptions, LiveRun, LiveStatus, Origin, TappedBus, IDLE_NS};
pub use port::{advice, Counts, Opener, Port, PortError};
pub use queue::Read;
pub use recorder::{Recorder, RecorderOptions, RecorderStatus};
pub use remote::{Remote, SCHEME as REMOTE_SCHEME};
pub use segments::{RecordedPort, Retention, Rotation};
pub use serve::{Server, ServerOptions};
#[cfg(target_os = "linux")]
pub use tty::Tty;
