//! The engine: input, framer, pairing, findings, statistics and rows of all buses, after one `feed`.
//!
//! | question | file |
//! |--|--|
//! | what a source feeds: bytes and time, text, captures, logic samples | `feed`, `text`, `capture` (`in_turn`), `logic` (state: `sources`) |
//! | how another thread reads a text or a capture for it | `read_ahead` |
//! | what is known of a bus and of a line | `bus`, `line`, `profiles` |
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

pub(crate) mod bus;
mod capture;
mod closing;
pub(crate) mod connection_tally;
mod connections;
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
mod text;
mod transactions;
mod two_lines;
mod unit_habits;

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::findings::Found;
use crate::framer::Framer;
use crate::pairing::{Pairing, PendingTransaction};
use crate::records::{Batch, Buses, MemoryPool};
use crate::session::exchanges::piece_run::{PieceRun, PieceTries};
use crate::stats::Stats;
use modlens_profiles::points::Plan;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;

pub use bus::BusOptions;
pub use read_ahead::{LentReader, ReadBlock};
pub use sources::CaptureOptions;

use bus::BusState;
use connections::Connections;
use held_rows::PendingRows;
use profiles::{Assignment, Profiles};
use sources::{CaptureState, LogicState};

/// The tables to build.
#[derive(Clone, Copy, Debug)]
pub struct WantedTables {
    /// Frames.
    pub frames: bool,
    /// Transactions.
    pub transactions: bool,
    /// Findings.
    pub findings: bool,
}

