//! Framer, decoder, pairing and statistics behind one `feed`.

// See pairing/mod.rs.
#![allow(clippy::vec_box)]

mod ahead;
mod bus;
mod capture;
mod clock;
mod done;
mod feed;
mod logic;
mod moment;
mod profiles;
mod recorded;
mod routine;
mod rows;
mod told;
mod turns;

use std::sync::Arc;

use crate::check;
use crate::framer::Cut;
use crate::pairing::{Exchange, Pairing, Seen};
use crate::records::{Batch, Buses, FindingRow, Frame, Span, Spare, Transaction};
use crate::stats::Stats;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;

pub use bus::BusOptions;
pub use capture::CaptureOptions;

use bus::{learn, voted, BusState};
use capture::CaptureState;
use logic::LogicState;
use moment::{Moment, Setting};
use profiles::Assignment;
use rows::{elapsed, framing_detail, marked_detail, placed_detail};

/// Transactions that may wait for an older one before they are written all the same.
const HOLD_BACK: usize = 65_536;
/// Which tables to build.
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
    bus_rows: Arc<Buses>,
    batch: Batch,
    spare: Spare,
    held: Vec<Transaction>,
    wanted: Wanted,
    live: bool,
    timeout: Option<Ns>,
    next_frame: u64,
    next_txn: u64,
    origin: Option<Ns>,
    stats: Stats,
    assignments: Vec<Assignment>,
    /// Scratch.
    adu: Vec<u8>,
    /// The same of a request and its answer.
    adus: [Vec<u8>; 2],
    text: Vec<u8>,
    done: Vec<Box<Exchange>>,
    found: check::Found,
    codes: Vec<Finding>,
    captures: Vec<Option<CaptureState>>,
    logics: Vec<Option<LogicState>>,
    /// Buses of connections that are over: they may have rows that are held.
    retired: Vec<usize>,
    /// Buses that a further connection may take.
    free: Vec<usize>,
    connections: u64,
    /// The bus whose bytes wait to be decided.
    waiting: Option<usize>,
    /// The buses of raw recordings, with the segment that was read last.
    recorded: Vec<(modlens_readers::pcap::own::RecordingSegment, usize)>,
}
impl Default for Session {
    fn default() -> Self {
        Self::new(Arc::new(Functions::default()), Wanted { frames: true, transactions: true, findings: true }, false, None)
    }
}

impl Session {
    /// A session with this table of functions. `live` reports in order of completion.
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

    /// Says what clock and places a bus has, once its source has shown them.
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

    /// Rows that `take` would return.
    pub fn pending_rows(&self) -> usize {
        self.batch.frames.len() + self.batch.findings.len() + self.held.len()
    }

    /// The rows decided since the last call.
    pub fn take(&mut self) -> Batch {
        let told = self.captures.iter().flatten().filter_map(CaptureState::oldest);
        let oldest = self.buses.iter().filter_map(|bus| bus.pairing.oldest()).chain(told).min().unwrap_or(u64::MAX);
        let mut batch = std::mem::replace(&mut self.batch, self.spare.batch());
        let mut ready = self.held.len();
        if ready <= HOLD_BACK && !self.live {
            // Request order: numbers are given in it, and only finished ones are here.
            if !self.held.is_sorted_by_key(|row| row.number) {
                self.held.sort_by_key(|row| row.number);
            }
            ready = self.held.partition_point(|row| row.number < oldest);
        }
        std::mem::swap(&mut batch.transactions, &mut self.held);
        self.held.extend(batch.transactions.drain(ready..));
        self.keep_held(&batch);
        self.release();
        batch.buses = Arc::clone(&self.bus_rows);
        batch.functions = Some(Arc::clone(&self.functions));
        batch
    }

