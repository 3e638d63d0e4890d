//! The fast path of pairing: a request and its response at once, while nothing else is open.
//!
//! Each exchange has to leave pairing in exactly the state in which two calls of `Pairing::add_frame` would leave it.

use crate::pairing::Pairing;
use modlens_protocol::Ns;

impl Pairing {
    /// Whether no request is outstanding, and the next frame can change nothing about earlier ones.
    pub fn is_idle(&self) -> bool {
        let is_open = !self.open.is_empty() || self.unit_mismatch.is_some() || self.truncated_request.is_some();
        !is_open && self.delayed_findings.is_empty() && self.history.is_idle() && self.masters.is_idle()
    }

    /// Records that a unit has answered a request after `response_time`; `pause` is the silence before the request. `echoes_request`: the response has the same bytes as the
    /// request, so that neither the number of copies nor the time can be learned from it.
    #[inline]
    pub fn record_exchange(
        &mut self,
        unit: u8,
        mbap_id: Option<u16>,
        echoes_request: bool,
        pause: Option<Ns>,
        response_time: Option<Ns>,
    ) {
        if mbap_id.is_none() && !echoes_request {
            self.echoes.add_request();
        }
        self.heard = self.heard.map(|heard| heard + 1);
        if let Some(pause) = pause.filter(|_| echoes_request) {
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
