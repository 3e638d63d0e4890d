//! Requests: new ones, repeated ones, heard ones, and those that come inside another one's exchange.

use crate::pairing::exchange::Inside;
use crate::pairing::past::Request;
use crate::pairing::wreck::Wreck;
use crate::pairing::{Exchange, Pairing, Placed, Seen};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::BROADCAST;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, Layout, Operation};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// No master gives up so soon, as long as it has not shown otherwise (serial line specification, 2.4.1: one second is
/// typical).
const NO_TIMEOUT: Ns = 50_000_000;

/// A master that is known does not give up before this share of its time-out: clocks are late by so much at most.
const SOONEST: f64 = 0.4;

/// The echo of an adapter that hears itself comes within this time: it is the adapter's own delay.
const MOST_ECHO: Ns = 3_000_000;

/// A line is one with echo if more than this share of requests is heard twice, and one without if less than that is.
const ECHO_SHARE: f32 = 0.65;
const NO_ECHO_SHARE: f32 = 0.5;

/// What is thought of that share at first, and how fast it is learned later.
const FIRST_COPIES: f32 = 0.1;
const COPY_RATE: f32 = 0.05;

/// A share so small is none: what is added to it leaves nothing of it.
const NEARLY_NONE: f32 = 1e-12;

/// Requests that may be open at once; a serial line has one, a TCP connection as many as it has transaction ids.
const OPEN_LIMIT: usize = 1024;

/// Transaction identifiers of requests that a late answer may carry.
const IDS: usize = 64;

/// Whether this line's requests are heard twice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Copies {
    /// Share of requests heard twice.
    share: f32,
    seen: f32,
    /// Whether the last request was.
    twice: Option<bool>,
}

impl Default for Copies {
    fn default() -> Self {
        Self { share: FIRST_COPIES, seen: 1.0, twice: None }
    }
}

impl Copies {
    /// A new request: the one before will not be heard again.
    #[inline]
    pub(super) fn next(&mut self) {
        let share = self.with_last();
        // Numbers that are nearly nothing take a processor a hundred times as long.
        self.share = if share < NEARLY_NONE { 0.0 } else { share };
        self.seen += f32::from(u8::from(self.twice.is_some()));
        self.twice = Some(false);
    }

    fn with_last(self) -> f32 {
        let last = self.twice.map_or(self.share, |twice| f32::from(u8::from(twice)));
        // A division for every request would be felt.
        let rate = if self.seen >= 1.0 / COPY_RATE { COPY_RATE } else { (1.0 / (self.seen + 1.0)).max(COPY_RATE) };
        self.share + (last - self.share) * rate
    }

    /// `None` where the line may be either.
    fn echo(self) -> Option<bool> {
        let share = self.with_last();
        (share > ECHO_SHARE).then_some(true).or((share < NO_ECHO_SHARE).then_some(false))
    }
}

/// What the same request is that comes again before any answer.
enum Same {
    /// The tap's adapter heard itself: the transaction is this one.
    Echo(u64),
    /// Either that, or the master asks again.
    Unclear,
    /// The master asks again, or it is another request.
    No,
}

