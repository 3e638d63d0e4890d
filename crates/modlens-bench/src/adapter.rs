//! modlens itself as an `Algorithm`.

use std::collections::HashMap;
use std::sync::Arc;

use modlens_engine::framer::silence::SilenceRule;
use modlens_engine::records::{Batch, Bus, Frame, Transaction};
use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::direction;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::{LineSettings, Parity};
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::status::Status;
use modlens_readers::chunk::{Chunk, Times};

use crate::model::{Direction, Framing, Label, Settings};
use crate::reported::{Algorithm, ReportedFrame, TransactionClaim};
use crate::sim::case::Case;

/// The interval at which a live tap polls the clock while no bytes arrive.
const TICK_NS: i64 = 5_000_000;

/// After a silence of this length no decision is open any more, so the clock is not polled further.
const MAX_SILENCE_NS: i64 = 11_000_000_000;

/// modlens on a recording, or live.
#[derive(Clone, Copy, Debug)]
pub struct Modlens {
    live: bool,
    /// Frames are cut at silences only, as the specification says.
    textbook: bool,
}

impl Modlens {
    /// modlens on a recording.
    pub fn offline() -> Self {
        Self { live: false, textbook: false }
    }

    /// modlens on a live tap, simulated in the time of the recording.
    pub fn live() -> Self {
        Self { live: true, textbook: false }
    }

    /// modlens on a recording with `--segmentation silence`.
    pub fn textbook() -> Self {
        Self { live: false, textbook: true }
    }
}

impl Algorithm for Modlens {
    fn name(&self) -> &'static str {
        if self.textbook {
            "modlens-silence"
        } else if self.live {
            "modlens-live"
        } else {
            "modlens"
        }
    }

    fn run(&mut self, case: &Case) -> Vec<ReportedFrame> {
        ModlensRun::new(case, *self).all(case)
    }

    fn labels(&self) -> bool {
        true
    }
}

/// One run over a case.
struct ModlensRun {
    session: Session,
    bus: usize,
    live: bool,
    now: Option<i64>,
    frames: Vec<ReportedFrame>,
    /// The index in `frames` by the number of a frame.
    index_of_frame: HashMap<u64, usize>,
    /// The number of the request by that of its transaction.
    request_of_transaction: HashMap<u64, u64>,
}

impl ModlensRun {
    /// A session with one bus that has the settings of the case.
    fn new(case: &Case, how: Modlens) -> Self {
        let live = how.live;
        let wanted = WantedTables { frames: true, transactions: true, findings: true };
        let mut session = Session::new(Arc::new(Functions::default()), wanted, live, None);
        let timed = case.timed_reads().next().is_some_and(|feed| feed.time.is_some());
        let clock = if timed { Clock::Relative } else { Clock::None };
        let name: Arc<str> = Arc::from(case.name.as_str());
        let bus = session.add_bus(BusOptions {
            bus: Bus {
                name: String::from(&*name),
                source: String::from(&*name),
                place: Place::Offset,
                clock,
                line: None,
                network: None,
            },
            mode: (!case.hides_framing).then_some(if case.framing == Framing::Rtu { Mode::Rtu } else { Mode::Ascii }),
            rule: Some(rule(case.settings)).filter(|_| how.textbook),
            line: Some(line(case.settings)),
            resolution: None,
        });
        Self {
            session,
            bus,
            live,
            now: None,
            frames: Vec::new(),
            index_of_frame: HashMap::new(),
            request_of_transaction: HashMap::new(),
        }
    }

    /// Feeds all reads of the case, in live runs with the polls of the clock between them, and returns the reported frames.
    fn all(mut self, case: &Case) -> Vec<ReportedFrame> {
        for feed in case.timed_reads() {
            if let (true, Some(before), Some(time)) = (self.live, self.now, feed.time) {
                self.wait(before, time);
            }
            self.now = feed.time;
            let times = feed.time.map_or(Times::None, Times::Read);
            let chunk = Chunk { line: feed.line, bytes: feed.bytes, times, ..Chunk::default() };
            self.session.feed(self.bus, &chunk);
            self.take();
        }
        if let (true, Some(now)) = (self.live, self.now) {
            self.wait(now, now + MAX_SILENCE_NS);
        }
        self.session.flush();
        self.take();
        self.frames
    }

