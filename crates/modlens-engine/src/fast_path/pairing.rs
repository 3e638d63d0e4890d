//! The fast path of pairing: a request and its response at once, while nothing else is open.
//!
//! Each exchange has to leave pairing in exactly the state in which two calls of `Pairing::add_frame` would leave it.

use crate::pairing::interval::interval;
use crate::pairing::{Pairing, PendingTransaction};
use modlens_protocol::Ns;

/// With more outstanding requests than this on a connection, looking through them costs more than it saves.
const MAX_OPEN_BESIDE: usize = 32;

/// The outstanding requests of a connection, in short.
pub(crate) struct OpenRequests {
    /// Their identifiers, from the first on as many as there are.
    ids: [u16; MAX_OPEN_BESIDE],
    count: usize,
    /// For each remainder of an identifier by 64, whether one of them has it: nearly always this shows that none is the same.
    remainders: u64,
    /// When the first one of them times out.
    pub times_out: Ns,
    /// When the request came that has ended the wait of the last one.
    passed: Ns,
    /// A response has to come within this time.
    pub request_timeout: Ns,
}

impl OpenRequests {
    /// Returns whether an exchange of this identifier leaves these requests as they are: none of them has the identifier, and
    /// none times out before the response. The wait of the last one was ended by an earlier request (`passed`), which must not be
    /// this one.
    #[inline]
    pub fn stay_open_across(&self, id: u16, [requested_at, answered_at]: [Ns; 2]) -> bool {
        let may_be_open = self.remainders >> (id % 64) & 1 != 0;
        let is_open = may_be_open && self.ids[..self.count].contains(&id);
        !is_open && answered_at < self.times_out && requested_at != self.passed
    }

    /// Returns the same for requests that were let pass (`Pairing::let_pass`), and those after them.
    pub fn passed(self) -> Self {
        Self { passed: Ns::MIN, ..self }
    }
}

impl Pairing {
    /// Returns whether no request is outstanding, and the next frame can change nothing about earlier ones.
    pub fn is_idle(&self) -> bool {
        self.open.is_empty() && self.is_idle_but_for_open()
    }

    /// Returns the same, whether or not requests are outstanding. On a connection an unanswered one waits for many seconds, in
    /// which the client goes on: `open_requests` shows what then qualifies.
    pub fn is_idle_but_for_open(&self) -> bool {
        !self.history.has_retry_candidates() && self.is_idle_but_for_requests()
    }

    /// Returns the same, whether or not the next request may be the retry of an earlier one: `let_pass` shows.
    pub(crate) fn is_idle_but_for_requests(&self) -> bool {
        let waits = self.unit_mismatch.is_some() || self.truncated_request.is_some() || self.early_response.is_some();
        let is_idle = self.history.last_broadcast.is_none() && self.masters.is_idle();
        !waits && self.delayed_findings.is_empty() && is_idle
    }

    /// Lets a request of a connection, which comes at this time, pass those without a response, as `add_request` does: the last
    /// outstanding one has been waited for until now, and what it might have repeated is forgotten. `adu`: its unit and PDU, if it
    /// is plain and whole. `false`, with nothing changed, if that is not known, or if it may be a retry.
    pub(crate) fn let_pass(&mut self, adu: Option<&[u8]>, time: Ns) -> bool {
        let ends_wait = |last: &PendingTransaction| {
            let until = last.request.end.zip(last.waited).map(|(end, waited)| end + waited);
            until.is_none_or(|until| until == time)
        };
        let last = self.open.back_mut().filter(|last| ends_wait(last));
        if last.is_none() && !self.history.has_retry_candidates() {
            return true;
        }
        let Some((&unit, pdu)) = adu.and_then(<[u8]>::split_first) else { return false };
        let is_same = |last: &&mut PendingTransaction| last.unit == unit && last.request.pdu() == pdu;
        let last = last.map(|last| &mut **last);
        if last.as_ref().is_some_and(is_same) || self.history.is_repeated_by(unit, pdu) {
            return false;
        }
        if let Some(last) = last {
            let waited = interval(last.request.end, Some(time)).filter(|&waited| waited >= 2 * self.resolution);
            last.waited = last.waited.or(waited);
        }
        self.history.clear_retry_candidates();
        true
    }

