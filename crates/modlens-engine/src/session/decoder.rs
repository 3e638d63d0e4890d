//! The buses of a session with their state, and the rows that their bytes become.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::findings::{self, Found};
use crate::pairing::{Pairing, PendingTransaction};
use crate::records::{Batch, Buses};
use crate::session::bus::{BusOptions, BusState, FROM_CLIENT, FROM_SERVER};
use crate::session::exchanges::message_run::MessageTries;
use crate::session::exchanges::message_runs::MessageRuns;
use crate::session::held_rows::PendingRows;
use crate::session::profiles::{Assignment, Profiles};
use crate::session::rows::FindingPlace;
use crate::stats::Stats;
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::Functions;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};
use modlens_readers::pcap::StreamChunk;

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

/// Decodes what comes in on the buses of a session. It knows no source.
pub(crate) struct Decoder {
    pub(crate) functions: Arc<Functions>,
    pub(crate) buses: Vec<BusState>,
    /// The buses whose source has not ended; see `close_bus`.
    pub(super) open: BTreeSet<usize>,
    /// For each bus, what its rows share.
    pub(super) bus_rows: Arc<Buses>,
    /// The rows emitted since the last `take`, without the transactions.
    pub(crate) batch: Batch,
    pub(crate) held: PendingRows,
    pub(crate) wanted: WantedTables,
    pub(crate) live: bool,
    /// Whether compact exchanges may be emitted even where frames are wanted.
    pub(super) always_compact: bool,
    /// The timeout of requests that the user has set.
    pub(super) timeout: Option<Ns>,
    pub(crate) next_frame: u64,
    pub(crate) next_txn: u64,
    /// When the recording began.
    pub(crate) origin: Option<Ns>,
    pub(crate) stats: Stats,
    pub(super) assignments: Vec<Assignment>,
    /// Scratch: unit and PDU of the frame at hand.
    pub(super) adu: Vec<u8>,
    /// Scratch of the fast path: unit and PDU of a request and of its response.
    pub(crate) adus: [Vec<u8>; 2],
    /// Scratch: transactions that are closed and not emitted yet.
    pub(super) done: Vec<Box<PendingTransaction>>,
    /// Scratch: findings on the frame or transaction at hand.
    pub(super) found: Found,
    /// Scratch: their codes.
    pub(super) codes: Vec<Finding>,
    /// The connections and logs of which packets or lines are matched as they come.
    pub(crate) message_runs: MessageRuns,
    /// When to look again whether the lines of a log may be.
    pub(crate) message_tries: MessageTries,
    /// The bus with bytes that `feed_later` has left undecided.
    pub(crate) waiting: Option<usize>,
}

impl Decoder {
    pub(super) fn new(functions: Arc<Functions>, wanted: WantedTables, live: bool, timeout: Option<Ns>, batch: Batch) -> Self {
        Self {
            functions,
            buses: Vec::new(),
            open: BTreeSet::new(),
            bus_rows: Arc::default(),
            batch,
            held: PendingRows::new(live),
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
            message_runs: MessageRuns::default(),
            message_tries: MessageTries::default(),
            waiting: None,
        }
    }

    /// Returns whether this bus emits compact exchanges from now on: in a recording of one RTU line without times, where a
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

    /// Adds a bus with counters of its own and the profiles bound to its name so far; buses are numbered from 0, and the
    /// number is returned.
    pub(super) fn add_bus(&mut self, mut options: BusOptions) -> usize {
        options.bus.line = options.line;
        Arc::make_mut(&mut self.bus_rows).push(options.bus.clone());
        let counts = self.stats.add_bus(&options.bus.name);
        let profiles = Profiles::of_bus(&self.assignments, &options.bus.name);
        let mut state = BusState::new(options, Pairing::new(self.timeout, self.live), counts, profiles);
        state.begins_inside = self.live;
        self.buses.push(state);
        self.open.insert(self.buses.len() - 1);
        self.buses.len() - 1
    }

    /// Sets the clock of a bus and the unit of its places, once its source has shown them.
    pub(super) fn describe_bus(&mut self, bus: usize, clock: Clock, place: Place) {
        let row = &mut Arc::make_mut(&mut self.bus_rows)[bus];
        (row.clock, row.place) = (clock, place);
        self.buses[bus].options.bus = row.clone();
    }

    /// Notes whether the server's side of a connection is recorded, which its next bytes depend on. A change has what was fed
    /// before decided first.
    #[inline]
    pub(super) fn note_recorded_side(&mut self, bus: usize, is_recorded: bool) {
        if self.buses[bus].pairing.response_side_recorded != is_recorded {
            self.decide_waiting();
        }
        self.buses[bus].pairing.response_side_recorded = is_recorded;
    }

    /// Takes bytes of a connection, in order. `missing` bytes in front of them are a finding on the connection; they may have
    /// held the responses to the open requests, so that their silence proves nothing, but these stay open.
    #[inline]
    pub(super) fn take_packet(&mut self, bus: usize, from_client: bool, received: &StreamChunk<'_>, is_whole_message: bool) {
        if received.missing > 0 {
            self.decide_waiting();
            self.buses[bus].pairing.note_missing_bytes();
            let finding = findings::connection::missing_bytes(received.missing, received.packet);
            self.emit_connection_finding(bus, finding, received.packet, received.time);
        }
        let chunk = Chunk {
            bytes: received.bytes,
            line: if from_client { FROM_CLIENT } else { FROM_SERVER },
            times: received.time.map_or(Times::None, Times::Read),
            side: Some(if from_client { Side::Sent } else { Side::Received }),
            starts_record: is_whole_message,
            follows_loss: received.missing > 0,
            origin: received.packet,
            ..Chunk::default()
        };
        if !self.take_message(bus, &chunk) {
            self.feed_message(bus, &chunk);
        }
    }

    /// Emits a finding that is about a connection, not about one of its frames; it is placed at the packet, `time` in ns. It
    /// is counted in any case, but gets a row only if findings are wanted.
    pub(super) fn emit_connection_finding(
        &mut self,
        bus: usize,
        (finding, detail): (Finding, String),
        packet: u64,
        time: Option<Ns>,
    ) {
        self.buses[bus].connection.note_finding(finding);
        self.stats.finding(finding);
        if self.wanted.findings {
            let recording_start = self.origin;
            let place = FindingPlace { frame: None, txn: None, bus, start: time, recording_start, unit: None, origin: packet };
            self.batch.findings.push(place.row(finding, detail));
        }
    }
}
