//! The engine: input, framer, pairing, findings, statistics and rows of all buses, after one `feed`.
//!
//! | question | file |
//! |--|--|
//! | the buses, and how rows are made of what comes in on them | `decoder` (`feed`, `frames`, `transactions`, `exchanges`) |
//! | what a source feeds: bytes and time, text, captures, logic samples | `feed`, `text`, `capture` (`in_turn`), `logic` (state: `sources`) |
//! | how another thread reads a text or a capture for it | `read_ahead` |
//! | what is known of a bus and of a line | `bus`, `line`, `profiles` |
//! | what the start of a tap may have cut | `tap_start` |
//! | which line of a two-line tap is next | `two_lines` |
//! | when a frame was on the line, and how exact that is | `frame_timing`, `lateness` |
//! | what nearly all frames of a line have in common | `line_patterns` |
//! | what the responses of a unit have in common | `unit_habits` |
//! | how a frame or a transaction becomes a row | `frames`, `transactions`, `rows` |
//! | which rows wait for older transactions | `held`, `held_rows`, `held_exchanges` |
//! | what is counted of a connection, and how it becomes a row | `connection_tally`, `in_flight`, `connections` |
//! | what is given back when a source has ended | `closing` |
//! | how exchanges are taken on the fast path | `exchanges` |
//! | how rows of our own captures are read back | `reimport` |

// A transaction is large and changes hands three times; moving its box is cheaper than moving it.
#![allow(clippy::vec_box)]

pub(crate) mod answer_order;
pub(crate) mod bus;
mod capture;
mod closing;
pub(crate) mod connection_tally;
mod connections;
mod decoder;
mod exchanges;
mod feed;
pub(crate) mod frame_timing;
mod frames;
mod held;
pub(crate) mod held_exchanges;
mod held_rows;
pub(crate) mod in_flight;
mod in_turn;
pub(crate) mod inner_pauses;
pub(crate) mod lateness;
pub(crate) mod line;
mod line_patterns;
mod logic;
pub(crate) mod profiles;
mod read_ahead;
mod reimport;
pub(crate) mod rows;
mod sources;
mod tap_start;
mod text;
mod transactions;
mod two_lines;
mod unit_habits;

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::framer::Framer;
use crate::records::{Batch, MemoryPool};
use crate::stats::Stats;
use modlens_profiles::points::Plan;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::Chunk;

pub use bus::BusOptions;
pub use decoder::WantedTables;
pub use read_ahead::{BorrowedReader, ReadBlock};
pub use sources::CaptureOptions;

pub use capture::open_connections;
use connections::Connections;
use decoder::Decoder;
use profiles::Assignment;
use sources::{CaptureState, LogicState};

/// The engine: bytes and times in, rows out. No I/O, no clock, no failure on bytes.
///
/// It reads the sources; its `Decoder` has their buses and makes rows of what they bring.
///
/// ```
/// use modlens_engine::session::{BusOptions, Session};
/// use modlens_readers::chunk::Chunk;
/// let mut session = Session::default();
/// let bus = session.add_bus(BusOptions::named("line"));
/// session.feed(bus, &Chunk { bytes: &[0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87], ..Chunk::default() });
/// session.flush();
/// assert_eq!(session.take().frames.len(), 1);
/// ```
pub struct Session {
    pub(crate) decoder: Decoder,
    /// Memory of batches that were dropped.
    pool: MemoryPool,
    /// How many rows of transactions the last `take` has kept.
    kept: usize,
    captures: Vec<Option<CaptureState>>,
    logics: Vec<Option<LogicState>>,
    /// Buses of closed connections. Rows that are held may still name them.
    retired: Vec<usize>,
    /// Buses of closed connections that a new connection may take.
    free: Vec<usize>,
    connections: Connections,
    /// When each server last answered on a connection that is over.
    last_answers: BTreeMap<String, Ns>,
    /// The buses of raw recordings, each with the segment that was read last.
    recorded: Vec<(modlens_readers::pcap::metadata::RecordingSegment, usize)>,
    /// What buses are named after in place of their source.
    bus_name: Option<String>,
}

impl Default for Session {
    fn default() -> Self {
        Self::new(Arc::new(Functions::default()), WantedTables { frames: true, transactions: true, findings: true }, false, None)
    }
}

impl Session {
    /// Returns a session with this table of functions. A `live` one emits transactions in the order of completion, any other in
    /// the order of requests. `timeout` is that of requests; it is learned where `None`.
    pub fn new(functions: Arc<Functions>, wanted: WantedTables, live: bool, timeout: Option<Ns>) -> Self {
        let pool = MemoryPool::default();
        Self {
            decoder: Decoder::new(functions, wanted, live, timeout, pool.batch()),
            pool,
            kept: 0,
            captures: Vec::new(),
            logics: Vec::new(),
            retired: Vec::new(),
            free: Vec::new(),
            connections: Connections::default(),
            last_answers: BTreeMap::new(),
            recorded: Vec::new(),
            bus_name: None,
        }
    }

