//! Answers: asked for, late, repeated, damaged, or from somebody else.

use crate::pairing::masters::Meeting;
use crate::pairing::past::Again;
use crate::pairing::{Exchange, Note, Pairing, Placed, Seen};
use modlens_protocol::direction::{answers, Asked, Direction, Match};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// An answer from another unit than the one asked. What the master does next shows whether it was meant.
#[derive(Debug)]
pub(super) struct Stray {
    pub exchange: Box<Exchange>,
    /// The transaction that asked.
    pub asked: u64,
}

/// An answer to nobody. The request may be seen later, if its line's adapter holds it back for longer than was known.
#[derive(Debug)]
pub(super) struct Early {
    unit: u8,
    pdu: Vec<u8>,
    start: Ns,
}

impl Pairing {
    /// A request is there: how much later was it seen than the answer to it, if that was taken for nobody's?
    pub(super) fn learn_skew(&mut self, functions: &Functions, seen: &Seen<'_>) {
        let Some((early, asked)) = self.early.take().zip(seen.end) else { return };
        let request = Asked { unit: seen.unit(), pdu: seen.pdu() };
        if answers(functions, request, early.unit, &early.pdu) == Match::Fully {
            self.tempo.saw(asked, early.start);
        }
    }

    pub(super) fn response(
        &mut self,
        functions: &Functions,
        seen: &Seen<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<Exchange>>,
    ) -> Placed {
        let partial = self.partial.take();
        let Some(at) = self.answered(functions, seen).or_else(|| self.answers_partial(functions, partial, seen, next_txn, done))
        else {
            return self.unrequested(functions, seen, next_txn, done);
        };
        self.early = None;
        let mut exchange = self.open.remove(at).expect("found above");
        exchange.sure = !seen.tentative;
        self.past.answered(&exchange, seen);
        exchange.response.fill(seen);
        exchange.findings.extend_from_slice(seen.codes);
        exchange.exception = exception(seen);
        if exchange.status != Status::BadRequest {
            exchange.status = if exchange.exception.is_some() { Status::Exception } else { Status::Ok };
            self.present[exchange.unit as usize] |= exchange.sure;
        }
        if exchange.exception.is_some() {
            exchange.findings.push(Finding::Exception);
        }
        exchange.response_time = self.since(exchange.request.end, seen.start, seen.clean_start);
        if let (false, Some((asked, told))) = (self.ordered, exchange.request.end.zip(seen.start)) {
            self.tempo.saw(asked, told);
        }
        // Answers that look like requests must not teach the times that tell the two apart.
        if let Some(time) = exchange.response_time.filter(|_| exchange.request.pdu() != exchange.response.pdu()) {
            self.tempo.answered(time);
        }
        let mut placed = Placed { txn: Some(exchange.txn), ..Placed::default() };
        // Where the order is a guess, it proves nothing.
        if seen.mode != Mode::Tcp && self.ordered {
            self.meeting(&mut exchange, seen, &mut placed);
        }
        if exchange.mbap_id != seen.mbap_id {
            exchange.findings.push(Finding::TransactionId);
            placed.finding = Some(Finding::TransactionId);
        }
        done.push(exchange);
        placed
    }

    /// Opens the request that lacks bytes, if this is the answer to it.
    fn answers_partial(
        &mut self,
        functions: &Functions,
        partial: Option<Box<Exchange>>,
        seen: &Seen<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<Exchange>>,
    ) -> Option<usize> {
        let request = partial.filter(|request| (request.unit, request.function) == (seen.unit(), seen.function()))?;
        self.settle_stray(None, done);
        while !self.open.is_empty() {
            self.give_up_oldest(functions, seen, done);
        }
        self.open_partial(request, next_txn);
        Some(0)
    }

    /// Which open request the response answers.
    fn answered(&self, functions: &Functions, seen: &Seen<'_>) -> Option<usize> {
        let fits = |exchange: &Exchange| {
            let asked = Asked { unit: exchange.unit, pdu: exchange.request.pdu() };
            !exchange.given_up && answers(functions, asked, seen.unit(), seen.pdu()) != Match::No
        };
        // Serial frames have no identifier: all are the same.
        let own = self.open.iter().position(|exchange| exchange.mbap_id == seen.mbap_id && fits(exchange));
        // Some devices answer with an identifier of their own, the same for ever. One that was asked with is no such.
        let foreign = || seen.mbap_id.is_some_and(|id| !self.ids.contains(&id));
        own.or_else(|| if foreign() { self.open.iter().position(|exchange| fits(exchange)) } else { None })
    }

    /// Whether this answer proves, with the others, that two masters talk. Older proofs become notes: of two exchanges, the
    /// one that is told only now says it.
    fn meeting(&mut self, exchange: &mut Exchange, seen: &Seen<'_>, placed: &mut Placed) {
        if let Some(inside) = exchange.inside {
            let (txn, unit, other, clear) = (exchange.txn, exchange.unit, inside.txn, inside.clear);
            let meeting = Meeting { txn, frame: seen.frame, unit, start: seen.start, other, clear, origin: seen.origin };
            if inside.answered {
                self.masters.met(meeting);
            } else {
                self.halfway = Some(meeting);
            }
        }
        for first in self.open.iter_mut().filter_map(|open| open.inside.as_mut()) {
            first.answered |= first.txn == exchange.txn;
        }
        if let Some(meeting) = self.halfway.take_if(|meeting| meeting.other == exchange.txn) {
            self.masters.met(meeting);
        }
        for meeting in self.masters.proofs() {
            let here = meeting.txn == exchange.txn || meeting.other == exchange.txn;
            if !here {
                self.notes.push(Note { finding: Finding::TwoMasters, meeting });
            } else if placed.finding.is_none() {
                exchange.findings.push(Finding::TwoMasters);
                placed.finding = Some(Finding::TwoMasters);
                placed.other = (meeting.other == exchange.txn).then_some(meeting.txn);
            }
        }
    }