    /// What an exchange on a connection has to leave alone; `None` if no exchange can: where an outstanding request has no
    /// identifier or time, the last one is not known to have been followed by another request, or they are too many. It holds
    /// until another request is outstanding, or one of them no more.
    pub(crate) fn open_requests(&self) -> Option<OpenRequests> {
        let request_timeout = self.request_timeout(true);
        let (ids, count, remainders) = ([0; MAX_OPEN_BESIDE], self.open.len(), 0);
        let mut found = OpenRequests { ids, count, remainders, times_out: Ns::MAX, passed: Ns::MIN, request_timeout };
        for (at, open) in self.open.iter().enumerate() {
            let id = open.mbap_id?;
            *found.ids.get_mut(at)? = id;
            found.remainders |= 1 << (id % 64);
            let end = open.request.end?;
            found.times_out = found.times_out.min(end.saturating_add(request_timeout));
            found.passed = open.waited.map_or(Ns::MIN, |waited| end + waited);
        }
        self.open.back().is_none_or(|last| last.waited.is_some()).then_some(found)
    }

    /// Records that a unit has answered a request. `echoes_request`: the response has the same bytes as the request, so that the
    /// number of copies cannot be learned from it. The times are left to `learn_times`, the unit to `note_answering`.
    #[inline]
    pub fn record_exchange(&mut self, mbap_id: Option<u16>, echoes_request: bool) {
        if mbap_id.is_some() {
            self.note_same_identifiers();
        } else if !echoes_request {
            self.echoes.add_request();
        }
        self.heard = self.heard.map(|heard| heard + 1);
        self.history.count_answered(1);
    }

    /// Learns the silence before a request whose response, if it is none refused, has the same bytes; and the time to a response,
    /// which has (`is_mirrored`) or has not.
    #[inline]
    pub fn learn_times(&mut self, poll_pause: Option<Ns>, response_time: Option<Ns>, is_mirrored: bool) {
        if let Some(pause) = poll_pause.filter(|_| self.open.is_empty()) {
            self.timing.record_poll_pause(pause);
        }
        match response_time {
            Some(time) if is_mirrored => self.timing.record_mirrored_response_time(time),
            Some(time) => self.timing.record_response_time(time),
            None => {}
        }
    }

    /// Learns the time between two requests of a serial line, from one that begins and ends at these times and was answered.
    #[inline]
    pub fn learn_interval(&mut self, start: Option<Ns>, end: Option<Ns>) {
        self.usual_interval.add_request(start, end, self.open.is_empty());
    }

    /// Records a run of answered requests of a connection, but for their times and units.
    pub fn record_exchanges_by_id(&mut self, exchanges: u32) {
        self.note_same_identifiers();
        self.record_untimed_exchanges(exchanges, 0);
    }

    /// Records a run of answered requests without times, as `record_exchange` does each of them; `first_requests` are those whose
    /// response has not the same bytes. The units are left to `note_answering`.
    pub fn record_untimed_exchanges(&mut self, exchanges: u32, first_requests: u32) {
        self.echoes.add_requests(first_requests);
        self.heard = self.heard.map(|heard| heard + u64::from(exchanges));
        self.history.count_answered(exchanges);
    }

    /// Notes that a unit has answered.
    #[inline]
    pub fn note_answering(&mut self, unit: u8) {
        self.answering_units[usize::from(unit)] = true;
    }

    /// Keeps the last response of a run of such exchanges, which the next frame may repeat, with the number of its transaction and
    /// its identifier on a connection.
    pub fn sync_after_batch(&mut self, txn_and_id: (u64, Option<u16>), unit: u8, response: &[u8]) {
        self.history.sync_after_batch(txn_and_id, unit, response);
    }
}
