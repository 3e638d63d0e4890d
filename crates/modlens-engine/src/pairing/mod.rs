//! Requests and responses of one bus joined to transactions.
//!
//! What is here decides about whole frames; where frames begin and who sent them is the framer's and `direction`'s.
//! Some things show only later (a second master, an answer from the wrong unit): they become notes on earlier frames.

// An exchange is large and changes hands three times: boxes move, exchanges do not.
#![allow(clippy::vec_box)]

use std::collections::VecDeque;

pub mod align;
mod answers;
mod exchange;
mod masters;
mod past;
mod requests;
mod routine;
mod tempo;
mod wreck;

pub use exchange::{Exchange, Kept, Seen};
pub use masters::Meeting;
pub use tempo::Tempo;

use modlens_protocol::direction::{Asked, Direction};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::Functions;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

use answers::{Early, Stray};
use masters::Masters;
use past::Past;
use requests::Copies;

/// A request is given up after so long at the latest (records.md).
pub const DEFAULT_TIMEOUT: Ns = 1_000_000_000;

/// Pairing of one bus, or one connection.
#[derive(Debug)]
pub struct Pairing {
    open: VecDeque<Box<Exchange>>,
    past: Past,
    spare: Vec<Box<Exchange>>,
    /// What was learned of the bus's tempo.
    pub tempo: Tempo,
    /// As the user says; learned where `None`.
    timeout: Option<Ns>,
    copies: Copies,
    masters: Masters,
    /// A meeting of two masters that lacks its second answer.
    halfway: Option<Meeting>,
    stray: Option<Stray>,
    /// The first answer since the last pair that nobody had asked for, where the order of two lines is late.
    early: Option<Early>,
    /// A request that lacks bytes: if an answer follows, the unit could read it.
    partial: Option<Box<Exchange>>,
    /// Units that have answered.
    present: Box<[bool; 256]>,
    /// What shows only now of earlier frames.
    pub notes: Vec<Note>,
    /// Times that differ by less than twice this are not told apart.
    pub resolution: Ns,
    /// How late the reads of this line come.
    pub lateness: Ns,
    /// Frames come in the order of the wire: not so where two lines are read by adapters that hold bytes back.
    pub ordered: bool,
    /// The order of requests and answers is guessed: where nothing is seen of an answer, that proves nothing.
    pub guessed: bool,
    live: bool,
    /// Whether the side that answers is recorded at all: where it is not, its silence means nothing.
    pub heard: bool,
    /// Transaction identifiers of the last requests of a connection.
    ids: VecDeque<u16>,
}

/// What shows later of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Note {
    /// What it is.
    pub finding: Finding,
    /// Where.
    pub meeting: Meeting,
}

/// What becomes of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Placed {
    /// Its transaction.
    pub txn: Option<u64>,
    /// A finding on the pair that shows on this frame.
    pub finding: Option<Finding>,
    /// The transaction that the finding's detail refers to.
    pub other: Option<u64>,
}

impl Pairing {
    /// Pairing with this time-out; learned where `None`.
    pub fn new(timeout: Option<Ns>, live: bool) -> Self {
        Self {
            open: VecDeque::new(),
            past: Past::default(),
            spare: Vec::new(),
            tempo: Tempo::default(),
            timeout,
            copies: Copies::default(),
            masters: Masters::default(),
            halfway: None,
            stray: None,
            early: None,
            partial: None,
            present: Box::new([false; 256]),
            notes: Vec::new(),
            resolution: 0,
            lateness: 0,
            ordered: true,
            guessed: false,
            live,
            heard: true,
            ids: VecDeque::new(),
        }
    }

