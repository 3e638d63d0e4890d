//! The requests of a connection that wait for their answer at the same time, and whether the client takes each answer for
//! that of the request after it.
//!
//! A client that gives up on a request and goes on over the same connection still gets the answer, if only later. If it takes
//! that for the answer to its next request, it lags one step from then on: answer n-1 follows request n, and the client
//! goes on before answer n has come. So it is as well, where the server is the one that is one step late: answer n-1 follows
//! request n as soon as answers normally come, and answer n does not come in time. A client that compares transaction
//! identifiers drops a late answer and goes on waiting (MODBUS Messaging on TCP/IP, 4.3.2); a slow server answers late by any
//! time; and a client that wants several requests in flight sends them without waiting at all.
//!
//! A gateway that keeps an answer back gives each answer the identifier of the request after its own. Then identifiers show
//! nothing, but what was asked does: the answer has unit, function and length of the request before, and not those of its own.
//! The unit shows it only where answers have come from several: some gateways answer with one number whatever was asked.

use std::collections::VecDeque;

use crate::fast_path::expected_exchange::ExpectedExchange;
use crate::records::FirstWait;
use modlens_protocol::Ns;

/// Bytes of unit, function and byte count in front of the data of an answer; an exception has no more.
pub(crate) const READ_HEADER_BYTES: usize = 3;

/// Requests that are remembered, the newest ones.
const MAX_REMEMBERED: usize = 64;

/// An answer comes soon if it takes less than so many times the longest normal one.
const SOON: Ns = 2;

/// What an answer is like, or what a request wants it to be like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct AnswerShape {
    pub(crate) unit: u8,
    pub(crate) function: u8,
    /// Bytes from the unit on; `None` where the request does not say, and of exceptions.
    pub(crate) length: Option<usize>,
}

impl AnswerShape {
    /// What the answer of an exchange is like.
    #[inline]
    pub(crate) fn of(exchange: &ExpectedExchange) -> Self {
        let length = Some(exchange.response_bytes).filter(|&bytes| bytes > READ_HEADER_BYTES);
        Self { unit: exchange.unit, function: exchange.code, length }
    }

    fn fits(self, asked: Self, by_unit: bool) -> bool {
        let is_length = self.length.zip(asked.length).is_none_or(|(own, other)| own == other);
        (self.unit == asked.unit || !by_unit) && self.function == asked.function && is_length
    }
}

/// A request that has no answer yet.
#[derive(Clone, Copy, Debug)]
struct Sent {
    /// Transaction identifier; `None` where the framing has none.
    id: Option<u16>,
    time: Option<Ns>,
    /// The client waits for its answer no more.
    is_given_up: bool,
}

/// An answer may be that of a request so many before the newest one: each timeout of the client adds one.
const MOST_LAG: usize = 3;

/// So many answers in a row that fit an earlier request alone are no accident. Of several earlier requests one fits by chance more
/// often.
const LEAST_BEHIND: [u32; 1 + MOST_LAG] = [0, 1, 3, 3];

/// The requests of a connection that have no answer yet, and what they have shown.
#[derive(Clone, Debug, Default)]
pub(crate) struct InFlight {
    waiting: VecDeque<Sent>,
    /// Whether the newest of all requests is among them.
    newest_waits: bool,
    /// The most that waited at the same time.
    pub(crate) most: u32,
    /// Answers that came in the place of those to the request after theirs.
    pub(crate) lockstep: u64,
    /// The longest time to an answer of a request that waited alone.
    longest: Ns,
    /// How long the client waited when it last gave up a request.
    patience: Option<Ns>,
    /// The answer to the request before the newest one has come so long after that one, while it waited.
    stale_answer: Option<Ns>,
    /// What the newest request wants, and what those before it wanted.
    asked: [Option<AnswerShape>; 1 + MOST_LAG],
    /// How many answers in a row fitted the request so many before the newest one, and not that one.
    behind: [u32; 1 + MOST_LAG],
    /// The unit of the answers, and whether some have come from another one.
    answering: Option<(u8, bool)>,
    /// When the first answer came in the place of that to the request after its own.
    pub(crate) lockstep_since: Option<Ns>,
    /// When the last one came, and how many answers had come then.
    pub(crate) lockstep_until: (Option<Ns>, u64),
    /// Answers.
    pub(crate) answers: u64,
    /// When the last one came.
    pub(crate) last_answer: Option<Ns>,
    /// When the first request that was not answered at once came.
    pub(crate) first_request: Option<Ns>,
    /// How long the first request waited for the first answer.
    pub(crate) first_wait: FirstWait,
}

