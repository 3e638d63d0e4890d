//! The state of sources that the session itself reads: packet captures and recordings of logic analyzers.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::framer::silence::SilenceRule;
use crate::pairing::BufferedFrame;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use modlens_readers::logic::Analyzer;
use modlens_readers::pcap::{Capture, Interface, Ports};

/// Times before March 1973 are not dates: the clock started with the recording.
const MIN_DATE_NS: Ns = 100_000_000 * 1_000_000_000;

/// What the source of a capture knows about it in advance.
#[derive(Clone, Debug)]
pub struct CaptureOptions {
    /// The file, as `source` names it.
    pub source: String,
    /// Where Modbus is looked for.
    pub ports: Ports,
    /// Framing of serial interfaces; detected where `None`.
    pub mode: Option<Mode>,
    /// Line settings of serial interfaces.
    pub line: Option<LineSettings>,
    /// The silences at which RTU frames of serial interfaces end; by evidence where `None`.
    pub rule: Option<SilenceRule>,
}

/// A capture that is being read.
pub(super) struct CaptureState {
    pub(super) options: CaptureOptions,
    /// The file, as the rows of connections share it.
    pub(super) source: Arc<str>,
    pub(super) reader: Capture,
    /// For each slot of the reader's table of connections, the connection in it.
    pub(super) slots: Vec<SlotState>,
    /// The bus of each serial interface.
    pub(super) lines: Vec<Option<usize>>,
    /// So many of the first serial interfaces belong to sections of the file that are over.
    pub(super) ended_lines: usize,
    /// The buses of the section before, which interfaces of the same name go on with.
    pub(super) resumable: Vec<usize>,
    /// Rows that are read back from a capture that modlens wrote.
    pub(super) reimport: ReimportState,
    pub(super) clock: Clock,
    /// The coarsest step of the interfaces' clocks.
    pub(super) resolution: Ns,
    /// When requests of all connections were last given up whose waiting time was over.
    pub(super) last_sweep: Option<Ns>,
}

/// The connection in a slot of the reader's table.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlotState {
    /// Its number, once it has begun.
    pub(super) connection: Option<u64>,
    /// Its bus, once it has turned out to carry Modbus.
    pub(super) bus: Option<usize>,
}

impl CaptureState {
    /// The connection in this slot, which is added if it is new.
    #[inline]
    pub(super) fn slot(&mut self, slot: usize) -> &mut SlotState {
        if self.slots.len() <= slot {
            self.slots.resize(slot + 1, SlotState::default());
        }
        &mut self.slots[slot]
    }

    /// Learns the clock of a capture from the time of a packet, in ns. The first packet that shows it decides its kind: as
    /// the metadata of the port say if modlens wrote the capture, else by whether the time is a date. Its step is the
    /// coarsest of all interfaces so far. The recording begins with the first packet, unless modlens wrote the capture: then
    /// the metadata say when it began.
    #[inline]
    pub(super) fn note_time(&mut self, time: Ns, interface: &Interface, recording_start: &mut Option<Ns>) {
        if self.clock == Clock::None {
            let by_time = if time < MIN_DATE_NS { Clock::Relative } else { Clock::Utc };
            self.clock = interface.written_by_modlens.as_ref().map_or(by_time, |port| port.clock);
        }
        self.resolution = self.resolution.max(interface.resolution);
        if interface.written_by_modlens.is_none() {
            recording_start.get_or_insert(time);
        }
    }

    /// The smallest number of a transaction that is read back and not complete yet.
    pub(super) fn oldest(&self) -> Option<u64> {
        self.reimport.oldest()
    }
}

/// The state of the import of one capture.
#[derive(Debug, Default)]
pub(super) struct ReimportState {
    /// Frame and transaction numbers given before this file, which are added to those in it.
    pub(super) frames_before: u64,
    pub(super) txns_before: u64,
    /// The bus for each name and number of connection (`None` on a serial line).
    pub(super) buses: Vec<((String, Option<u64>), usize)>,
    /// By number, the frames whose transaction is not read yet.
    pub(super) waiting: BTreeMap<u64, WaitingFrame>,
}

/// A frame whose transaction is not read yet.
#[derive(Debug)]
pub(super) struct WaitingFrame {
    pub(super) bus: usize,
    pub(super) txn: u64,
    pub(super) mode: Mode,
    pub(super) adu: Vec<u8>,
    pub(super) frame: BufferedFrame,
    pub(super) direction: Direction,
    /// Findings in its comments that are not on the frame itself: on the transaction, or delayed ones.
    pub(super) other_findings: Vec<(Finding, String)>,
    pub(super) gap: Option<Ns>,
    pub(super) packet: u64,
}

impl ReimportState {
    pub(super) fn new(frames_before: u64, txns_before: u64) -> Self {
        Self { frames_before, txns_before, ..Self::default() }
    }

    /// The smallest number of a transaction of which a frame is read but not the transaction itself.
    pub(super) fn oldest(&self) -> Option<u64> {
        self.waiting.values().map(|waiting| waiting.txn).min()
    }
}

/// One recording of a logic analyzer.
pub(super) struct LogicState {
    pub(super) source: String,
    pub(super) mode: Option<Mode>,
    pub(super) analyzer: Analyzer,
    pub(super) bus: Option<usize>,
}

/// What a capture has shown so far.
#[derive(Clone, Debug)]
pub struct CaptureReport {
    /// Packets so far.
    pub packets: u64,
    /// Packets that were skipped, by reason.
    pub left_out: Vec<(String, u64)>,
    /// The kind of its clock.
    pub clock: Clock,
    /// The step of the clock.
    pub resolution: Ns,
}
