//! Framer, decoder, pairing and statistics behind one `feed`.

// See pairing.rs.
#![allow(clippy::vec_box)]

use std::collections::VecDeque;
use std::sync::Arc;

use crate::check;
use crate::chunk::{Chunk, Side, Times};
use crate::direction::Direction;
use crate::finding::Finding;
use crate::framer::auto::{make, Auto};
use crate::framer::{Context, Cut, Framer, Mode, Verdict};
use crate::functions::{Functions, EXCEPTION_BIT};
use crate::input::Input;
use crate::line::Line;
use crate::pairing::{Exchange, Kept, Pairing, Placed, Seen};
use crate::records::{Batch, Bus, Clock, FindingRow, Frame, Half, Place, Span, Status, Transaction};
use crate::stats::Stats;
use crate::text::{Format, Reader};
use crate::Ns;

/// A request is given up after so long at the latest (records.md).
pub const DEFAULT_TIMEOUT: Ns = 1_000_000_000;

/// Transactions that may wait for an older one before they are written all the same.
const HOLD_BACK: usize = 65_536;

/// The clock of reads of several bytes: schedulers and adapters make them late by about so much.
const READ_RESOLUTION: Ns = 1_000_000;

/// The clock of single bytes.
const BYTE_RESOLUTION: Ns = 1_000;

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

/// What a bus is told about itself.
#[derive(Clone, Debug)]
pub struct BusOptions {
    /// Name, source, clock.
    pub bus: Bus,
    /// Framing; found out where `None`.
    pub mode: Option<Mode>,
    /// Line settings.
    pub line: Option<Line>,
    /// What the clock can tell apart; judged from the reads where `None`.
    pub resolution: Option<Ns>,
}

struct LineState {
    /// Requests less responses seen on it.
    votes: i32,
    input: Input,
    framer: Box<dyn Framer>,
    last_end: Option<Ns>,
}

struct BusState {
    options: BusOptions,
    lines: Vec<(u8, LineState)>,
    pairing: Pairing,
    known_units: Box<[bool; 256]>,
    paired_units: Box<[bool; 256]>,
    /// For what the log calls sent and received: requests less responses seen so far.
    sides: [i32; 2],
    newest: Option<Ns>,
    jumped: bool,
    reader: Option<Reader>,
}

/// The engine: bytes and times in, rows out. No I/O, no clock, no failure on bytes.
///
/// ```
/// use modlens_core::{chunk::Chunk, session::{Session, BusOptions}};
/// let mut session = Session::default();
/// let bus = session.add_bus(BusOptions::named("line"));
/// session.feed(bus, &Chunk { bytes: &[0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87], ..Chunk::default() });
/// session.flush();
/// assert_eq!(session.take().frames.len(), 1);
/// ```
pub struct Session {
    functions: Arc<Functions>,
    buses: Vec<BusState>,
    bus_rows: Arc<Vec<Bus>>,
    batch: Batch,
    held: VecDeque<Transaction>,
    wanted: Wanted,
    live: bool,
    timeout: Ns,
    next_frame: u64,
    next_txn: u64,
    origin: Option<Ns>,
    stats: Stats,
    /// Scratch.
    adu: Vec<u8>,
    done: Vec<Box<Exchange>>,
    found: check::Found,
    codes: Vec<Finding>,
}