    /// The request that the next frame may answer.
    pub fn asked(&self) -> Option<Asked<'_>> {
        self.open.back().map(|exchange| Asked { unit: exchange.unit, pdu: exchange.request.pdu() })
    }

    /// The answer before, unit and PDU, if its request was a retry.
    pub fn answer_to_retry(&self) -> Option<(u8, &[u8])> {
        self.past.answer_to_retry()
    }

    /// When that request had come.
    pub fn asked_at(&self) -> Option<Ns> {
        self.open.back()?.request.end
    }

    /// The smallest number of a transaction that is not done.
    pub fn oldest(&self) -> Option<u64> {
        let stray = self.stray.as_ref().map(|stray| stray.exchange.txn);
        self.open.iter().map(|exchange| exchange.txn).chain(stray).min()
    }

    /// Bytes are missing from the recording: what is open may have been answered in them.
    pub fn lost(&mut self) {
        for exchange in &mut self.open {
            exchange.blind = true;
        }
    }

    /// Takes back an exchange whose rows were written, to use its buffers again.
    pub fn recycle(&mut self, exchange: Box<Exchange>) {
        if self.spare.len() < 8 {
            self.spare.push(exchange);
        }
    }

    /// Places a frame; `done` gets what it completes.
    pub fn take(&mut self, functions: &Functions, seen: &Seen<'_>, next_txn: &mut u64, done: &mut Vec<Box<Exchange>>) -> Placed {
        match (seen.verdict.good(), seen.direction) {
            (_, _) if seen.verdict == Verdict::Noise => Placed::default(),
            // Of an answer, no more than that it came may be known; on two lines, not even to what.
            (false, Direction::Response) if self.ordered => self.damaged(functions, seen, next_txn, done),
            (_, _) if seen.adu.len() < 2 => Placed::default(),
            (true, Direction::Request) => self.request(functions, seen, next_txn, done),
            (true, Direction::Response) => self.response(functions, seen, next_txn, done),
            (true, Direction::Unknown) => Placed::default(),
            (false, _) => self.damaged(functions, seen, next_txn, done),
        }
    }

    fn start(&mut self, seen: &Seen<'_>, next_txn: &mut u64) -> Box<Exchange> {
        let mut exchange = self.spare.pop().unwrap_or_else(|| Box::new(Exchange::new(seen.mode)));
        exchange.reset(seen.mode);
        exchange.txn = *next_txn;
        *next_txn += 1;
        exchange.unit = seen.unit();
        exchange.function = seen.function();
        exchange.mbap_id = seen.mbap_id;
        exchange.origin = seen.origin;
        exchange
    }

    fn close(&mut self, mut exchange: Box<Exchange>, silence: Status, done: &mut Vec<Box<Exchange>>) {
        let silence = if exchange.blind || !self.heard { Status::NotSeen } else { silence };
        if exchange.status != Status::BadRequest {
            exchange.status = if exchange.response.frame != 0 { Status::BadResponse } else { silence };
        }
        if exchange.status == Status::BadRequest {
            self.past.damaged(&exchange);
        } else if !exchange.silent {
            self.past.unanswered(&exchange, exchange.status == Status::NoResponse && !exchange.late_seen);
        }
        if exchange.status == Status::NoResponse && !exchange.silent {
            exchange.findings.push(Finding::NoResponse);
        }
        done.push(exchange);
    }

    /// When a request is given up.
    pub fn patience(&self) -> Ns {
        self.timeout.unwrap_or_else(|| self.tempo.patience().map_or(DEFAULT_TIMEOUT, |learned| learned.min(DEFAULT_TIMEOUT)))
    }

    /// When the next request is given up.
    pub fn deadline(&self) -> Option<Ns> {
        let patience = self.patience();
        let waiting = self.open.iter().filter(|exchange| !exchange.given_up);
        waiting.filter_map(|exchange| Some(exchange.request.end? + patience)).min()
    }

    /// Time has come to `now`: gives up requests whose time-out has passed.
    pub fn tick(&mut self, now: Ns, done: &mut Vec<Box<Exchange>>) {
        if self.open.is_empty() {
            return;
        }
        let patience = self.patience();
        for exchange in &mut self.open {
            exchange.given_up |= exchange.request.end.is_some_and(|end| now - end >= patience);
        }
        // A live tap reports at once; in a recording the row waits for the next request, to tell how long the master waited.
        while self.live && self.open.front().is_some_and(|exchange| exchange.given_up) {
            self.settle_stray(None, done);
            let exchange = self.open.pop_front().expect("checked above");
            self.close(exchange, Status::NoResponse, done);
        }
    }

    /// The recording is over.
    pub fn finish(&mut self, done: &mut Vec<Box<Exchange>>) {
        self.settle_stray(None, done);
        while let Some(exchange) = self.open.pop_front() {
            let status = if exchange.given_up { Status::NoResponse } else { Status::NotSeen };
            self.close(exchange, status, done);
        }
        let rest = self.masters.rest().into_iter().filter(|meeting| !meeting.clear);
        self.notes.extend(rest.map(|meeting| Note { finding: Finding::LateResponse, meeting }));
    }
}