impl InFlight {
    /// Whether a request that comes waits alone, and the next answer is its own.
    #[inline]
    pub(crate) fn is_idle(&self) -> bool {
        self.waiting.is_empty() && self.stale_answer.is_none() && self.behind.iter().all(|answers| *answers == 0)
    }

    /// Notes requests with their answers, one after the other, where it `is_idle`: how many, how long the slowest answer took, what
    /// the last one was like and when it came.
    #[inline]
    pub(crate) fn lone_exchanges(&mut self, exchanges: u64, longest: Ns, last: AnswerShape, last_answer: Ns) {
        self.most = self.most.max(1);
        self.longest = self.longest.max(longest);
        self.asked = [None; 1 + MOST_LAG];
        self.asked[0] = Some(last);
        self.note_unit(last.unit);
        if self.answers == 0 {
            self.first_wait = FirstWait { asked: Some(last_answer - longest), answered: Some(last_answer), requests: exchanges };
        }
        self.answers += exchanges;
        self.last_answer = Some(last_answer);
    }

    /// Notes a request with its answer, one after the other.
    #[inline]
    pub(crate) fn exchange(
        &mut self,
        (id, shape): (Option<u16>, AnswerShape),
        [asked, answered]: [Ns; 2],
        may_give_up: impl Fn(Ns) -> bool,
    ) {
        if self.is_idle() {
            return self.lone_exchanges(1, answered - asked, shape, answered);
        }
        self.request((id, shape), Some(asked), may_give_up);
        self.answer((id, shape), Some(answered));
    }

    /// Notes a request with its time. `may_give_up` says whether a client that has waited so long can have given up.
    pub(crate) fn request(
        &mut self,
        (id, shape): (Option<u16>, AnswerShape),
        time: Option<Ns>,
        may_give_up: impl Fn(Ns) -> bool,
    ) {
        self.asked.rotate_right(1);
        self.asked[0] = Some(shape);
        self.first_request = self.first_request.or(time);
        if self.answers == 0 {
            self.first_wait.asked = self.first_wait.asked.or(time);
            self.first_wait.requests += 1;
        }
        let waited = self.waiting.back().and_then(|newest| Some(time? - newest.time?));
        let has_given_up = waited.is_some_and(|waited| waited > self.longest && may_give_up(waited));
        let goes_on = waited.zip(self.patience).is_some_and(|(waited, limit)| waited < limit);
        if self.stale_answer.take().is_some_and(|delay| goes_on || delay < SOON * self.longest) {
            self.note_lockstep(time);
            self.give_up();
        } else if has_given_up {
            self.patience = waited;
            self.give_up();
        }
        if self.waiting.len() == MAX_REMEMBERED {
            self.waiting.pop_front();
        }
        self.waiting.push_back(Sent { id, time, is_given_up: false });
        self.newest_waits = true;
        self.most = self.most.max(self.waiting.iter().filter(|sent| !sent.is_given_up).count() as u32);
    }

    /// Notes an answer with its time: to the newest request of its identifier, or to the newest one of all where no request
    /// has its identifier.
    pub(crate) fn answer(&mut self, (id, shape): (Option<u16>, AnswerShape), time: Option<Ns>) {
        if self.answers == 0 {
            self.first_wait.answered = time;
        }
        self.answers += 1;
        self.last_answer = time;
        let newest = self.waiting.len().wrapping_sub(1);
        let at = self.waiting.iter().rposition(|sent| sent.id == id).unwrap_or(newest);
        let Some(sent) = self.waiting.remove(at) else { return };
        if at == newest {
            // Where answers overtake each other, the newest request that still waits is not the newest one that was sent.
            if std::mem::take(&mut self.newest_waits) {
                self.compare(shape, time);
            }
            self.stale_answer = None;
            if let Some(took) = time.zip(sent.time).map(|(answered, asked)| answered - asked).filter(|_| self.waiting.is_empty())
            {
                self.longest = self.longest.max(took);
            }
            self.waiting.retain(|sent| !sent.is_given_up);
        } else if sent.is_given_up && newest - at <= MOST_LAG {
            self.stale_answer = self.waiting.back().and_then(|newest| Some(time? - newest.time?));
        }
    }

