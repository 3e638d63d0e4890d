//! Requests and responses of one bus joined to transactions.
//!
//! What is here decides about whole frames; where frames begin and who sent them is the framer's and `direction`'s.

// An exchange is large and changes hands three times: boxes move, exchanges do not.
#![allow(clippy::vec_box)]

use std::collections::VecDeque;

mod exchange;
mod tempo;

pub use exchange::{Exchange, Kept, Seen};
pub use tempo::Tempo;

use crate::direction::{answers, Asked, Direction, Match};
use crate::finding::Finding;
use crate::framer::{Mode, Verdict};
use crate::functions::{Functions, Layout, Operation, EXCEPTION_BIT};
use crate::records::Status;
use crate::Ns;

/// The unit that all units listen to (serial line specification, 2.2).
pub const BROADCAST: u8 = 0;

/// Unanswered requests that a late answer may still belong to.
const REMEMBERED: usize = 16;

/// No master gives up so soon (serial line specification, 2.4.1: one second is typical).
const NO_TIMEOUT: Ns = 100_000_000;

/// An answer later than so many transactions belongs to none of them.
const LATE_BY: u64 = 4;

/// The echo of an adapter that hears itself comes within this time: it is the adapter's own delay.
const MOST_ECHO: Ns = 3_000_000;

/// Without a clock, a line is one with echo if more than this share of requests is heard twice.
const ECHO_SHARE: f32 = 0.7;

/// How fast that share is learned.
const COPY_RATE: f32 = 0.1;
/// Requests that may be open at once; a serial line has one, a TCP connection as many as it has transaction ids.
const OPEN_LIMIT: usize = 1024;
/// An unanswered request, in short.
#[derive(Clone, Debug)]
struct Unanswered {
    txn: u64,
    unit: u8,
    pdu: Vec<u8>,
    end: Option<Ns>,
}
/// Pairing of one bus, or one connection.
#[derive(Debug)]
pub struct Pairing {
    open: VecDeque<Box<Exchange>>,
    unanswered: VecDeque<Unanswered>,
    /// The last request without a good answer: transaction, unit, PDU.
    failed: Option<(u64, u8, Vec<u8>)>,
    spare: Vec<Box<Exchange>>,
    /// What was learned of the bus's tempo.
    pub tempo: Tempo,
    timeout: Ns,
    /// The last answer: unit, PDU, whether it answered a retry.
    last: Option<(u8, Vec<u8>, bool)>,
    /// Share of requests heard twice.
    copies: f32,
    /// Whether the request before was.
    twice: bool,
    /// Times that differ by less than twice this are not told apart.
    pub resolution: Ns,
    live: bool,
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
    /// Pairing with this time-out.
    pub fn new(timeout: Ns, live: bool) -> Self {
        Self {
            open: VecDeque::new(),
            unanswered: VecDeque::new(),
            failed: None,
            spare: Vec::new(),
            tempo: Tempo::default(),
            timeout,
            last: None,
            copies: 0.0,
            twice: false,
            resolution: 0,
            live,
        }
    }

