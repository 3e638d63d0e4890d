//! Exchanges that need no thought: pairing where nothing is open.
//!
//! Each has to leave what `Pairing::take` would leave behind the request and then behind the answer.

use crate::pairing::Pairing;
use modlens_protocol::Ns;

impl Pairing {
    /// Whether nothing waits for an answer, or for what a request or an answer may say of it.
    pub fn idle(&self) -> bool {
        let open = !self.open.is_empty() || self.stray.is_some() || self.partial.is_some();
        !open && self.notes.is_empty() && self.past.idle() && self.masters.idle()
    }

    /// A unit has answered a request; `mirrored`: by repeating it, which teaches nothing of copies and times.
    #[inline]
    pub fn again(&mut self, unit: u8, mbap_id: Option<u16>, mirrored: bool, response_time: Option<Ns>) {
        match mbap_id {
            Some(id) => self.remember_id(id),
            None if mirrored => {}
            None => self.copies.next(),
        }
        self.past.answered_again();
        self.present[usize::from(unit)] = true;
        if let Some(time) = response_time.filter(|_| !mirrored) {
            self.tempo.answered(time);
        }
    }

    /// The last of such answers.
    pub fn resume(&mut self, unit: u8, response: &[u8]) {
        self.past.resume(unit, response);
    }
}
