//! The engine behind one `feed`: input, framer, pairing, findings, statistics and rows of all buses.

// A transaction is large and changes hands three times; moving its box is cheaper than moving it.
#![allow(clippy::vec_box)]

mod bus;
mod capture;
mod feed;
mod frame_timing;
mod lateness;
mod logic;
mod profiles;
mod reimport;
mod routine;
mod rows;
mod text;
mod transactions;
mod two_lines;

use std::sync::Arc;

use crate::check;
use crate::framer::silence::Rule;
use crate::framer::Cut;
use crate::input::Input;
use crate::pairing::{ObservedFrame, Pairing, PendingTransaction};
use crate::records::{Batch, Buses, FindingRow, Frame, Span, Spare, Transaction};
use crate::stats::Stats;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;

pub use bus::BusOptions;
pub use capture::CaptureOptions;

use bus::{add_vote, learn, BusState};
use capture::CaptureState;
use frame_timing::{FrameTiming, TimingConfig};
use logic::LogicState;
use profiles::Assignment;
use rows::{elapsed, framing_detail, marked_detail, placed_detail};

/// Transactions that may wait for an older one; beyond it they are written all the same, out of order.
const MAX_HELD_TRANSACTIONS: usize = 65_536;

/// The tables to build.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
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
    functions: Arc<Functions>,
    buses: Vec<BusState>,
    /// For each bus, what its rows share.
    bus_rows: Arc<Buses>,
    /// The rows emitted since the last `take`, without the transactions.
    batch: Batch,
    /// Memory of batches that were dropped.
    spare: Spare,
    /// Rows of transactions. In a recording they wait here for older transactions that are still open.
    held: Vec<Transaction>,
    wanted: Wanted,
    live: bool,
    /// The time-out of requests that the user has set.
    timeout: Option<Ns>,
    next_frame: u64,
    next_txn: u64,
    /// When the recording began.
    origin: Option<Ns>,
    stats: Stats,
    assignments: Vec<Assignment>,
    /// Scratch: unit and PDU of the frame at hand.
    adu: Vec<u8>,
    /// Scratch of the fast path: unit and PDU of a request and of its response.
    adus: [Vec<u8>; 2],
    /// Scratch: the bytes of a record of text.
    text: Vec<u8>,
    /// Scratch: transactions that are closed and not emitted yet.
    done: Vec<Box<PendingTransaction>>,
    /// Scratch: findings on the frame or transaction at hand.
    found: check::Found,
    /// Scratch: their codes.
    codes: Vec<Finding>,
    captures: Vec<Option<CaptureState>>,
    logics: Vec<Option<LogicState>>,
    /// Buses of closed connections. Rows that are held may still name them.
    retired: Vec<usize>,
    /// Buses of closed connections that a new connection may take.
    free: Vec<usize>,
    /// Connections so far.
    connections: u64,
    /// The bus with bytes that `feed_later` has left undecided.
    waiting: Option<usize>,
    /// The buses of raw recordings, each with the segment that was read last.
    recorded: Vec<(modlens_readers::pcap::metadata::RecordingSegment, usize)>,
}

impl Default for Session {
    fn default() -> Self {
        Self::new(Arc::new(Functions::default()), Wanted { frames: true, transactions: true, findings: true }, false, None)
    }
}

impl Session {
    /// A session with this table of functions. A `live` one emits transactions in the order of completion, any other in
    /// the order of requests. `timeout` is that of requests; it is learned where `None`.
    pub fn new(functions: Arc<Functions>, wanted: Wanted, live: bool, timeout: Option<Ns>) -> Self {
        Self {
            functions,
            buses: Vec::new(),
            bus_rows: Arc::default(),
            batch: Batch::default(),
            spare: Spare::default(),
            held: Vec::new(),
            wanted,
            live,
            timeout,
            next_frame: 1,
            next_txn: 1,
            origin: None,
            stats: Stats::default(),
            assignments: Vec::new(),
            adu: Vec::new(),
            adus: <[Vec<u8>; 2]>::default(),
            text: Vec::new(),
            done: Vec::new(),
            found: Vec::new(),
            codes: Vec::new(),
            captures: Vec::new(),
            logics: Vec::new(),
            retired: Vec::new(),
            free: Vec::new(),
            connections: 0,
            waiting: None,
            recorded: Vec::new(),
        }
    }

    /// Adds a bus; they are numbered from 0.
    pub fn add_bus(&mut self, mut options: BusOptions) -> usize {
        options.bus.line = options.line;
        Arc::make_mut(&mut self.bus_rows).push(options.bus.clone());
        let counts = self.stats.add_bus(&options.bus.name);
        let profiles = self.profiles_of(&options.bus.name);
        self.buses.push(BusState::new(options, Pairing::new(self.timeout, self.live), counts, profiles));
        self.buses.len() - 1
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
        self.batch.frames.len() + self.batch.findings.len() + self.held.len()
    }

