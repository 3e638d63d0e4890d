//! The fast path of pairing: a request and its response at once, while nothing else is open.
//!
//! Each exchange has to leave pairing in exactly the state in which two calls of `Pairing::add_frame` would leave it.

use crate::pairing::interval::interval;
use crate::pairing::{Pairing, PendingTransaction};
use modlens_protocol::Ns;

/// With more outstanding requests than this on a connection, looking through them costs more than it saves.
const MAX_OPEN_BESIDE: usize = 32;

impl Pairing {
    /// Whether no request is outstanding, and the next frame can change nothing about earlier ones.
    pub fn is_idle(&self) -> bool {
        self.open.is_empty() && self.is_idle_but_for_open()
    }

    /// The same, whether or not requests are outstanding. On a connection an unanswered one waits for many seconds, in which
    /// the client goes on: `leaves_open_requests` tells what then qualifies.
    pub fn is_idle_but_for_open(&self) -> bool {
        let waits = self.unit_mismatch.is_some() || self.truncated_request.is_some() || self.early_response.is_some();
        !waits && self.delayed_findings.is_empty() && self.history.is_idle() && self.masters.is_idle()
    }

    /// Whether an exchange of this identifier on a connection leaves the outstanding requests as they are: none of them has the
    /// identifier, none times out until the response, and the last one is known to have been followed by another request
    /// at another time, so that this one neither ends its wait nor repeats it.
    #[inline]
    pub fn leaves_open_requests(&self, id: u16, [requested_at, answered_at]: [Ns; 2]) -> bool {
        let Some(last) = self.open.back() else { return true };
        let timeout = self.request_timeout(true);
        let stays = |open: &PendingTransaction| {
            open.mbap_id.is_some_and(|other| other != id) && open.request.end.is_some_and(|end| answered_at - end < timeout)
        };
        let is_passed = last.waited.is_some() && last.waited != interval(last.request.end, Some(requested_at));
        // Both parts of the queue by themselves: this is asked for every exchange behind a request without a response.
        let (older, newer) = self.open.as_slices();
        let all_stay = |part: &[Box<PendingTransaction>]| part.iter().all(|open| stays(open));
        is_passed && self.open.len() <= MAX_OPEN_BESIDE && all_stay(older) && all_stay(newer)
    }

    /// Records that a unit has answered a request after `response_time`; `pause` is the silence before the request.
    /// `echoes_request`: the response has the same bytes as the request, so that neither the number of copies nor the time can
    /// be learned from it.
    #[inline]
    pub fn record_exchange(
        &mut self,
        unit: u8,
        mbap_id: Option<u16>,
        echoes_request: bool,
        pause: Option<Ns>,
        response_time: Option<Ns>,
    ) {
        if mbap_id.is_some() {
            self.note_same_identifiers();
        } else if !echoes_request {
            self.echoes.add_request();
        }
        self.heard = self.heard.map(|heard| heard + 1);
        if let Some(pause) = pause.filter(|_| echoes_request && self.open.is_empty()) {
            self.timing.record_poll_pause(pause);
        }
        self.history.count_answered();
        self.answering_units[usize::from(unit)] = true;
        match response_time {
            Some(time) if echoes_request => self.timing.record_mirrored_response_time(time),
            Some(time) => self.timing.record_response_time(time),
            None => {}
        }
    }

    /// Keeps the last response of a run of such exchanges, which the next frame may repeat.
    pub fn sync_after_batch(&mut self, unit: u8, response: &[u8]) {
        self.history.sync_after_batch(unit, response);
    }
}