    /// Moves the bytes of transactions that stay over to the next batch.
    fn keep_held(&mut self, from: &Batch) {
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

    fn frame(&mut self, bus: usize, at: usize, cut: &Cut, adu: &[u8]) {
        let number = self.next_frame;
        self.next_frame += 1;
        let state = &mut self.buses[bus];
        let setting = state.setting(at);
        let Setting { clocked, resolution, mode, jumped, .. } = setting;
        state.jumped = false;
        let rule = state.options.rule();
        let line = state.lines[at].0;
        let input = state.lines[at].1.untold();
        let moment = Moment::of(input, cut.length, &setting);
        moment.between(input, (number, cut.length), setting.place, &mut self.batch.between);
        let Moment { start, end, gap, clean_start, side, offset, origin, last_origin } = moment;
        let wire = &input.bytes()[..cut.length];
        let mut seen = Seen {
            frame: number,
            wire,
            adu,
            verdict: cut.verdict,
            direction: cut.direction,
            mode,
            start,
            end,
            clean_start,
            gap,
            mbap_id: cut.mbap_id,
            origin,
            tentative: cut.tentative,
            codes: &[],
        };
        self.found.clear();
        check::frame(&self.functions, &seen, &mut self.found);
        check::timing(input, rule, resolution, &seen, &mut self.found);
        if let Some(rule) = rule.filter(|_| clocked && input.timed && mode == Mode::Rtu) {
            let before = input.hard_edge(0) || offset == 0 || input.pause_before(0).is_some_and(|gap| gap >= rule.t35_ns);
            let inside = input.longest_pause(0, cut.length).is_some_and(|gap| gap >= rule.t35_ns);
            self.stats.silence(bus, rule.t35_ns, &seen, before, inside);
        }
        if input.marked() && input.line_error(0, cut.length) {
            self.found.push((Finding::LineError, marked_detail(input.errors_in(0, cut.length), cut.length)));
        }
        if input.marked() && input.hole(0, cut.length) {
            self.found.push((Finding::LostBytes, String::from("the receiver lost bytes before this frame")));
        }
        if jumped {
            self.found.push((Finding::ClockJumped, String::from("this read is older than the one before")));
        }
        if cut.tentative {
            self.found.push((
                Finding::Tentative,
                String::from("between bytes that are no frames, and the unit was in no paired transaction yet"),
            ));
        }
        if let Some((finding, harm)) = cut.harm.and_then(|harm| Some((harm.finding()?, harm))) {
            self.found.push((finding, harm.text()));
        }
        if let Some(finding) = cut.finding {
            self.found.push((finding, framing_detail(finding, wire)));
        }
        self.codes.clear();
        self.codes.extend(self.found.iter().map(|(finding, _)| *finding));
        seen.codes = &self.codes;
        let mut done = std::mem::take(&mut self.done);
        if let Some(start) = start {
            state.pairing.tick(start, &mut done);
        }
        let placed = state.pairing.take(&self.functions, &seen, &mut self.next_txn, &mut done);
        self.done = done;
        let noted = !state.pairing.notes.is_empty();
        if let Some(finding) = placed.finding {
            self.found.push((finding, placed_detail(finding, &placed, &seen)));
        }
        let elapsed = elapsed(self.origin, start);
        for (finding, detail) in &self.found {
            self.stats.finding(*finding);
            if self.wanted.findings {
                self.batch.findings.push(FindingRow {
                    frame: Some(number),
                    txn: placed.txn,
                    bus: bus as u32,
                    start,
                    elapsed,
                    unit: adu.first().copied(),
                    finding: *finding,
                    detail: detail.clone(),
                    origin,
                });
            }
        }
        if self.wanted.frames {
            let codes = self.batch.keep_codes(&self.codes);
            let last = self.batch.codes.len();
            self.batch.codes.extend(self.found[self.codes.len()..].iter().map(|(finding, _)| *finding));
            let findings = Span { length: codes.length + (self.batch.codes.len() - last) as u32, ..codes };
            let code = adu.get(1).copied().filter(|_| cut.verdict != Verdict::Noise);
            let exception = code.filter(|code| code & EXCEPTION_BIT != 0 && cut.verdict.good()).and_then(|_| adu.get(2).copied());
            let frame = Frame {
                number,
                bus: bus as u32,
                line,
                offset,
                wire: self.batch.keep(wire),
                start,
                elapsed,
                gap,
                mode,
                direction: cut.direction,
                unit: adu.first().copied().filter(|_| cut.verdict != Verdict::Noise),
                code,
                exception,
                verdict: cut.verdict,
                tentative: cut.tentative,
                confidence: cut.confidence,
                cut_by: cut.cut_by,
                txn: placed.txn,
                mbap_id: cut.mbap_id,
                findings,
                origin,
                last_origin,
            };
            self.batch.frames.push(frame);
        }
        self.stats.frame(state.counts, mode, &seen);
        learn(&mut state.known_units, &mut state.sides, &seen, side);
        let input = &mut state.lines[at].1;
        if cut.verdict.good() {
            input.lateness.learn(&input.input, cut.length);
            // Who speaks on a line is asked where there are two.
            if line != 0 && input.ahead.is_none() && !cut.tentative {
                input.votes = voted(input.votes, &self.functions, adu);
            }
        }
        input.consume(cut.length);
        input.last_end = end.or(input.last_end);
        if noted || !self.done.is_empty() {
            self.write_done(bus);
        }
    }
}