impl BusOptions {
    /// A bus without clock or settings.
    pub fn named(name: &str) -> Self {
        let bus = Bus { name: name.into(), source: name.into(), place: Place::Offset, clock: Clock::None };
        Self { bus, mode: None, line: None, resolution: None }
    }
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
            held: VecDeque::new(),
            wanted,
            live,
            timeout: timeout.unwrap_or(DEFAULT_TIMEOUT),
            next_frame: 1,
            next_txn: 1,
            origin: None,
            stats: Stats::default(),
            adu: Vec::new(),
            done: Vec::new(),
            found: Vec::new(),
            codes: Vec::new(),
        }
    }

    /// Adds a bus; they are numbered from 0.
    pub fn add_bus(&mut self, options: BusOptions) -> usize {
        Arc::make_mut(&mut self.bus_rows).push(options.bus.clone());
        self.stats.add_bus(&options.bus.name);
        self.buses.push(BusState {
            pairing: Pairing::new(self.timeout, self.live),
            lines: Vec::new(),
            known_units: Box::new([false; 256]),
            paired_units: Box::new([false; 256]),
            sides: [0; 2],
            newest: None,
            jumped: false,
            reader: None,
            options,
        });
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

    /// Bytes of one line of a bus.
    pub fn feed(&mut self, bus: usize, chunk: &Chunk<'_>) {
        let state = &mut self.buses[bus];
        let time = match chunk.times {
            Times::None => None,
            Times::Read(time) => Some(time),
            Times::Bytes(times) => times.last().copied(),
        };
        let line = state.line(chunk.line);
        line.input.push(chunk);
        if let Some(time) = time {
            state.jumped |= state.newest.is_some_and(|newest| time < newest);
            state.newest = Some(time);
            let char_ns = state.options.line.map_or(0, |line| line.char_ns());
            let first = time - chunk.bytes.len() as Ns * char_ns;
            self.origin.get_or_insert(first);
        }
        if let Some(time) = time {
            self.buses[bus].close_silent_lines(time);
        }
        self.frames_of(bus);
        if let Some(time) = time {
            self.tick(bus, time);
        }
    }

    /// Text of a recording, cut anywhere; `last` ends the last line.
    pub fn feed_text(&mut self, bus: usize, format: Format, data: &[u8], last: bool) {
        let mut reader = self.buses[bus].reader.take().unwrap_or_else(|| Reader::new(format));
        reader.push(data);
        while let Some((record, bytes)) = reader.next(last) {
            let clock = record.clock;
            if self.buses[bus].options.bus.clock != clock || self.buses[bus].options.bus.place != Place::Line {
                self.describe_bus(bus, clock, Place::Line);
            }
            let times = record.time.map_or(Times::None, Times::Read);
            let chunk = Chunk {
                bytes,
                times,
                line: record.line,
                side: record.side,
                record: record.record,
                hole: record.hole,
                origin: record.number,
                ..Chunk::default()
            };
            self.feed(bus, &chunk);
        }
        self.buses[bus].reader = Some(reader);
    }

    /// What the text reader of a bus has seen.
    pub fn reader(&self, bus: usize) -> Option<&Reader> {
        self.buses[bus].reader.as_ref()
    }

    /// Time goes on without bytes: ends silences and time-outs.
    pub fn poll(&mut self, now: Ns) {
        for bus in 0..self.buses.len() {
            self.buses[bus].close_silent_lines(now);
            self.frames_of(bus);
            self.tick(bus, now);
        }
    }

    /// The recording is over: decides everything that is still open.
    pub fn flush(&mut self) {
        for bus in 0..self.buses.len() {
            self.flush_bus(bus);
        }
    }

    /// The recording of one bus is over.
    pub fn flush_bus(&mut self, bus: usize) {
        for (_, line) in &mut self.buses[bus].lines {
            (line.input.closed, line.input.ended) = (true, true);
        }
        self.frames_of(bus);
        let mut done = std::mem::take(&mut self.done);
        self.buses[bus].pairing.finish(&mut done);
        self.done = done;
        self.write_done(bus);
    }

    /// Statistics so far.
    pub fn stats(&self) -> &Stats {
        &self.stats
    }

    /// Rows that `take` would return.
    pub fn pending_rows(&self) -> usize {
        self.batch.frames.len() + self.batch.findings.len() + self.held.len()
    }

    /// The rows decided since the last call.
    pub fn take(&mut self) -> Batch {
        let oldest = self.buses.iter().filter_map(|bus| bus.pairing.oldest()).min().unwrap_or(u64::MAX);
        let mut batch = std::mem::take(&mut self.batch);
        if self.held.len() > HOLD_BACK || self.live {
            batch.transactions.extend(self.held.drain(..));
        } else {
            // Request order: numbers are given in it, and only finished ones are here.
            self.held.make_contiguous().sort_by_key(|row| row.number);
            let ready = self.held.partition_point(|row| row.number < oldest);
            batch.transactions.extend(self.held.drain(..ready));
            self.keep_held(&batch);
        }
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

    fn tick(&mut self, bus: usize, now: Ns) {
        let mut done = std::mem::take(&mut self.done);
        let state = &mut self.buses[bus];
        // Bytes that are not framed yet may be the answer: time has come only to the first of them.
        let undecided = state.lines.iter().filter_map(|(_, line)| line.input.byte_time(0)).min();
        state.pairing.tick(undecided.map_or(now, |first| first.min(now)), &mut done);
        self.done = done;
        if !self.done.is_empty() {
            self.write_done(bus);
        }
    }

    fn frames_of(&mut self, bus: usize) {
        let mut adu = std::mem::take(&mut self.adu);
        while let Some((at, cut)) = self.buses[bus].next_cut(&self.functions, &mut adu) {
            self.frame(bus, at, &cut, &adu);
        }
        self.adu = adu;
    }

    fn frame(&mut self, bus: usize, at: usize, cut: &Cut, adu: &[u8]) {
        let number = self.next_frame;
        self.next_frame += 1;
        let state = &mut self.buses[bus];
        let resolution = state.resolution(at);
        state.pairing.resolution = resolution;
        let settings = state.options.line;
        let jumped = std::mem::take(&mut state.jumped);
        let place = state.options.bus.place;
        let clocked = state.options.bus.clock != Clock::None;
        let (line, mode) = (state.lines[at].0, state.lines[at].1.framer.mode());
        let input = &state.lines[at].1.input;
        let char_ns = input.char_ns.unwrap_or(0);
        let last_end = state.lines[at].1.last_end;
        let end = input.byte_time(cut.length - 1).filter(|_| clocked);
        let first = input.byte_time(0).filter(|_| clocked).map(|ns| ns - char_ns);
        // The estimate goes back from the read's time; it cannot lie before what was already on the line.
        let start = first.map(|ns| if jumped { ns } else { last_end.map_or(ns, |last| ns.max(last)) });
        let clean_start = input.starts_read(0);
        let gap = input.pause_before(0).filter(|&gap| clocked && clean_start && gap >= 2 * resolution && gap > 0);
        let read_origin = input.read(0).map_or(0, |read| read.origin);
        let origin = if place == Place::Offset { input.offset() } else { read_origin };
        let side = input.read(0).and_then(|read| read.side);
        let offset = input.offset();
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
        check::timing(input, settings.as_ref(), resolution, &seen, &mut self.found);
        if input.line_error(0, cut.length) {
            self.found.push((Finding::LineError, String::from("marked by the receiver")));
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
            };
            self.batch.frames.push(frame);
        }
        self.stats.frame(bus, mode, &seen);
        learn(&mut state.known_units, &mut state.sides, &seen, side);
        let input = &mut state.lines[at].1;
        if cut.verdict.good() {
            input.votes += i32::from(cut.direction == Direction::Request) - i32::from(cut.direction == Direction::Response);
        }
        input.input.consume(cut.length);
        input.last_end = end.or(input.last_end);
        if !self.done.is_empty() {
            self.write_done(bus);
        }
    }

    fn write_done(&mut self, bus: usize) {
        let mut done = std::mem::take(&mut self.done);
        for mut exchange in done.drain(..) {
            self.found.clear();
            check::pair(&self.functions, &exchange, &mut self.found);
            if exchange.findings.contains(&Finding::NoResponse) {
                let waited =
                    exchange.waited.map_or(String::new(), |ns| format!("; the next request came after {} ms", ns / 1_000_000));
                self.found.push((Finding::NoResponse, format!("unit {}{waited}", exchange.unit)));
            }
            if let Some(code) = exchange.exception.filter(|_| exchange.findings.contains(&Finding::Exception)) {
                self.found.push((Finding::Exception, format!("exception {code}")));
            }
            let elapsed = elapsed(self.origin, exchange.request.start.or(exchange.response.start));
            let start = exchange.request.start.or(exchange.response.start);
            for (finding, detail) in self.found.drain(..) {
                self.stats.finding(finding);
                if !exchange.findings.contains(&finding) {
                    exchange.findings.push(finding);
                }
                if self.wanted.findings {
                    let frame = Some(exchange.response.frame).filter(|&n| n > 0).or(Some(exchange.request.frame));
                    self.batch.findings.push(FindingRow {
                        frame,
                        txn: Some(exchange.txn),
                        bus: bus as u32,
                        start,
                        elapsed,
                        unit: Some(exchange.unit),
                        finding,
                        detail,
                        origin: exchange.origin,
                    });
                }
            }
            if exchange.sure && matches!(exchange.status, Status::Ok | Status::Exception) {
                self.buses[bus].paired_units[exchange.unit as usize] = true;
            }
            self.stats.transaction(bus, &exchange);
            if self.wanted.transactions {
                let row = Transaction {
                    number: exchange.txn,
                    bus: bus as u32,
                    mode: exchange.mode,
                    start,
                    elapsed,
                    unit: exchange.unit,
                    function: exchange.function,
                    status: exchange.status,
                    exception: exchange.exception,
                    response_time: exchange.response_time,
                    waited: exchange.waited,
                    late_response: exchange.late_response,
                    retry_of: exchange.retry_of,
                    late_for: exchange.late_for,
                    gap: exchange.gap,
                    mbap_id: exchange.mbap_id,
                    request: keep_half(&mut self.batch, &exchange.request, exchange.mode),
                    response: keep_half(&mut self.batch, &exchange.response, exchange.mode),
                    findings: self.batch.keep_codes(&exchange.findings),
                    origin: exchange.origin,
                };
                self.held.push_back(row);
            }
            self.buses[bus].pairing.recycle(exchange);
        }
        self.done = done;
    }
}