    /// Polls the session while time passes without bytes.
    fn wait(&mut self, from: i64, to: i64) {
        let end = to.min(from + MAX_SILENCE_NS);
        let mut now = from + TICK_NS;
        while now < end {
            self.session.poll(now);
            self.now = Some(now);
            self.take();
            now += TICK_NS;
        }
    }

    fn take(&mut self) {
        if self.session.pending_rows() == 0 {
            return;
        }
        let batch = self.session.take();
        for frame in &batch.frames {
            self.frame(frame);
        }
        self.transactions(&batch);
        self.findings(&batch);
    }

    /// Takes a row of a frame; noise is not reported.
    fn frame(&mut self, row: &Frame) {
        if row.verdict == Verdict::Noise {
            return;
        }
        let end = row.offset + u64::from(row.wire.length);
        let mut frame = ReportedFrame::new(row.line, row.offset, end, row.verdict.is_good());
        frame.direction = match row.direction {
            direction::Direction::Request => Direction::Request,
            direction::Direction::Response => Direction::Response,
            direction::Direction::Unknown => Direction::Unknown,
        };
        frame.unconfirmed = row.unconfirmed;
        frame.confidence = row.confidence;
        frame.txn = row.txn;
        frame.emitted_ns = self.now.filter(|_| self.live);
        self.index_of_frame.insert(row.number, self.frames.len());
        self.frames.push(frame);
    }

    /// Takes the labels that are in columns of transactions.
    fn transactions(&mut self, batch: &Batch) {
        for row in &batch.transactions {
            if row.request.frame != 0 {
                self.request_of_transaction.insert(row.number, row.request.frame);
            }
            if row.status == Status::NoResponse {
                self.label(row.request.frame, Label::NoResponse);
            }
            self.claim(row);
            if row.retry_of.is_some() {
                self.label(row.request.frame, Label::Retry);
            }
            if let Some(old) = row.late_response_to {
                // A late response has a row of its own, but for the scorer it shares the transaction of its request.
                self.label(row.response.frame, Label::Late);
                if let Some(&place) = self.index_of_frame.get(&row.response.frame) {
                    self.frames[place].txn = Some(old);
                }
            }
        }
    }

    /// Takes what a transaction claims, and its confidence.
    fn claim(&mut self, row: &Transaction) {
        let (claim, frame) = match row.status {
            Status::Ok | Status::Exception => (TransactionClaim::Answered, row.response.frame),
            Status::NoResponse => (TransactionClaim::Silent, row.request.frame),
            Status::Unsolicited if row.late_response_to.is_some() => (TransactionClaim::Late, row.response.frame),
            Status::Unsolicited => (TransactionClaim::Unasked, row.response.frame),
            _ => return,
        };
        if let Some(&place) = self.index_of_frame.get(&frame) {
            self.frames[place].transaction = Some((claim, row.confidence));
        }
    }

    fn findings(&mut self, batch: &Batch) {
        for row in &batch.findings {
            let Some(label) = label(row.finding.doc().code) else { continue };
            let request = row.txn.and_then(|txn| self.request_of_transaction.get(&txn).copied());
            if let Some(frame) = row.frame.or(request) {
                self.label(frame, label);
            }
        }
    }

    fn label(&mut self, frame: u64, label: Label) {
        if let Some(&place) = self.index_of_frame.get(&frame) {
            self.frames[place].labels.insert(label);
        }
    }
}

/// The label of a finding, by its code. The other labels come from columns of transactions.
fn label(code: &str) -> Option<Label> {
    Some(match code {
        "duplicate" | "duplicate_response" => Label::Duplicate,
        "local_echo" | "echo" => Label::Echo,
        "wrong_unit" => Label::WrongUnit,
        "two_masters" => Label::TwoMasters,
        "lost_bytes" => Label::LostBytes,
        _ => return None,
    })
}

fn rule(settings: Settings) -> SilenceRule {
    let line = line(settings);
    SilenceRule { t35_ns: line.t35_ns(), t15_ns: line.t15_ns() }
}

fn line(settings: Settings) -> LineSettings {
    LineSettings {
        baud: settings.baud,
        data_bits: settings.data_bits,
        parity: if settings.has_even_parity { Parity::Even } else { Parity::None },
        half_stop_bits: 2,
    }
}