    /// Emits compact exchanges (`Batch::exchanges`) even where frames are wanted: for who keeps no rows of frames. An RTU line
    /// without a clock has none for them; where there are times, frames are rows beside compact transactions.
    pub fn emit_compact(&mut self) {
        self.decoder.always_compact = true;
    }

    /// Gives a name to buses that would be named after their source: the file is one of several of a bus. A recording that
    /// names its buses itself (the port of a raw recording, the server of a connection) is not touched.
    pub fn name_buses(&mut self, name: String) {
        self.bus_name = Some(name);
    }

    /// The name of a bus that is named after this source.
    fn name_after(&self, source: &str) -> String {
        self.bus_name.clone().unwrap_or_else(|| source.to_owned())
    }

    /// The first byte of a bus will have this offset in its stream: what stood before is not known. No byte has been fed yet.
    pub fn begin_at(&mut self, bus: usize, line: u8, offset: u64) {
        let line = self.decoder.buses[bus].line(line);
        line.input.begin_at(offset);
        line.framer.skip_to(offset);
    }

    /// Adds a bus with counters of its own and the profiles bound to its name so far; buses are numbered from 0, and the
    /// number is returned.
    pub fn add_bus(&mut self, options: BusOptions) -> usize {
        self.decoder.add_bus(options)
    }

    /// Takes bytes of one line of a bus, lets time advance on the bus to that of the chunk, and emits the frames that can be
    /// decided by now. Without a time, only the bytes are decided.
    pub fn feed(&mut self, bus: usize, chunk: &Chunk<'_>) {
        self.decoder.feed(bus, chunk);
    }

    /// Lets time advance to `now` on all buses without bytes, in a live session: silences end frames, open requests time out,
    /// and lines stop waiting for each other.
    pub fn poll(&mut self, now: Ns) {
        self.decoder.poll(now);
    }

    /// Decides everything that is still open, at the end of the recording.
    pub fn flush(&mut self) {
        self.decoder.flush_all(|_| true);
    }

    /// Decides everything that is still open at the end of a file, but for raw recordings, which may go on in the next
    /// file.
    pub fn flush_file(&mut self) {
        let recorded = &self.recorded;
        self.decoder.flush_all(|bus| !recorded.iter().any(|(_, recorded)| *recorded == bus));
    }

    /// Decides everything that is still open on one bus: its recording ends, or a part of it is missing from here on. All
    /// bytes become frames or noise, and all open requests are closed. The bus goes on as usual if further bytes are fed.
    pub fn flush_bus(&mut self, bus: usize) {
        self.decoder.flush_bus(bus);
    }

    /// Gives a profile to units, on one bus (by its name) or on all; the last one wins. It holds for buses that are added
    /// later.
    pub fn bind(&mut self, bus: Option<&str>, units: &[u8], plan: &Arc<Plan>) {
        let plan = Arc::clone(plan);
        self.decoder.assignments.push(Assignment { bus: bus.map(str::to_owned), units: units.to_vec(), plan });
    }

    /// Sets the clock of a bus and the unit of its places, once its source has shown them.
    pub fn describe_bus(&mut self, bus: usize, clock: Clock, place: Place) {
        self.decoder.describe_bus(bus, clock, place);
    }

    /// The framing of a bus, as far as it is known.
    pub fn mode(&self, bus: usize) -> Option<Mode> {
        self.decoder.buses[bus].lines.first().map(|(_, state)| state.framer.mode())
    }

    /// Statistics so far.
    pub fn stats(&self) -> &Stats {
        &self.decoder.stats
    }

    /// Statistics so far as JSON; analyzer/views/stats.py has the keys.
    pub fn stats_json(&self) -> serde_json::Value {
        self.decoder.stats.json(&self.decoder.functions)
    }

    /// Number of rows that `take` would return.
    pub fn pending_rows(&self) -> usize {
        self.decoder.batch.frames.len()
            + self.decoder.batch.findings.len()
            + self.decoder.batch.exchanges.len()
            + self.decoder.held.len()
    }

    /// The rows emitted since the last call.
    ///
    /// Rows of transactions that `give_out_rows` does not release are kept for a later call; their bytes move to the next batch.
    /// Buses of closed connections that no kept row names become free. Where many rows are kept, the batch may be empty until
    /// about as many new ones have come: on a connection a request without a response keeps those of half a minute.
    pub fn take(&mut self) -> Batch {
        if self.waits_for_more() {
            let mut nothing = Batch::default();
            (nothing.buses, nothing.functions) = (Arc::clone(&self.decoder.bus_rows), Some(Arc::clone(&self.decoder.functions)));
            return nothing;
        }
        let mut batch = std::mem::replace(&mut self.decoder.batch, self.pool.batch());
        self.give_out_rows(&mut batch);
        self.kept = self.decoder.held.len();
        self.decoder.held.move_bytes(&batch, &mut self.decoder.batch);
        self.release_buses();
        batch.connections = self.connections.take(self.decoder.live);
        batch.buses = Arc::clone(&self.decoder.bus_rows);
        batch.functions = Some(Arc::clone(&self.decoder.functions));
        batch
    }
}