impl Pairing {
    pub(super) fn request(
        &mut self,
        functions: &Functions,
        seen: &Seen<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<Exchange>>,
    ) -> Placed {
        let partial = self.partial.take();
        let same = self.same_again(functions, seen);
        if let Same::Echo(txn) = same {
            return Placed { txn: Some(txn), finding: Some(Finding::LocalEcho), other: Some(txn) };
        }
        self.settle_stray(Some(seen), done);
        if self.early.is_some() {
            self.learn_skew(functions, seen);
        }
        let inside = self.make_room(functions, seen, done);
        if matches!(same, Same::Unclear) {
            self.past.forget_failed();
        }
        if let Some(partial) = partial.filter(|partial| self.begins(partial, seen)) {
            self.open_partial(partial, next_txn);
            self.give_up_oldest(functions, seen, done);
        }
        let mut exchange = self.start(seen, next_txn);
        exchange.request.fill(seen);
        exchange.findings.extend_from_slice(seen.codes);
        exchange.gap = seen.gap;
        let txn = exchange.txn;
        if let (Some(clear), Some(first)) = (inside, self.open.back_mut()) {
            first.waited = first.waited.or(seen.start.zip(first.request.end).map(|(next, end)| next - end));
            first.inside = Some(Inside { txn, clear, answered: false });
        }
        let mut placed = Placed { txn: Some(txn), ..Placed::default() };
        if let Some(before) = self.past.repeated(seen) {
            exchange.retry_of = Some(before.txn);
            exchange.findings.push(Finding::Retry);
            placed.finding = Some(Finding::Retry);
            placed.other = Some(before.txn);
        }
        self.past.broadcast = None;
        if exchange.unit == BROADCAST && seen.mode != Mode::Tcp {
            exchange.status = Status::Broadcast;
            self.past.broadcast = Some(Request::of(&exchange));
            let row = functions.row(exchange.function, exchange.request.pdu().get(1..).unwrap_or(&[]));
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

    /// Gives up what this request shows to be given up. A request that waits on is inside another one's exchange:
    /// whether the clock says so.
    fn make_room(&mut self, functions: &Functions, seen: &Seen<'_>, done: &mut Vec<Box<Exchange>>) -> Option<bool> {
        if seen.mode == Mode::Tcp {
            if let Some(id) = seen.mbap_id {
                self.remember_id(id);
            }
            while self.open.len() >= OPEN_LIMIT || self.open.front().is_some_and(|open| open.given_up) {
                self.give_up_oldest(functions, seen, done);
            }
            return None;
        }
        while self.open.len() > 1 {
            self.give_up_oldest(functions, seen, done);
        }
        let inside = self.open.back().and_then(|open| self.meets(open, seen));
        if inside.is_none() && !self.open.is_empty() {
            self.give_up_oldest(functions, seen, done);
        }
        inside
    }

    pub(super) fn remember_id(&mut self, id: u16) {
        if self.ids.len() == IDS {
            self.ids.pop_front();
        }
        self.ids.push_back(id);
    }

    /// Whether this request does not end the wait of the open one: it may come from another master. `Some(true)` if the
    /// clock says so.
    fn meets(&self, open: &Exchange, seen: &Seen<'_>) -> Option<bool> {
        let waits = open.status != Status::BadRequest && !open.silent && !open.given_up && open.response.frame == 0;
        if open.unit == seen.unit() || !waits || seen.unit() == BROADCAST {
            return None;
        }
        match seen.start.zip(open.request.end) {
            Some((start, end)) => self.too_soon(start - end).then_some(true),
            None => open.inside.is_none().then_some(false),
        }
    }

    /// Whether a master that waited so long for an answer cannot have given up.
    pub(super) fn too_soon(&self, waited: Ns) -> bool {
        let limit = self.tempo.master_waits().map_or(NO_TIMEOUT, |waits| (waits as f64 * SOONEST) as Ns);
        waited < limit
    }

    /// What a request is to the one before, if it is the same: echoes come much sooner than any master asks again.
    fn same_again(&mut self, functions: &Functions, seen: &Seen<'_>) -> Same {
        if seen.mode == Mode::Tcp {
            return Same::No;
        }
        if seen.unit() == BROADCAST {
            let before = self.past.broadcast.take().filter(|before| before.is(seen));
            return before.map_or(Same::No, |before| self.echo_or_retry(seen, before.end, before.txn));
        }
        let open = self.open.back();
        let same = open.filter(|open| open.unit == seen.unit() && open.request.pdu() == seen.pdu() && !open.echoed);
        let same = same.map(|open| (open.request.end, open.txn));
        if !echoes_whole(functions, seen.pdu()) {
            // Of each request in turn: was it heard twice? On a line with time-outs some are, on one with echo all.
            if same.is_some() {
                self.copies.twice = Some(true);
            } else {
                self.copies.next();
            }
        }
        let Some((end, txn)) = same else { return Same::No };
        let same = self.echo_or_retry(seen, end, txn);
        let open = self.open.back_mut().expect("found above");
        match same {
            Same::Echo(_) => {
                open.echoed = true;
                open.findings.push(Finding::LocalEcho);
                // The answer's time counts from the last byte of the request, whoever sent it.
                open.request.end = seen.end.or(open.request.end);
            }
            // It may have no answer because it is one request with the next.
            Same::Unclear => open.blind = true,
            Same::No => {}
        }
        same
    }

    /// By the clock, as far as it can tell; else by the way of this line.
    fn echo_or_retry(&self, seen: &Seen<'_>, end: Option<Ns>, txn: u64) -> Same {
        let pause = seen.start.zip(end).map(|(start, end)| start - end);
        match (pause, self.copies.echo()) {
            (Some(pause), _) if pause < MOST_ECHO && self.lateness <= MOST_ECHO => Same::Echo(txn),
            (Some(pause), Some(true)) if pause < NO_TIMEOUT => Same::Echo(txn),
            (Some(pause), _) if !self.too_soon(pause) => Same::No,
            (Some(_), _) | (None, None) => Same::Unclear,
            (None, Some(true)) => Same::Echo(txn),
            (None, Some(false)) => Same::No,
        }
    }

    /// A request with a wrong checksum: it ends the wait of others, and an answer to it shows that the unit could read it.
    pub(super) fn bad_request(
        &mut self,
        functions: &Functions,
        seen: &Seen<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<Exchange>>,
    ) -> Placed {
        let known = functions.name(seen.function()).is_some() || self.present[usize::from(seen.unit())];
        let request_like = seen.direction == Direction::Request && seen.adu.len() > 1 && known;
        if seen.mode == Mode::Tcp || !request_like {
            return Placed::default();
        }
        if seen.verdict != Verdict::BadChecksum {
            let mut partial = Box::new(Exchange::new(seen.mode));
            (partial.unit, partial.function, partial.origin) = (seen.unit(), seen.function(), seen.origin);
            (partial.gap, partial.status) = (seen.gap, Status::BadRequest);
            partial.request.fill(seen);
            partial.findings.extend_from_slice(seen.codes);
            self.partial = Some(partial);
            self.past.lacks_requests(*next_txn);
            return Placed::default();
        }
        self.settle_stray(None, done);
        while !self.open.is_empty() {
            self.give_up_oldest(functions, seen, done);
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

    /// Whether the master asks again for what it had no answer to, as only the beginning of the request had arrived.
    fn begins(&self, partial: &Exchange, seen: &Seen<'_>) -> bool {
        let waited = seen.start.zip(partial.request.end).map(|(start, end)| start - end);
        Wreck::of(&partial.request.wire).is_of(seen.wire) && waited.is_none_or(|waited| !self.too_soon(waited))
    }

    /// A request that lacks bytes was one, as what follows shows.
    pub(super) fn open_partial(&mut self, mut request: Box<Exchange>, next_txn: &mut u64) {
        request.txn = *next_txn;
        *next_txn += 1;
        self.open.push_back(request);
    }

    /// Closes the oldest open request: another one came.
    pub(super) fn give_up_oldest(&mut self, functions: &Functions, next: &Seen<'_>, done: &mut Vec<Box<Exchange>>) {
        let Some(mut exchange) = self.open.pop_front() else { return };
        let waited = exchange.waited.or(next.start.zip(exchange.request.end).map(|(next, end)| next - end));
        exchange.waited = waited.filter(|&ns| ns >= 2 * self.resolution);
        let again = exchange.unit == next.unit() && exchange.request.pdu() == next.pdu();
        let quiet = exchange.response.frame == 0 && !exchange.silent && exchange.status != Status::BadRequest;
        // Functions whose answers look like requests must not teach the time-out that tells them apart.
        if quiet && next.verdict.good() && !echoes_whole(functions, exchange.request.pdu()) {
            self.masters.unanswered(again);
            if let Some(waited) = exchange.waited.filter(|_| exchange.inside.is_none()) {
                self.tempo.unanswered(waited, again);
            }
        }
        // A master that asks the next one long before its time-out has had an answer: it is the tap that has not.
        let had = waited.is_some_and(|waited| !again && self.too_soon(waited)) && self.present[exchange.unit as usize];
        // Two lines without a clock: only that it is asked again tells of a missing answer rather than of missing bytes.
        let had = had || (self.guessed && !again);
        self.close(exchange, if had { Status::NotSeen } else { Status::NoResponse }, done);
    }
}

fn silent(functions: &Functions, exchange: &Exchange) -> bool {
    let body = exchange.request.pdu().get(1..).unwrap_or(&[]);
    functions.row(exchange.function, body).is_some_and(|row| row.response == Layout::Silent)
}

fn echoes_whole(functions: &Functions, pdu: &[u8]) -> bool {
    pdu.split_first().and_then(|(&code, body)| functions.row(code, body)).is_none_or(|row| row.mirrored)
}
