//! What the gateway did with each request of the network.

use modlens_protocol::status::Status;
use modlens_protocol::Ns;

use super::clock::LATENESS;
use super::exchange::{Exchange, Request};
use super::line_memory::Answer;
use super::rows::Verdict;
use super::{Join, HORIZON};

impl Join {
    /// Decides the requests of the network for which the line can show no more.
    pub(super) fn decide_requests(&mut self) {
        if self.line.is_over && self.line.queue.is_empty() {
            self.take_all_requests();
        } else if let Some(front) = self.line.queue.front() {
            // Requests long before the line's recording begins need not wait for it.
            let until = front.start - HORIZON - self.clocks.offset();
            self.take_requests_until(until);
        }
        while let Some(front) = self.requests.front() {
            if !self.is_decidable(front) {
                return;
            }
            if let Some(request) = self.requests.pop_front() {
                self.decide(&request);
            }
        }
    }

    /// Whether the line has been read so far that nothing more can belong to a request.
    fn is_decidable(&self, request: &Request) -> bool {
        let reached = match self.line.queue.front() {
            Some(front) => front.start,
            None if self.line.is_over => return true,
            None => self.line.last.unwrap_or(Ns::MIN),
        };
        let offset = self.clocks.offset();
        let above = &request.exchange;
        // What was answered causes no request on the line any more; what was not may still wait in the gateway.
        let until = above.end.map_or(above.start + HORIZON, |end| end + LATENESS);
        reached > until + offset
    }

    fn decide(&mut self, request: &Request) {
        let verdict = self.verdict(request);
        if let Some(last) = request.attempts.last().filter(|_| verdict.outcome == "forwarded") {
            self.memory.delivered(last.number);
        }
        if let Some(number) = verdict.answered_by {
            self.memory.delivered(number);
        }
        self.rows.add_request(request, &verdict, self.clocks.offset());
    }

    fn verdict(&self, request: &Request) -> Verdict {
        let (above, offset) = (&request.exchange, self.clocks.offset());
        let begins = self.line.first.map_or(Ns::MAX, |first| first - LATENESS);
        let ends = self.line.last.map_or(Ns::MIN, |last| last + LATENESS);
        if request.attempts.is_empty() && !(begins..=ends).contains(&(above.start + offset)) {
            return Verdict::plain("not_covered");
        }
        if above.request.is_empty() {
            return self.strange_answer(above).unwrap_or(Verdict::plain("unexplained"));
        }
        let Some(below) = request.attempts.last() else { return self.without_line(above) };
        if below.is_answered() {
            return self.with_answer(above, below);
        }
        match above.status {
            Status::Ok | Status::Exception if !above.is_gateway_exception() => self.answer_of_its_own(above),
            Status::BadResponse => self.answer_of_its_own(above),
            Status::Broadcast => Verdict::plain("forwarded"),
            _ => Verdict::plain("no_response"),
        }
    }

    /// A request that never reached the line.
    fn without_line(&self, above: &Exchange) -> Verdict {
        match above.status {
            Status::Ok | Status::BadResponse => self.answer_of_its_own(above),
            _ => Verdict::plain("dropped"),
        }
    }

    /// A request that the line has answered.
    fn with_answer(&self, above: &Exchange, below: &Exchange) -> Verdict {
        let Some(end) = above.end.filter(|_| !above.response.is_empty()).map(|end| end + self.clocks.offset() + LATENESS) else {
            return Verdict::plain("answer_lost");
        };
        let line_end = below.end.unwrap_or(below.start);
        if above.response == below.response && line_end <= end {
            return Verdict::plain("forwarded");
        }
        if above.is_gateway_exception() {
            return Verdict::plain("gateway_timeout");
        }
        self.answer_of_its_own(above)
    }

    /// An answer that is not the line's answer to this request: another's, or one from memory.
    fn answer_of_its_own(&self, above: &Exchange) -> Verdict {
        if let Some(found) = self.strange_answer(above) {
            return found;
        }
        let unit = self.units.get(&above.unit).copied().unwrap_or(above.unit);
        let now = above.end.unwrap_or(above.start) + self.clocks.offset();
        match self.memory.since(unit, above, now + LATENESS) {
            Some(since) => Verdict { outcome: "cached", cache_age: Some((now - since).max(0)), ..Verdict::default() },
            None => Verdict::plain("unexplained"),
        }
    }

    /// The answer to an earlier request of the same client, or to another client's.
    fn strange_answer(&self, above: &Exchange) -> Option<Verdict> {
        let unit = self.units.get(&above.unit).copied().unwrap_or(above.unit);
        let until = above.end.unwrap_or(above.start) + self.clocks.offset() + LATENESS;
        let is_own_request = |answer: &&Answer| answer.unit == unit && answer.request == above.request;
        let verdict = |outcome, answer: &Answer| Verdict {
            outcome,
            belongs_to: answer.owner.as_ref().map(|owner| owner.number),
            answered_by: Some(answer.number),
            ..Verdict::default()
        };
        let mut others = self.memory.equal(&above.response, until).filter(|answer| !answer.is_delivered);
        let found = others.find_map(|answer| {
            let owner = answer.owner.as_ref().filter(|owner| owner.number != above.number)?;
            let is_same_client = owner.client == above.client;
            // The same question again: its answer is late while there is no newer one, else it is from memory.
            let is_old = is_own_request(&answer) && self.memory.is_replaced(answer, until);
            if is_same_client && owner.number < above.number && !is_old {
                return Some(verdict("late_answer", answer));
            }
            (!is_same_client && !is_own_request(&answer)).then(|| verdict("wrong_client", answer))
        });
        found.or_else(|| {
            // Given to its own client and to this one.
            let mut others = self.memory.equal(&above.response, until).filter(|answer| !is_own_request(answer));
            let is_recent = |answer: &&Answer| until - answer.end < HORIZON / 10;
            let is_cached = self.memory.since(unit, above, until).is_some();
            let is_other = |answer: &&Answer| answer.owner.as_ref().is_some_and(|owner| owner.client != above.client);
            let answer = others.find(|answer| !is_cached && is_recent(answer) && is_other(answer))?;
            Some(verdict("wrong_client", answer))
        })
    }

    fn take_all_requests(&mut self) {
        self.take_requests_until(Ns::MAX);
    }
}