    /// The request that the next frame may answer.
    pub fn asked(&self) -> Option<Asked<'_>> {
        self.open.back().map(|exchange| Asked { unit: exchange.unit, pdu: &exchange.request.pdu })
    }

    /// The smallest number of a transaction that is not done.
    pub fn oldest(&self) -> Option<u64> {
        self.open.iter().map(|exchange| exchange.txn).min()
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
            (_, _) if seen.verdict == Verdict::Noise || seen.adu.len() < 2 => Placed::default(),
            (true, Direction::Request) => self.request(functions, seen, next_txn, done),
            (true, Direction::Response) => self.response(functions, seen, next_txn, done),
            (true, Direction::Unknown) => Placed::default(),
            (false, direction) => self.damaged(functions, seen, direction, next_txn, done),
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

    /// Whether a request is the echo of the one that waits: the same again, much sooner than any master asks again.
    fn local_echo(&mut self, functions: &Functions, seen: &Seen<'_>) -> Option<u64> {
        if seen.mode == Mode::Tcp {
            return None;
        }
        let same =
            self.open.back().is_some_and(|open| open.unit == seen.unit() && open.request.pdu == seen.pdu() && !open.echoed);
        if !echoes_whole(functions, seen.pdu()) {
            // Of each request in turn: was it heard twice? On a line with time-outs some are, on one with echo all.
            if same {
                self.twice = true;
            } else {
                self.copies += (f32::from(u8::from(self.twice)) - self.copies) * COPY_RATE;
                self.twice = false;
            }
        }
        let open = self.open.back()?;
        let soon = match seen.start.zip(open.request.end) {
            Some((start, end)) => start - end < MOST_ECHO,
            None => self.copies > ECHO_SHARE,
        };
        let open = self.open.back_mut().filter(|_| same && soon)?;
        open.echoed = true;
        open.findings.push(Finding::LocalEcho);
        // The answer's time counts from the last byte of the request, whoever sent it.
        open.request.end = seen.end.or(open.request.end);
        Some(open.txn)
    }

    fn request(&mut self, functions: &Functions, seen: &Seen<'_>, next_txn: &mut u64, done: &mut Vec<Box<Exchange>>) -> Placed {
        if let Some(txn) = self.local_echo(functions, seen) {
            return Placed { txn: Some(txn), finding: Some(Finding::LocalEcho), other: Some(txn) };
        }
        if seen.mode == Mode::Tcp {
            if self.open.len() >= OPEN_LIMIT {
                self.give_up_oldest(functions, seen.start, done);
            }
        } else {
            // A request long before the time-out, to another unit, comes from another master: the first one goes on waiting.
            let early = self.open.len() == 1 && self.too_early(seen);
            while self.open.len() > usize::from(early) {
                self.give_up_oldest(functions, seen.start, done);
            }
        }
        let mut exchange = self.start(seen, next_txn);
        exchange.request.fill(seen);
        exchange.findings.extend_from_slice(seen.codes);
        exchange.gap = seen.gap;
        let txn = exchange.txn;
        let mut placed = Placed { txn: Some(txn), ..Placed::default() };
        if let Some((last, unit, pdu)) = &self.failed {
            if *last + 1 == txn && *unit == exchange.unit && *pdu == exchange.request.pdu {
                exchange.retry_of = Some(*last);
                exchange.findings.push(Finding::Retry);
                placed.finding = Some(Finding::Retry);
                placed.other = Some(*last);
            }
        }
        if exchange.unit == BROADCAST && seen.mode != Mode::Tcp {
            exchange.status = Status::Broadcast;
            let row = functions.row(exchange.function, exchange.request.pdu.get(1..).unwrap_or(&[]));
            if row.is_some_and(|row| row.operation == Operation::Read) {
                exchange.findings.push(Finding::BroadcastRead);
                placed.finding = Some(Finding::BroadcastRead);
            }
            done.push(exchange);
        } else {
            exchange.silent = silent(functions, &exchange);
            self.open.push_back(exchange);
        }
        placed
    }

    fn too_early(&self, seen: &Seen<'_>) -> bool {
        let Some(open) = self.open.back().filter(|open| open.unit != seen.unit() && !open.silent && open.response.frame == 0)
        else {
            return false;
        };
        let waited = seen.start.zip(open.request.end).map(|(start, end)| start - end);
        let limit = self.tempo.timeout.map_or(NO_TIMEOUT, |timeout| timeout as Ns / 2);
        seen.clean_start && waited.is_some_and(|waited| waited < limit)
    }

    fn response(&mut self, functions: &Functions, seen: &Seen<'_>, next_txn: &mut u64, done: &mut Vec<Box<Exchange>>) -> Placed {
        let Some(at) = self.answered(functions, seen) else {
            return self.unrequested(functions, seen, next_txn, done);
        };
        let mut exchange = self.open.remove(at).expect("found above");
        exchange.sure = !seen.tentative;
        let overtaken = at == 0 && self.open.front().is_some_and(|later| seen.mode != Mode::Tcp && later.txn > exchange.txn);
        self.last = Some((seen.unit(), seen.pdu().to_vec(), exchange.retry_of.is_some()));
        exchange.response.fill(seen);
        exchange.findings.extend_from_slice(seen.codes);
        exchange.exception =
            seen.pdu().first().filter(|&code| code & EXCEPTION_BIT != 0).and_then(|_| seen.pdu().get(1).copied());
        if exchange.status != Status::BadRequest {
            exchange.status = if exchange.exception.is_some() { Status::Exception } else { Status::Ok };
        }
        if exchange.exception.is_some() {
            exchange.findings.push(Finding::Exception);
        }
        exchange.response_time = self.since(exchange.request.end, seen);
        if let Some(time) = exchange.response_time {
            Tempo::learn(&mut self.tempo.answer, time);
        }
        let mut placed = Placed { txn: Some(exchange.txn), ..Placed::default() };
        if overtaken {
            exchange.findings.push(Finding::TwoMasters);
            placed.finding = Some(Finding::TwoMasters);
        }
        done.push(exchange);
        placed
    }

    /// Which open request the response answers.
    fn answered(&self, functions: &Functions, seen: &Seen<'_>) -> Option<usize> {
        let fits = |exchange: &Exchange| {
            let asked = Asked { unit: exchange.unit, pdu: &exchange.request.pdu };
            !exchange.given_up && answers(functions, asked, seen.unit(), seen.pdu()) != Match::No
        };
        // Serial frames have no identifier: all are the same.
        self.open.iter().position(|exchange| exchange.mbap_id == seen.mbap_id && fits(exchange))
    }

    fn since(&self, end: Option<Ns>, seen: &Seen<'_>) -> Option<Ns> {
        let time = seen.start? - end?;
        (seen.clean_start && time >= 2 * self.resolution && time >= 0).then_some(time)
    }

    fn unrequested(
        &mut self,
        functions: &Functions,
        seen: &Seen<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<Exchange>>,
    ) -> Placed {
        let mut exchange = self.start(seen, next_txn);
        exchange.response.fill(seen);
        exchange.findings.extend_from_slice(seen.codes);
        exchange.status = Status::Unrequested;
        exchange.exception =
            seen.pdu().first().filter(|&code| code & EXCEPTION_BIT != 0).and_then(|_| seen.pdu().get(1).copied());
        exchange.gap = seen.gap;
        let mut placed = Placed { txn: Some(exchange.txn), finding: Some(Finding::Unrequested), other: None };
        let again = self.open.is_empty()
            && self.last.as_ref().is_some_and(|(unit, pdu, retry)| !retry && *unit == seen.unit() && pdu == seen.pdu());
        let late = |unit: u8, pdu: &[u8]| answers(functions, Asked { unit, pdu }, seen.unit(), seen.pdu()) == Match::Fully;
        let open = self.open.iter().find(|old| old.given_up && late(old.unit, &old.request.pdu));
        let candidate = open.map(|old| (old.txn, old.request.end)).or_else(|| {
            let recent = |old: &Unanswered| old.txn + LATE_BY >= exchange.txn;
            let at = self.unanswered.iter().rposition(|old| recent(old) && late(old.unit, &old.pdu))?;
            self.unanswered.remove(at).map(|old| (old.txn, old.end))
        });
        if again {
            placed.finding = Some(Finding::Duplicate);
        } else if let Some((txn, end)) = candidate {
            exchange.late_for = Some(txn);
            exchange.late_response = self.since(end, seen);
            placed = Placed { finding: Some(Finding::LateResponse), other: Some(txn), ..placed };
        } else if let Some(open) = self.open.back() {
            placed.other = Some(open.txn);
            let asked = Asked { unit: exchange.unit, pdu: &open.request.pdu };
            if open.unit != exchange.unit
                && seen.clean_start
                && answers(functions, asked, seen.unit(), seen.pdu()) == Match::Fully
            {
                placed.finding = Some(Finding::WrongUnit);
            } else if open.unit == exchange.unit && open.function != exchange.function {
                placed.finding = Some(Finding::WrongFunction);
            }
        }
        exchange.findings.extend(placed.finding);
        done.push(exchange);
        placed
    }

    fn damaged(
        &mut self,
        functions: &Functions,
        seen: &Seen<'_>,
        direction: Direction,
        next_txn: &mut u64,
        done: &mut Vec<Box<Exchange>>,
    ) -> Placed {
        if let Some(open) = self.open.back_mut().filter(|open| !open.given_up) {
            let ours = seen.unit() == open.unit && seen.function() == open.function;
            if open.response.frame == 0 && (ours || direction != Direction::Request) {
                open.response.fill(seen);
                open.findings.extend_from_slice(seen.codes);
                return Placed { txn: Some(open.txn), ..Placed::default() };
            }
        }
        let request_like = direction == Direction::Request && functions.name(seen.function()).is_some();
        if seen.mode == Mode::Tcp || !request_like || seen.verdict != Verdict::BadChecksum {
            return Placed::default();
        }
        while !self.open.is_empty() {
            self.give_up_oldest(functions, seen.start, done);
        }
        let mut exchange = self.start(seen, next_txn);
        exchange.request.fill(seen);
        exchange.gap = seen.gap;
        exchange.status = Status::BadRequest;
        exchange.findings.extend_from_slice(seen.codes);
        let txn = exchange.txn;
        self.open.push_back(exchange);
        Placed { txn: Some(txn), ..Placed::default() }
    }

    /// Closes the oldest open request: another one came.
    fn give_up_oldest(&mut self, functions: &Functions, next: Option<Ns>, done: &mut Vec<Box<Exchange>>) {
        let Some(mut exchange) = self.open.pop_front() else { return };
        exchange.waited = next.zip(exchange.request.end).map(|(next, end)| next - end).filter(|&ns| ns >= 2 * self.resolution);
        // Functions whose answers look like requests must not teach the time-out that tells them apart.
        if let Some(waited) = exchange
            .waited
            .filter(|_| exchange.response.frame == 0 && !exchange.silent && !echoes_whole(functions, &exchange.request.pdu))
        {
            Tempo::learn(&mut self.tempo.timeout, waited);
        }
        self.close(exchange, Status::NoResponse, done);
    }

    fn close(&mut self, mut exchange: Box<Exchange>, silence: Status, done: &mut Vec<Box<Exchange>>) {
        if exchange.status != Status::BadRequest {
            exchange.status = if exchange.response.frame != 0 { Status::BadResponse } else { silence };
        }
        if matches!(exchange.status, Status::NoResponse | Status::BadResponse) && !exchange.silent {
            self.failed = Some((exchange.txn, exchange.unit, exchange.request.pdu.clone()));
        }
        if exchange.status == Status::NoResponse && !exchange.silent {
            exchange.findings.push(Finding::NoResponse);
            if self.unanswered.len() == REMEMBERED {
                self.unanswered.pop_front();
            }
            let (txn, unit, end) = (exchange.txn, exchange.unit, exchange.request.end);
            self.unanswered.push_back(Unanswered { txn, unit, end, pdu: exchange.request.pdu.clone() });
        }
        done.push(exchange);
    }

    /// Time has come to `now`: gives up requests whose time-out has passed.
    pub fn tick(&mut self, now: Ns, done: &mut Vec<Box<Exchange>>) {
        for exchange in &mut self.open {
            exchange.given_up |= exchange.request.end.is_some_and(|end| now - end >= self.timeout);
        }
        // A live tap reports at once; in a recording the row waits for the next request, to tell how long the master waited.
        while self.live && self.open.front().is_some_and(|exchange| exchange.given_up) {
            let exchange = self.open.pop_front().expect("checked above");
            self.close(exchange, Status::NoResponse, done);
        }
    }

    /// The recording is over.
    pub fn finish(&mut self, done: &mut Vec<Box<Exchange>>) {
        while let Some(exchange) = self.open.pop_front() {
            let status = if exchange.given_up { Status::NoResponse } else { Status::NotSeen };
            self.close(exchange, status, done);
        }
    }
}

fn silent(functions: &Functions, exchange: &Exchange) -> bool {
    let body = exchange.request.pdu.get(1..).unwrap_or(&[]);
    functions.row(exchange.function, body).is_some_and(|row| row.response == Layout::Silent)
}

fn echoes_whole(functions: &Functions, pdu: &[u8]) -> bool {
    pdu.split_first().and_then(|(&code, body)| functions.row(code, body)).is_none_or(|row| row.request == row.response)
}