    /// Compares an answer that by its identifier belongs to the newest request with what was asked.
    fn compare(&mut self, answer: AnswerShape, time: Option<Ns>) {
        self.note_unit(answer.unit);
        let by_unit = self.answering.is_some_and(|(_, several)| several);
        let fits = self.asked.map(|asked| asked.is_some_and(|asked| answer.fits(asked, by_unit)));
        for (answers, fits_before) in self.behind.iter_mut().zip(fits).skip(1) {
            // Of one request after another of the same kind, each answer fits both: it is as those around it.
            *answers = match (fits[0], fits_before) {
                (false, true) => answers.saturating_add(1),
                (_, false) => 0,
                (true, true) => *answers,
            };
        }
        let is_behind = |lag: usize| fits[lag] && self.behind[lag] >= LEAST_BEHIND[lag];
        if (1..=MOST_LAG).any(is_behind) {
            self.note_lockstep(time);
        }
    }

    #[inline]
    fn note_unit(&mut self, unit: u8) {
        let (first, several) = self.answering.unwrap_or((unit, false));
        self.answering = Some((first, several || first != unit));
    }

    fn note_lockstep(&mut self, time: Option<Ns>) {
        self.lockstep += 1;
        self.lockstep_since = self.lockstep_since.or(time);
        self.lockstep_until = (time, self.answers);
    }

