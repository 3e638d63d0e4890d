//! The transaction identifiers of a connection (messaging on TCP/IP, 3.1.3): which open request a response belongs to.
//!
//! A response belongs to the request with its identifier. Some servers do not repeat it: they send one of their own,
//! always the same, or that of a request before. A response with another identifier is paired by its content only once
//! the server has shown such a habit; before that it may as well answer a request that the capture has lost.

use crate::pairing::id_habit::IdHabit;
use crate::pairing::{ObservedFrame, Pairing, PendingTransaction};
use modlens_protocol::direction::{match_response, RequestRef, ResponseMatch};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};

impl Pairing {
    /// Index of the open request that a response on a connection answers.
    ///
    /// It is the oldest with the same identifier whose content fits: fully if any does, else in part, else but for the unit, since
    /// gateways answer as 255, else in unit and function. A request that was given up is none of these; one that has no identifier, from a log, counts as if
    /// it had this one, but only with its own unit.
    ///
    /// If none fits fully, the response may belong to the last request in spite of another identifier, provided that it fits that
    /// fully and that the server has a habit of its own (`IdHabit`). Without such a habit it is then paired with none, and that
    /// the last request had no response is not certain.
    pub(super) fn find_by_id(&mut self, functions: &Functions, frame: &ObservedFrame<'_>) -> Option<usize> {
        let fit = |open: &PendingTransaction, unit: u8| {
            let request = RequestRef { unit, pdu: open.request.pdu() };
            match_response(functions, request, frame.unit(), frame.pdu())
        };
        // A gateway's log may print requests without the MBAP header and responses with it.
        let has_id = |open: &PendingTransaction| !open.is_timed_out && open.mbap_id.is_none_or(|id| frame.mbap_id == Some(id));
        let with_id = |wanted| self.open.iter().position(|open| has_id(open) && fit(open, open.unit) == wanted);
        if let Some(at) = with_id(ResponseMatch::Fully) {
            self.note_same_identifiers();
            return Some(at);
        }
        let but_for_unit =
            |open: &PendingTransaction| open.mbap_id.is_some() && has_id(open) && fit(open, frame.unit()) == ResponseMatch::Fully;
        let by_id = with_id(ResponseMatch::Partly).or_else(|| self.open.iter().position(|open| but_for_unit(open)));
        let by_id = by_id.or_else(|| self.open.iter().position(|open| has_id(open) && has_header_of(open, frame)));
        match self.compare_identifiers(functions, frame) {
            Identifiers::Agree => by_id,
            Identifiers::DifferByHabit => Some(self.open.len() - 1),
            Identifiers::DifferWithoutHabit => None,
        }
    }

    /// Notes that a response has the identifier of the request that it fits: the server has no other habit.
    #[inline]
    pub(crate) fn note_same_identifiers(&mut self) {
        self.id_habit = IdHabit::default();
    }

    /// Whether a response answers the last open request in spite of another identifier. Its identifiers are compared only with
    /// a request that has not timed out and whose content it fits fully. The habit is learned from this response, unless it is
    /// an exception, or bytes are missing after the request: then it may well answer one of those. Without a habit, that the
    /// last request had no response is no longer certain.
    fn compare_identifiers(&mut self, functions: &Functions, frame: &ObservedFrame<'_>) -> Identifiers {
        let Some(open) = self.open.back_mut() else { return Identifiers::Agree };
        let request = RequestRef { unit: open.unit, pdu: open.request.pdu() };
        let fits = match_response(functions, request, frame.unit(), frame.pdu()) == ResponseMatch::Fully;
        let is_exception = frame.pdu().first().is_some_and(|code| code & EXCEPTION_BIT != 0);
        let ids = frame.mbap_id.zip(open.mbap_id).filter(|(response, request)| response != request);
        let Some((response_id, request_id)) = ids.filter(|_| !open.is_timed_out && fits) else { return Identifiers::Agree };
        let is_habit = if is_exception || open.silence_is_inconclusive {
            self.id_habit.is_known(response_id, request_id)
        } else {
            self.id_habit.observe(response_id, request_id)
        };
        open.silence_is_inconclusive |= !is_habit;
        if is_habit {
            Identifiers::DifferByHabit
        } else {
            Identifiers::DifferWithoutHabit
        }
    }
}

/// Whether a response has identifier, unit and function of this request, so that it answers it whatever its content is.
fn has_header_of(open: &PendingTransaction, frame: &ObservedFrame<'_>) -> bool {
    open.mbap_id.is_some() && (open.unit, open.function) == (frame.unit(), frame.function())
}

/// The identifiers of a response and of the last open request.
enum Identifiers {
    /// They are the same, or there is nothing to compare.
    Agree,
    /// They differ as this server has been seen to do: the response is one to that request.
    DifferByHabit,
    /// They differ, and the server is not known to do that: it may as well be the response to a request that is missing.
    DifferWithoutHabit,
}

#[cfg(test)]
mod tests {
    use crate::pairing::id_habit::IdHabit;

    #[test]
    fn a_server_shows_its_habit_by_two_responses_or_by_zero() {
        let mut habit = IdHabit::default();
        assert!(habit.observe(0, 17), "servers that ignore the field send zero");
        let mut habit = IdHabit::default();
        assert!(!habit.observe(9, 17) && habit.observe(9, 18) && habit.is_known(9, 25) && !habit.is_known(8, 25));
        let mut habit = IdHabit::default();
        assert!(!habit.observe(16, 17) && habit.observe(17, 18) && habit.is_known(24, 25));
        assert!(!habit.observe(3, 26), "another one altogether");
    }
}
