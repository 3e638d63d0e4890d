//! Which request on the network caused a request on the line.

use modlens_protocol::status::Status;
use modlens_protocol::Ns;

use super::clock::LATENESS;
use super::exchange::{Exchange, Request};
use super::line_memory::Owner;
use super::{Join, HORIZON};

/// Answers of the line are remembered for so many horizons.
const REMEMBERED: Ns = 6 * HORIZON;

/// How well a request on the network fits: the smallest wins.
type Fit = (u8, Ns);

/// It has the same response, returned after the line had it.
const SAME_RESPONSE: u8 = 0;
/// The line repeats the request that it is matched with.
const SAME_REQUEST: u8 = 1;
/// It waits for a response: the order of requests decides.
const IN_ORDER: u8 = 2;

impl Join {
    /// Matches the next request of the line, if all requests of the network that could have caused it have come.
    pub(super) fn match_next(&mut self) -> bool {
        let Some(front) = self.line.queue.front() else { return false };
        let reached = self.network.last.map_or(Ns::MIN, |last| last + self.clocks.offset());
        if !self.network.is_over && reached <= front.start + LATENESS {
            return false;
        }
        self.take_requests_until(front.start + LATENESS - self.clocks.offset());
        if let Some(one) = self.line.queue.pop_front() {
            self.memory.forget(one.start - REMEMBERED);
            self.place(one);
        }
        true
    }

    /// Moves requests of the gateway's server that came until then among those that wait.
    pub(super) fn take_requests_until(&mut self, until: Ns) {
        let Some(server) = self.alignment.as_ref().map(|found| found.server.clone()) else { return };
        while self.network.queue.front().is_some_and(|one| one.start <= until) {
            if let Some(exchange) = self.network.queue.pop_front().filter(|one| one.bus == server) {
                self.requests.push_back(Request { exchange, attempts: Vec::new() });
            }
        }
    }

    /// Finds the request of the network for one of the line.
    fn place(&mut self, one: Exchange) {
        if one.request.is_empty() || one.status == Status::Unsolicited {
            self.memory.add(&one, None);
            return;
        }
        let offset = self.clocks.offset();
        let fits = (0..self.requests.len()).filter_map(|at| Some((self.fit(at, &one)?, at)));
        let mut fits: Vec<(Fit, usize)> = fits.collect();
        fits.sort_unstable();
        let Some(&((kind, _), at)) = fits.first() else {
            self.memory.add(&one, None);
            let is_covered = self.network.first.is_some_and(|first| one.start + LATENESS >= first + offset)
                && self.network.last.is_some_and(|last| one.start <= last + offset + LATENESS);
            self.rows.add_own(&one, one.start - offset, is_covered);
            return;
        };
        let is_certain = kind == SAME_RESPONSE && fits.get(1).is_none_or(|next| next.0 .0 != SAME_RESPONSE);
        let request = &mut self.requests[at];
        let above = &request.exchange;
        if kind == SAME_RESPONSE {
            self.units.entry(above.unit).or_insert(one.unit);
        }
        if let (true, Some(end), Some(above_end)) = (is_certain, one.end, above.end) {
            self.clocks.add(above.start, one.start - above.start, end - above_end);
        }
        let owner = Owner { number: above.number, client: above.client.clone(), connection: above.connection };
        self.memory.add(&one, Some(owner));
        request.attempts.push(one);
    }

    /// How well a request of the network fits one of the line; `None` if it cannot have caused it.
    fn fit(&self, at: usize, one: &Exchange) -> Option<Fit> {
        let request = &self.requests[at];
        let (above, offset) = (&request.exchange, self.clocks.offset());
        let waited = one.start - (above.start + offset);
        if above.request != one.request || !(-LATENESS..=HORIZON).contains(&waited) {
            return None;
        }
        if request.attempts.iter().any(Exchange::is_answered) {
            return None;
        }
        let is_same = one.is_answered() && above.is_answered() && above.response == one.response;
        if !self.is_unit(above.unit, one.unit, is_same) {
            return None;
        }
        match above.end.map(|end| end + offset + LATENESS) {
            // Answered before the line was asked: something else answered it.
            Some(end) if one.start > end => None,
            Some(end) if is_same && one.end.is_some_and(|line_end| line_end <= end) => {
                Some((SAME_RESPONSE, end - one.end.unwrap_or(end)))
            }
            _ => {
                let is_repeated = one.retry_of.is_some() && request.attempts.last().map(|last| last.number) == one.retry_of;
                (is_repeated || !self.is_overtaken(at))
                    .then_some((if is_repeated { SAME_REQUEST } else { IN_ORDER }, above.start))
            }
        }
    }

    /// Whether a later request of the same connection was sent on the line already: a gateway keeps their order.
    fn is_overtaken(&self, at: usize) -> bool {
        let connection = self.requests[at].exchange.connection;
        self.requests.range(at + 1..).any(|later| later.exchange.connection == connection && !later.attempts.is_empty())
    }

    /// Whether the gateway sends requests for a unit of the network to this unit of the line. A unit that was not seen
    /// before goes to its own number, or where an equal response says so.
    fn is_unit(&self, above: u8, below: u8, is_same_response: bool) -> bool {
        match self.units.get(&above) {
            Some(unit) => *unit == below,
            None => above == below || is_same_response && self.units.values().all(|unit| *unit != below),
        }
    }
}