    fn give_up(&mut self) {
        self.waiting.iter_mut().for_each(|sent| sent.is_given_up = true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    /// Plays requests (`Ok`) and answers (`Err`) with their identifiers and times in ms; a client may give up after 50 ms.
    fn played(events: &[(Result<u16, u16>, Ns)]) -> (u32, u64) {
        let alike: Vec<_> = events.iter().map(|(what, at)| (*what, *at, 9)).collect();
        played_with_lengths(&alike)
    }

    /// The same with the lengths that requests want their answers to have, and those of the answers.
    fn played_with_lengths(events: &[(Result<u16, u16>, Ns, usize)]) -> (u32, u64) {
        let mut seen = InFlight::default();
        for (what, at, length) in events {
            let shape = AnswerShape { unit: 1, function: 3, length: Some(*length) };
            match what {
                Ok(id) => seen.request((Some(*id), shape), Some(at * MS), |waited| waited >= 50 * MS),
                Err(id) => seen.answer((Some(*id), shape), Some(at * MS)),
            }
        }
        (seen.most, seen.lockstep)
    }

    #[test]
    fn requests_before_the_first_answer_are_counted() {
        let shape = AnswerShape { unit: 1, function: 3, length: Some(9) };
        let mut seen = InFlight::default();
        for (id, at) in [(1, 0), (2, 3000), (3, 6000)] {
            seen.request((Some(id), shape), Some(at * MS), |_| true);
        }
        seen.answer((Some(1), shape), Some(7000 * MS));
        seen.request((Some(4), shape), Some(8000 * MS), |_| true);
        let waited = FirstWait { asked: Some(0), answered: Some(7000 * MS), requests: 3 };
        assert_eq!(seen.first_wait, waited);
        let mut soon = InFlight::default();
        soon.exchange((Some(1), shape), [10 * MS, 14 * MS], |_| true);
        assert_eq!(soon.first_wait, FirstWait { asked: Some(10 * MS), answered: Some(14 * MS), requests: 1 });
    }

    #[test]
    fn an_answer_may_be_two_requests_late() {
        // After two timeouts each answer is that of the request before the last, by its identifier ...
        let by_id = [
            (Ok(0), 0),
            (Err(0), 10),
            (Ok(1), 100),
            (Ok(2), 160),
            (Ok(3), 220),
            (Err(1), 221),
            (Ok(4), 300),
            (Err(2), 301),
            (Ok(5), 380),
        ];
        assert_eq!(played(&by_id), (1, 2));
        // ... or by its length, where the identifier is that of the newest one: six such answers, and the first two may be chance.
        let by_length: Vec<_> = (0..8u16)
            .flat_map(|at| {
                let length = |of: u16| 9 + 2 * usize::from(of);
                let answered = if at < 2 { at } else { at - 2 };
                [(Ok(at), i64::from(at) * 100, length(at)), (Err(at), i64::from(at) * 100 + 5, length(answered))]
            })
            .collect();
        assert_eq!(played_with_lengths(&by_length), (1, 4));
    }

    #[test]
    fn one_request_after_the_other_is_one_in_flight() {
        assert_eq!(played(&[(Ok(1), 0), (Err(1), 10), (Ok(2), 100), (Err(2), 110)]), (1, 0));
    }

    #[test]
    fn a_client_that_takes_the_late_answer_for_the_next_one_is_a_step_behind() {
        // Request 1 is given up after 300 ms; its answer is taken for that of request 2, and so on.
        let late = [(Ok(1), 0), (Ok(2), 300), (Err(1), 350), (Ok(3), 351), (Err(2), 400), (Ok(4), 401), (Err(3), 450)];
        assert_eq!(played(&late), (1, 2));
    }

    #[test]
    fn a_client_that_drops_the_late_answer_is_not() {
        let dropped = [(Ok(1), 0), (Ok(2), 300), (Err(1), 350), (Err(2), 400), (Ok(3), 500), (Err(3), 510)];
        assert_eq!(played(&dropped), (1, 0));
        // The server is always slower than the client waits: each request is given up after 300 ms.
        let slow = [(Ok(1), 0), (Ok(2), 300), (Err(1), 350), (Ok(3), 600), (Err(2), 700), (Ok(4), 900)];
        assert_eq!(played(&slow), (1, 0));
    }

    #[test]
    fn a_server_that_answers_the_request_before_is_a_step_behind() {
        // Answers take 5 ms. That to request 2 does not come; from then on each request is given the answer to the one before,
        // which the client drops, and it gives up the request itself after 250 ms.
        let mut events = vec![(Ok(1), 0), (Err(1), 5), (Ok(2), 100), (Ok(3), 350)];
        for id in 2..7 {
            let asked = 350 + 250 * Ns::from(id - 2);
            events.extend([(Err(id), asked + 5), (Ok(id + 2), asked + 250)]);
        }
        assert_eq!(played(&events), (1, 5));
    }

    #[test]
    fn requests_that_are_sent_without_waiting_are_in_flight_together() {
        let window = [(Ok(1), 0), (Ok(2), 1), (Err(1), 20), (Ok(3), 21), (Err(2), 40), (Ok(4), 41), (Err(3), 60)];
        assert_eq!(played(&window), (2, 0));
    }

    #[test]
    fn answers_that_overtake_each_other_are_in_step() {
        // Bursts of three requests for other lengths each, answered in all orders with their own identifiers.
        let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let mut events = Vec::new();
        for turn in 0..24u16 {
            let at = Ns::from(turn) * 100;
            events.extend([0, 1, 2].map(|one: u16| (Ok(3 * turn + one), at, 5 + 2 * usize::from(one))));
            let answered = orders[usize::from(turn) % 6].into_iter().zip([10, 11, 19]);
            events.extend(answered.map(|(one, took)| (Err(3 * turn + one), at + took, 5 + 2 * usize::from(one))));
        }
        assert_eq!(played_with_lengths(&events), (3, 0));
    }

    #[test]
    fn a_gateway_that_is_one_answer_late_is_a_step_behind() {
        // Three requests in turn, for 5, 7 and 7 bytes. The third is not answered; from then on each gets the answer before.
        let mut events = Vec::new();
        let wanted = [5, 7, 7];
        for turn in 0..9u16 {
            let (at, this) = (Ns::from(turn) * 100, usize::from(turn));
            events.push((Ok(turn), at, wanted[this % 3]));
            if turn != 2 {
                let answered = if turn < 2 { this } else { this - 1 };
                events.push((Err(turn), at + 10, wanted[answered % 3]));
            }
        }
        assert_eq!(played_with_lengths(&events), (1, 6));
    }

    #[test]
    fn a_unit_that_sends_other_lengths_than_asked_for_is_not() {
        let mut events = Vec::new();
        for turn in 0..9u16 {
            let at = Ns::from(turn) * 100;
            events.extend([(Ok(turn), at, if turn % 2 == 0 { 5 } else { 7 }), (Err(turn), at + 10, 9)]);
        }
        assert_eq!(played_with_lengths(&events), (1, 0));
    }
}