    /// The rows emitted since the last call.
    ///
    /// In a recording, transactions come in the order of their requests: rows behind an open transaction are kept for a
    /// later call. Transaction numbers are given in that order.
    pub fn take(&mut self) -> Batch {
        let reimported = self.captures.iter().flatten().filter_map(CaptureState::oldest);
        let open = self.buses.iter().filter_map(|bus| bus.pairing.oldest_open_txn());
        let oldest = open.chain(reimported).min().unwrap_or(u64::MAX);
        let mut batch = std::mem::replace(&mut self.batch, self.spare.batch());
        let mut ready = self.held.len();
        if ready <= MAX_HELD_TRANSACTIONS && !self.live {
            if !self.held.is_sorted_by_key(|row| row.number) {
                self.held.sort_by_key(|row| row.number);
            }
            ready = self.held.partition_point(|row| row.number < oldest);
        }
        std::mem::swap(&mut batch.transactions, &mut self.held);
        self.held.extend(batch.transactions.drain(ready..));
        self.copy_held_bytes(&batch);
        self.release_buses();
        batch.buses = Arc::clone(&self.bus_rows);
        batch.functions = Some(Arc::clone(&self.functions));
        batch
    }

    /// Copies the bytes of the transactions that are kept for a later call to the next batch.
    fn copy_held_bytes(&mut self, from: &Batch) {
        for row in &mut self.held {
            row.findings = self.batch.keep_codes(row.findings.of(&from.codes));
            for half in [&mut row.request, &mut row.response] {
                let inside = half.pdu.start.wrapping_sub(half.wire.start);
                let wire = self.batch.keep(half.wire.of(&from.arena));
                half.pdu = if inside < half.wire.length.max(1) {
                    Span { start: wire.start + inside, length: half.pdu.length }
                } else {
                    self.batch.keep(half.pdu.of(&from.arena))
                };
                half.wire = wire;
            }
        }
    }

    /// Emits the next frame of a line, the first `cut.length` bytes of its input: checks and pairs it, adds its rows, and
    /// learns from it. `at` is the index of the line.
    fn emit_frame(&mut self, bus: usize, at: usize, cut: &Cut, adu: &[u8]) {
        let number = self.next_frame;
        self.next_frame += 1;
        let state = &mut self.buses[bus];
        let config = state.timing_config(at);
        state.clock_jumped = false;
        let rule = state.options.rule();
        let input = state.lines[at].1.emission_input();
        let timing = FrameTiming::of(input, cut.length, &config);
        timing.list_inner_packets(input, (number, cut.length), config.place, &mut self.batch.between);
        let wire = &input.bytes()[..cut.length];
        let mut frame = observed(number, wire, adu, cut, &timing, config.mode);
        self.found.clear();
        find_on_frame(&self.functions, input, cut, &frame, (&config, rule), &mut self.found);
        if let Some(rule) = rule.filter(|_| config.has_clock && input.timed && config.mode == Mode::Rtu) {
            count_silence(&mut self.stats, bus, input, &frame, (timing.offset, rule));
        }
        self.codes.clear();
        self.codes.extend(self.found.iter().map(|(finding, _)| *finding));
        frame.codes = &self.codes;
        if let Some(start) = timing.start {
            state.pairing.advance_time(start, &mut self.done);
        }
        let result = state.pairing.add_frame(&self.functions, &frame, &mut self.next_txn, &mut self.done);
        if let Some(finding) = result.finding {
            self.found.push((finding, placed_detail(finding, &result, &frame)));
        }
        let elapsed = elapsed(self.origin, timing.start);
        for (finding, detail) in &self.found {
            self.stats.finding(*finding);
            if self.wanted.findings {
                self.batch.findings.push(FindingRow {
                    frame: Some(number),
                    txn: result.txn,
                    bus: bus as u32,
                    start: timing.start,
                    elapsed,
                    unit: adu.first().copied(),
                    finding: *finding,
                    detail: detail.clone(),
                    origin: timing.origin,
                });
            }
        }
        if self.wanted.frames {
            let codes = self.batch.keep_codes(&self.codes);
            // The finding of pairing, if any, stands behind those on the frame itself.
            self.batch.codes.extend(self.found[self.codes.len()..].iter().map(|(finding, _)| *finding));
            let findings = Span { length: self.found.len() as u32, ..codes };
            let wire = self.batch.keep(wire);
            let row = frame_row(cut, &frame, &timing, wire, findings);
            self.batch.frames.push(Frame { bus: bus as u32, line: state.lines[at].0, elapsed, txn: result.txn, ..row });
        }
        self.stats.frame(state.counts, config.mode, &frame);
        learn(&mut state.known_units, &mut state.side_votes, &frame, timing.side);
        state.consume_frame(at, &self.functions, cut, adu, timing.end);
        if !state.pairing.delayed_findings.is_empty() || !self.done.is_empty() {
            self.emit_transactions(bus);
        }
    }
}

