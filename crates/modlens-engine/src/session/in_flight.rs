//! The requests of a connection that wait for their answer at the same time, and whether the client takes each answer for
//! that of the request after it.
//!
//! A client that gives up on a request and goes on over the same connection still gets the answer, if only later. If it takes
//! that for the answer to its next request, it lags one step from then on: answer n-1 follows request n, and the client
//! goes on before answer n has come. So it is as well, where the server is the one that is one step late: answer n-1 follows
//! request n as soon as answers normally come, and answer n does not come in time. A client that compares transaction
//! identifiers drops a late answer and goes on waiting (MODBUS Messaging on TCP/IP, 4.3.2); a slow server answers late by any
//! time; and a client that wants several requests in flight sends them without waiting at all.

use std::collections::VecDeque;

use modlens_protocol::Ns;

/// Requests that are remembered, the newest ones.
const MAX_REMEMBERED: usize = 64;

/// An answer comes soon if it takes less than so many times the longest normal one.
const SOON: Ns = 2;

/// A request that has no answer yet.
#[derive(Clone, Copy, Debug)]
struct Sent {
    /// Transaction identifier; `None` where the framing has none.
    id: Option<u16>,
    time: Option<Ns>,
    /// The client waits for its answer no more.
    is_given_up: bool,
}

/// The requests of a connection that have no answer yet, and what they have shown.
#[derive(Clone, Debug, Default)]
pub(crate) struct InFlight {
    waiting: VecDeque<Sent>,
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
}

impl InFlight {
    /// Whether a request that comes waits alone, and the next answer is its own.
    #[inline]
    pub(crate) fn is_idle(&self) -> bool {
        self.waiting.is_empty() && self.stale_answer.is_none()
    }

    /// Notes requests with their answers, one after the other, of which the slowest answer took so long, where it `is_idle`.
    #[inline]
    pub(crate) fn lone_exchanges(&mut self, longest: Ns) {
        self.most = self.most.max(1);
        self.longest = self.longest.max(longest);
    }

    /// Notes a request with its answer, one after the other.
    #[inline]
    pub(crate) fn exchange(&mut self, id: Option<u16>, [asked, answered]: [Ns; 2], may_give_up: impl Fn(Ns) -> bool) {
        if self.is_idle() {
            return self.lone_exchanges(answered - asked);
        }
        self.request(id, Some(asked), may_give_up);
        self.answer(id, Some(answered));
    }

    /// Notes a request with its time. `may_give_up` says whether a client that has waited so long can have given up.
    pub(crate) fn request(&mut self, id: Option<u16>, time: Option<Ns>, may_give_up: impl Fn(Ns) -> bool) {
        let waited = self.waiting.back().and_then(|newest| Some(time? - newest.time?));
        let has_given_up = waited.is_some_and(|waited| waited > self.longest && may_give_up(waited));
        let goes_on = waited.zip(self.patience).is_some_and(|(waited, limit)| waited < limit);
        if self.stale_answer.take().is_some_and(|delay| goes_on || delay < SOON * self.longest) {
            self.lockstep += 1;
            self.give_up();
        } else if has_given_up {
            self.patience = waited;
            self.give_up();
        }
        if self.waiting.len() == MAX_REMEMBERED {
            self.waiting.pop_front();
        }
        self.waiting.push_back(Sent { id, time, is_given_up: false });
        self.most = self.most.max(self.waiting.iter().filter(|sent| !sent.is_given_up).count() as u32);
    }

    /// Notes an answer with its time: to the newest request of its identifier, or to the newest one of all where no request
    /// has its identifier.
    pub(crate) fn answer(&mut self, id: Option<u16>, time: Option<Ns>) {
        let newest = self.waiting.len().wrapping_sub(1);
        let at = self.waiting.iter().rposition(|sent| sent.id == id).unwrap_or(newest);
        let Some(sent) = self.waiting.remove(at) else { return };
        if at == newest {
            self.stale_answer = None;
            if let Some(took) = time.zip(sent.time).map(|(answered, asked)| answered - asked).filter(|_| self.waiting.is_empty())
            {
                self.longest = self.longest.max(took);
            }
            self.waiting.retain(|sent| !sent.is_given_up);
        } else if sent.is_given_up && at + 1 == newest {
            self.stale_answer = self.waiting.back().and_then(|newest| Some(time? - newest.time?));
        }
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
        let mut seen = InFlight::default();
        for (what, at) in events {
            match what {
                Ok(id) => seen.request(Some(*id), Some(at * MS), |waited| waited >= 50 * MS),
                Err(id) => seen.answer(Some(*id), Some(at * MS)),
            }
        }
        (seen.most, seen.lockstep)
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
}