/// The engine: bytes and times in, rows out. No I/O, no clock, no failure on bytes.
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
    pub(crate) functions: Arc<Functions>,
    pub(crate) buses: Vec<BusState>,
    /// The buses whose source has not ended; see `close_bus`.
    open: BTreeSet<usize>,
    /// For each bus, what its rows share.
    bus_rows: Arc<Buses>,
    /// The rows emitted since the last `take`, without the transactions.
    pub(crate) batch: Batch,
    /// Memory of batches that were dropped.
    pool: MemoryPool,
    pub(crate) held: PendingRows,
    /// How many of them the last `take` has kept.
    kept: usize,
    pub(crate) wanted: WantedTables,
    pub(crate) live: bool,
    /// Whether compact exchanges may be emitted even where frames are wanted.
    always_compact: bool,
    /// The timeout of requests that the user has set.
    timeout: Option<Ns>,
    pub(crate) next_frame: u64,
    pub(crate) next_txn: u64,
    /// When the recording began.
    pub(crate) origin: Option<Ns>,
    pub(crate) stats: Stats,
    assignments: Vec<Assignment>,
    /// Scratch: unit and PDU of the frame at hand.
    adu: Vec<u8>,
    /// Scratch of the fast path: unit and PDU of a request and of its response.
    pub(crate) adus: [Vec<u8>; 2],
    /// Scratch: transactions that are closed and not emitted yet.
    done: Vec<Box<PendingTransaction>>,
    /// Scratch: findings on the frame or transaction at hand.
    found: Found,
    /// Scratch: their codes.
    codes: Vec<Finding>,
    captures: Vec<Option<CaptureState>>,
    logics: Vec<Option<LogicState>>,
    /// Buses of closed connections. Rows that are held may still name them.
    retired: Vec<usize>,
    /// Buses of closed connections that a new connection may take.
    free: Vec<usize>,
    connections: Connections,
    /// The connection or log of which packets or lines are matched as they come.
    pub(crate) piece_run: Option<Box<PieceRun>>,
    /// When to look again whether the lines of a log may be.
    pub(crate) piece_tries: PieceTries,
    /// The bus with bytes that `feed_later` has left undecided.
    pub(crate) waiting: Option<usize>,
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
    /// A session with this table of functions. A `live` one emits transactions in the order of completion, any other in
    /// the order of requests. `timeout` is that of requests; it is learned where `None`.
    pub fn new(functions: Arc<Functions>, wanted: WantedTables, live: bool, timeout: Option<Ns>) -> Self {
        let pool = MemoryPool::default();
        Self {
            functions,
            buses: Vec::new(),
            open: BTreeSet::new(),
            bus_rows: Arc::default(),
            batch: pool.batch(),
            pool,
            held: PendingRows::new(live),
            kept: 0,
            wanted,
            live,
            always_compact: false,
            timeout,
            next_frame: 1,
            next_txn: 1,
            origin: None,
            stats: Stats::default(),
            assignments: Vec::new(),
            adu: Vec::new(),
            adus: <[Vec<u8>; 2]>::default(),
            done: Vec::new(),
            found: Vec::new(),
            codes: Vec::new(),
            captures: Vec::new(),
            logics: Vec::new(),
            retired: Vec::new(),
            free: Vec::new(),
            connections: Connections::default(),
            piece_run: None,
            piece_tries: PieceTries::default(),
            waiting: None,
            recorded: Vec::new(),
            bus_name: None,
        }
    }

    /// Emits compact exchanges of an RTU line without a clock (`Batch::exchanges`) even where frames are wanted: for who can do
    /// without the rows of their frames.
    pub fn emit_compact(&mut self) {
        self.always_compact = true;
    }

    /// Whether this bus emits compact exchanges from now on: in a recording of one RTU line without times, where a
    /// frame is known by its offset. With another bus open, a transaction may have to wait for an older one while exchanges
    /// after it are returned.
    pub(crate) fn emits_compact(&self, bus: usize) -> bool {
        let state = &self.buses[bus];
        (self.always_compact || !self.wanted.frames)
            && !self.live
            && !state.lines[0].1.input.has_times
            && state.options.bus.place == Place::Offset
            && self.open.len() == 1
            && self.open.contains(&bus)
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
        let line = self.buses[bus].line(line);
        line.input.begin_at(offset);
        line.framer.skip_to(offset);
    }

    /// Adds a bus with counters of its own and the profiles bound to its name so far; buses are numbered from 0, and the
    /// number is given back.
    pub fn add_bus(&mut self, mut options: BusOptions) -> usize {
        options.bus.line = options.line;
        Arc::make_mut(&mut self.bus_rows).push(options.bus.clone());
        let counts = self.stats.add_bus(&options.bus.name);
        let profiles = Profiles::of_bus(&self.assignments, &options.bus.name);
        self.buses.push(BusState::new(options, Pairing::new(self.timeout, self.live), counts, profiles));
        self.open.insert(self.buses.len() - 1);
        self.buses.len() - 1
    }

    /// Gives a profile to units, on one bus (by its name) or on all; the last one wins. It holds for buses that are added
    /// later.
    pub fn bind(&mut self, bus: Option<&str>, units: &[u8], plan: &Arc<Plan>) {
        let plan = Arc::clone(plan);
        self.assignments.push(Assignment { bus: bus.map(str::to_owned), units: units.to_vec(), plan });
    }

    /// Sets the clock of a bus and the unit of its places, once its source has shown them.
    pub fn describe_bus(&mut self, bus: usize, clock: Clock, place: Place) {
        let row = &mut Arc::make_mut(&mut self.bus_rows)[bus];
        (row.clock, row.place) = (clock, place);
        self.buses[bus].options.bus = row.clone();
    }

    /// The framing of a bus, as far as it is known.
    pub fn mode(&self, bus: usize) -> Option<Mode> {
        self.buses[bus].lines.first().map(|(_, state)| state.framer.mode())
    }

    /// Statistics so far.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Statistics so far as JSON; analyzer/views/stats.py has the keys.
    pub fn stats_json(&self) -> serde_json::Value {
        self.stats.json(&self.functions)
    }

    /// Number of rows that `take` would return.
    pub fn pending_rows(&self) -> usize {
        self.batch.frames.len() + self.batch.findings.len() + self.batch.exchanges.len() + self.held.len()
    }

    /// The rows emitted since the last call.
    ///
    /// Rows of transactions that `give_out_rows` does not release are kept for a later call; their bytes move to the next batch.
    /// Buses of closed connections that no kept row names become free. Where many rows are kept, the batch may be empty until
    /// about as many new ones have come: on a connection a request without a response keeps those of half a minute.
    pub fn take(&mut self) -> Batch {
        if self.waits_for_more() {
            let mut nothing = Batch::default();
            (nothing.buses, nothing.functions) = (Arc::clone(&self.bus_rows), Some(Arc::clone(&self.functions)));
            return nothing;
        }
        let mut batch = std::mem::replace(&mut self.batch, self.pool.batch());
        self.give_out_rows(&mut batch);
        self.kept = self.held.len();
        self.copy_held_bytes(&batch);
        self.release_buses();
        batch.connections = self.connections.take(self.live);
        batch.buses = Arc::clone(&self.bus_rows);
        batch.functions = Some(Arc::clone(&self.functions));
        batch
    }
}