impl BusState {
    /// Removes an emitted frame from the input of its line, and learns from it how late reads come and who speaks there.
    #[inline]
    fn consume_frame(&mut self, at: usize, functions: &Functions, cut: &Cut, adu: &[u8], end: Option<Ns>) {
        let (line_id, line) = &mut self.lines[at];
        if cut.verdict.good() {
            line.lateness.learn(&line.input, cut.length);
            // Line 0 is the only one of its bus. Frames that waited to be merged have voted before.
            if *line_id != 0 && line.unmerged.is_none() && !cut.tentative {
                line.request_votes = add_vote(line.request_votes, functions, adu);
            }
        }
        line.consume(cut.length);
        line.last_end = end.or(line.last_end);
    }
}

/// The frame as pairing and the checks get it; its findings are not known yet.
#[inline]
fn observed<'a>(number: u64, wire: &'a [u8], adu: &'a [u8], cut: &Cut, timing: &FrameTiming, mode: Mode) -> ObservedFrame<'a> {
    ObservedFrame {
        number,
        wire,
        adu,
        verdict: cut.verdict,
        direction: cut.direction,
        mode,
        start: timing.start,
        end: timing.end,
        clean_start: timing.clean_start,
        gap: timing.gap,
        mbap_id: cut.mbap_id,
        origin: timing.origin,
        tentative: cut.tentative,
        codes: &[],
    }
}

/// Adds the findings on a frame itself: its content, its silences, and what receiver, clock and framer report about it.
#[inline]
fn find_on_frame(
    functions: &Functions,
    input: &Input,
    cut: &Cut,
    frame: &ObservedFrame<'_>,
    (config, rule): (&TimingConfig, Option<Rule>),
    found: &mut check::Found,
) {
    check::frame(functions, frame, found);
    check::timing(input, rule, config.resolution, frame, found);
    if input.marked() && input.line_error(0, cut.length) {
        found.push((Finding::LineError, marked_detail(input.errors_in(0, cut.length), cut.length)));
    }
    if input.marked() && input.hole(0, cut.length) {
        found.push((Finding::LostBytes, String::from("the receiver lost bytes before this frame")));
    }
    if config.clock_jumped {
        found.push((Finding::ClockJumped, String::from("this read is older than the one before")));
    }
    if cut.tentative {
        found.push((
            Finding::Tentative,
            String::from("between bytes that are no frames, and the unit was in no paired transaction yet"),
        ));
    }
    if let Some((finding, damage)) = cut.damage.and_then(|damage| Some((damage.finding()?, damage))) {
        found.push((finding, damage.detail()));
    }
    if let Some(finding) = cut.finding {
        found.push((finding, framing_detail(finding, frame.wire)));
    }
}

/// Counts whether a receiver that goes by silences of t3.5 alone would have cut this frame like the framer did: whether
/// there is one before it (or nothing at all), and none inside.
#[inline]
fn count_silence(stats: &mut Stats, bus: usize, input: &Input, frame: &ObservedFrame<'_>, (offset, rule): (u64, Rule)) {
    let is_long = |pause: Option<Ns>| pause.is_some_and(|pause| pause >= rule.t35_ns);
    let before = input.hard_edge(0) || offset == 0 || is_long(input.pause_before(0));
    let inside = is_long(input.longest_pause(0, frame.wire.len()));
    stats.silence(bus, rule.t35_ns, frame, before, inside);
}

/// The row of a frame; bus, line, transaction and time since the beginning are filled in by the caller.
#[inline]
fn frame_row(cut: &Cut, frame: &ObservedFrame<'_>, timing: &FrameTiming, wire: Span, findings: Span) -> Frame {
    let is_frame = cut.verdict != Verdict::Noise;
    let code = frame.adu.get(1).copied().filter(|_| is_frame);
    let is_exception = code.is_some_and(|code| code & EXCEPTION_BIT != 0) && cut.verdict.good();
    Frame {
        number: frame.number,
        bus: 0,
        line: 0,
        offset: timing.offset,
        wire,
        start: timing.start,
        elapsed: None,
        gap: timing.gap,
        mode: frame.mode,
        direction: cut.direction,
        unit: frame.adu.first().copied().filter(|_| is_frame),
        code,
        exception: frame.adu.get(2).copied().filter(|_| is_exception),
        verdict: cut.verdict,
        tentative: cut.tentative,
        confidence: cut.confidence,
        cut_by: cut.cut_by,
        txn: None,
        mbap_id: cut.mbap_id,
        findings,
        origin: timing.origin,
        last_origin: timing.last_origin,
    }
}