impl BusState {
    fn line(&mut self, id: u8) -> &mut LineState {
        if let Some(at) = self.lines.iter().position(|(line, _)| *line == id) {
            return &mut self.lines[at].1;
        }
        let settings = self.options.line;
        let framer: Box<dyn Framer> = match self.options.mode {
            Some(mode) => make(mode, settings.as_ref()),
            None => Box::new(Auto::new(settings)),
        };
        let mut input = Input::new(settings.map(|line| line.char_ns()));
        input.break_ns = framer.break_ns(settings.as_ref());
        self.lines.push((id, LineState { votes: 0, input, framer, last_end: None }));
        &mut self.lines.last_mut().expect("just pushed").1
    }

    fn resolution(&self, at: usize) -> Ns {
        let coarse = self.lines[at].1.input.coarse;
        self.options.resolution.unwrap_or(if coarse { READ_RESOLUTION } else { BYTE_RESOLUTION })
    }

    /// Ends the frames of lines that have been silent for long.
    fn close_silent_lines(&mut self, now: Ns) {
        for (_, line) in &mut self.lines {
            line.input.closed |= line.input.newest().is_some_and(|newest| now - newest >= line.input.break_ns);
        }
    }

    /// The next frame: of the line whose first unframed byte is the oldest, so that two lines are told in time order.
    fn next_cut(&mut self, functions: &Functions, adu: &mut Vec<u8>) -> Option<(usize, Cut)> {
        let settings = self.options.line;
        let waiting = self.lines.iter().enumerate().filter(|(_, (_, line))| !line.input.bytes().is_empty());
        let at = match self.lines.len() {
            1 => waiting.map(|(at, _)| at).next()?,
            _ => waiting.min_by_key(|(_, (_, line))| line.input.byte_time(0)).map(|(at, _)| at)?,
        };
        // On a two-line tap the silence on one line says nothing of the other's.
        let one_line = self.lines.len() == 1;
        let tempo = self.pairing.tempo;
        let sides = self.sides;
        let context = Context {
            functions,
            asked: self.pairing.asked(),
            shared: !one_line,
            speaker: if one_line { None } else { speaker(self.lines[at].1.votes) },
            known_units: &self.known_units,
            paired_units: &self.paired_units,
            pause: &move |gap| tempo.judge(gap.filter(|_| one_line)),
            said: &move |side| said(sides, side),
        };
        let state = &mut self.lines[at].1;
        let cut = state.framer.next(&state.input, &context, adu);
        state.input.break_ns = state.framer.break_ns(settings.as_ref());
        Some((at, cut?))
    }
}