    /// The time from the end of a request to a start, if that is exact and the clock can tell.
    pub fn since(&self, end: Option<Ns>, start: Option<Ns>, exact: bool) -> Option<Ns> {
        let time = start? - end?;
        (exact && time >= 2 * self.resolution && time >= 0).then_some(time)
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
        exchange.exception = exception(seen);
        exchange.gap = seen.gap;
        let mut placed = Placed { txn: Some(exchange.txn), finding: Some(Finding::Unrequested), other: None };
        let given_up = |old: &Exchange| {
            let asked = Asked { unit: old.unit, pdu: old.request.pdu() };
            let fits = answers(functions, asked, seen.unit(), seen.pdu()) == Match::Fully;
            old.given_up && !old.late_seen && fits && self.past.knows_all_since(old.txn)
        };
        // A request that arrived damaged may be what this answers.
        let damaged = self.open.back().is_some_and(|open| open.status == Status::BadRequest);
        let mut stranger = false;
        let open = self.open.iter().position(|old| given_up(old));
        let late = match open.and_then(|at| self.open.get_mut(at)) {
            Some(old) => {
                old.late_seen = true;
                Some((old.txn, old.request.end))
            }
            None if damaged => None,
            None => match self.past.again(functions, seen, exchange.txn, self.open.is_empty()) {
                Again::Duplicate => {
                    placed.finding = Some(Finding::Duplicate);
                    None
                }
                Again::Late(old) => Some((old.txn, old.end)),
                Again::Unclear => None,
                Again::No => {
                    stranger = true;
                    None
                }
            },
        };
        if let Some((txn, end)) = late {
            exchange.late_for = Some(txn);
            exchange.late_response = self.since(end, seen.start, seen.clean_start);
            placed = Placed { finding: Some(Finding::LateResponse), other: Some(txn), ..placed };
        } else if placed.finding == Some(Finding::Unrequested) {
            if let (true, None, Some(start)) = (stranger && !self.ordered, &self.early, seen.start) {
                self.early = Some(Early { unit: seen.unit(), pdu: seen.pdu().to_vec(), start });
            }
            if let Some(asked) = self.misdirected(functions, seen) {
                self.settle_stray(None, done);
                exchange.findings.push(Finding::Unrequested);
                self.stray = Some(Stray { exchange, asked });
                return placed;
            }
            if let Some(open) = self.open.back().filter(|open| open.unit == exchange.unit && open.function != exchange.function) {
                placed.other = Some(open.txn);
                placed.finding = Some(Finding::WrongFunction);
            } else if stranger {
                self.past.lacks_requests(exchange.txn);
            }
        }
        exchange.findings.extend(placed.finding);
        done.push(exchange);
        placed
    }

    /// The open request that this would answer, had it come from the unit asked.
    fn misdirected(&self, functions: &Functions, seen: &Seen<'_>) -> Option<u64> {
        let open = self.open.back().filter(|open| open.unit != seen.unit() && seen.mode != Mode::Tcp)?;
        let whole = open.status != Status::BadRequest && open.response.frame == 0 && !open.silent;
        let asked = Asked { unit: seen.unit(), pdu: open.request.pdu() };
        let fits = whole && answers(functions, asked, seen.unit(), seen.pdu()) == Match::Fully;
        fits.then_some(open.txn)
    }

    /// The next request is there, or none will come: was the answer from another unit one to the request?
    ///
    /// A master that drops it waits for its time-out, and most ask again. Where the next request comes sooner, the tap
    /// has lost the answer, and the request of what seemed to be the wrong one.
    pub(super) fn settle_stray(&mut self, next: Option<&Seen<'_>>, done: &mut Vec<Box<Exchange>>) {
        let Some(Stray { mut exchange, asked }) = self.stray.take() else { return };
        let wrong = self.open.iter().find(|open| open.txn == asked).is_some_and(|open| {
            let again = next.is_some_and(|next| open.unit == next.unit() && open.request.pdu() == next.pdu());
            let waited = next.and_then(|next| next.start).zip(open.request.end).map(|(start, end)| start - end);
            again || open.given_up || waited.is_some_and(|waited| !self.too_soon(waited))
        });
        if wrong {
            exchange.findings.push(Finding::WrongUnit);
            let (frame, start) = (exchange.response.frame, exchange.response.start);
            let (txn, unit, origin) = (exchange.txn, exchange.unit, exchange.origin);
            let meeting = Meeting { txn, frame, unit, start, other: asked, clear: true, origin };
            self.notes.push(Note { finding: Finding::WrongUnit, meeting });
        } else {
            self.past.lacks_requests(exchange.txn);
        }
        done.push(exchange);
    }

    pub(super) fn damaged(
        &mut self,
        functions: &Functions,
        seen: &Seen<'_>,
        next_txn: &mut u64,
        done: &mut Vec<Box<Exchange>>,
    ) -> Placed {
        if let Some(open) = self.open.back_mut().filter(|open| !open.given_up) {
            let ours = seen.unit() == open.unit && seen.function() == open.function;
            if open.response.frame == 0 && (ours || seen.direction != Direction::Request) {
                open.response.fill(seen);
                open.findings.extend_from_slice(seen.codes);
                return Placed { txn: Some(open.txn), ..Placed::default() };
            }
        }
        self.bad_request(functions, seen, next_txn, done)
    }
}

fn exception(seen: &Seen<'_>) -> Option<u8> {
    seen.pdu().first().filter(|&code| code & EXCEPTION_BIT != 0).and_then(|_| seen.pdu().get(1).copied())
}
