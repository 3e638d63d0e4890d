//! Line settings found by listening: the usual ones are tried in turn until valid frames come.
//!
//! `modlens tap` also reads the next rate off the bytes that a wrong one gives; here each candidate has its turn. Frames
//! with a right checksum are the evidence: by chance one fits at one place in 65,536.

use std::sync::Arc;

use modlens_engine::session::{BusOptions, Session, WantedTables};
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_recorder::Read;

/// What is tried, the most usual first; the specification's default parity is even (2.5.1).
const CANDIDATES: [&str; 18] = [
    "9600-8N1",
    "9600-8E1",
    "19200-8E1",
    "19200-8N1",
    "38400-8N1",
    "38400-8E1",
    "115200-8N1",
    "115200-8E1",
    "57600-8N1",
    "57600-8E1",
    "4800-8N1",
    "4800-8E1",
    "2400-8N1",
    "2400-8E1",
    "1200-8N1",
    "1200-8E1",
    "9600-8O1",
    "19200-8O1",
];
/// So many valid frames settle it.
const ENOUGH_FRAMES: usize = 3;
/// Bytes after which a candidate without a valid frame has lost its turn, and the time that a silent line takes from it.
const ENOUGH_BYTES: usize = 400;
const TURN_NS: Ns = 4_000_000_000;

/// A search that goes on; candidates come again and again until one fits.
pub struct Search {
    at: usize,
    mode: Option<Mode>,
    session: Session,
    bus: usize,
    frames: usize,
    bytes: usize,
    since: Ns,
}

impl Search {
    /// Begins with the first candidate.
    pub fn new(mode: Option<Mode>, now: Ns) -> Self {
        let (session, bus) = listener(mode);
        Self { at: 0, mode, session, bus, frames: 0, bytes: 0, since: now }
    }

    /// The candidate whose turn it is.
    pub fn line(&self) -> LineSettings {
        CANDIDATES[self.at % CANDIDATES.len()].parse().unwrap_or_else(|_| unreachable!("a candidate is a valid line"))
    }

    /// Takes a read that was made with the present candidate; whether that one is right.
    pub fn takes(&mut self, read: &Read) -> bool {
        let Some(bytes) = &read.bytes else { return false };
        self.bytes += bytes.len();
        let chunk = Chunk { bytes, times: Times::Read(read.time), error_positions: &read.errors, ..Chunk::default() };
        self.session.feed(self.bus, &chunk);
        self.frames += self.session.take().frames.iter().filter(|frame| frame.verdict == Verdict::Ok).count();
        self.frames >= ENOUGH_FRAMES
    }

    /// Goes on to the next candidate if this one has had its turn; whether it did.
    pub fn goes_on(&mut self, now: Ns) -> bool {
        self.session.poll(now);
        self.frames += self.session.take().frames.iter().filter(|frame| frame.verdict == Verdict::Ok).count();
        let is_over = if self.frames == 0 { self.bytes >= ENOUGH_BYTES } else { self.bytes >= 10 * ENOUGH_BYTES };
        // A silent line says nothing about a candidate.
        if !is_over && (self.bytes == 0 || now - self.since < TURN_NS) {
            return false;
        }
        (self.session, self.bus) = listener(self.mode);
        (self.frames, self.bytes, self.since) = (0, 0, now);
        self.at += 1;
        true
    }
}

/// A session that only counts frames.
fn listener(mode: Option<Mode>) -> (Session, usize) {
    let wanted = WantedTables { frames: true, transactions: false, findings: false };
    let mut session = Session::new(Arc::new(Functions::default()), wanted, true, None);
    let bus = session.add_bus(BusOptions { mode, ..BusOptions::named("search") });
    (session, bus)
}