/// Who has a line of a two-line tap for himself, once he has shown it twice.
fn speaker(votes: i32) -> Option<Direction> {
    match votes {
        2.. => Some(Direction::Request),
        ..=-2 => Some(Direction::Response),
        _ => None,
    }
}

/// Remembers who speaks on this bus, and what its log's words mean.
fn learn(known_units: &mut [bool; 256], sides: &mut [i32; 2], seen: &Seen<'_>, side: Option<Side>) {
    if !seen.verdict.good() || seen.adu.len() < 2 {
        return;
    }
    known_units[seen.adu[0] as usize] = true;
    if let Some(side) = side {
        let vote = match seen.direction {
            Direction::Request => 1,
            Direction::Response => -1,
            Direction::Unknown => 0,
        };
        let slot = &mut sides[usize::from(side == Side::Received)];
        *slot = (*slot + vote).clamp(-100, 100);
    }
}

/// What a log's word means: what its frames have shown, or else that the logging process is the master.
fn said(sides: [i32; 2], side: Side) -> Direction {
    let lead = sides[0] - sides[1];
    let master_logs = lead >= 0;
    if (side == Side::Sent) == master_logs {
        Direction::Request
    } else {
        Direction::Response
    }
}

fn elapsed(origin: Option<Ns>, start: Option<Ns>) -> Option<Ns> {
    Some(start? - origin?)
}

fn framing_detail(finding: Finding, wire: &[u8]) -> String {
    match finding {
        Finding::MbapLength => format!("{} bytes on the wire do not fit the layout of the function", wire.len()),
        _ => format!("{} characters", wire.len()),
    }
}

fn placed_detail(finding: Finding, placed: &Placed, seen: &Seen<'_>) -> String {
    let unit = seen.adu.first().copied().unwrap_or(0);
    let other = placed.other.map_or(String::new(), |txn| format!(" {txn}"));
    match finding {
        Finding::Retry => format!("repeats transaction{other}"),
        Finding::LateResponse => format!("answers transaction{other}"),
        Finding::LocalEcho => format!("repeats the request of transaction{other} at once"),
        Finding::TwoMasters => String::from("answered after a later request"),
        Finding::WrongUnit => format!("unit {unit} answered; transaction{other} asked another"),
        Finding::WrongFunction => {
            format!("function {}; transaction{other} asked for another", seen.adu.get(1).map_or(0, |code| code & !EXCEPTION_BIT))
        }
        _ => format!("unit {unit}"),
    }
}

fn keep_half(batch: &mut Batch, kept: &Kept, mode: Mode) -> Half {
    if kept.frame == 0 {
        return Half::default();
    }
    let wire = batch.keep(&kept.wire);
    // In RTU and TCP the PDU stands in the wire bytes; in ASCII it has to be kept in binary.
    let inside = match mode {
        Mode::Rtu => Some(1),
        Mode::Tcp => Some(7),
        Mode::Ascii => None,
    };
    let length = kept.pdu.len() as u32;
    let pdu = match inside {
        Some(at) if at + length <= wire.length => Span { start: wire.start + at, length },
        _ => batch.keep(&kept.pdu),
    };
    Half { frame: kept.frame, wire, pdu, start: kept.start }
}
