//! Exchanges that need no thought: what a request and its answer teach, where nothing about them is in doubt.
//!
//! Each has to do just what `Rtu::next` would for the request and then for the answer.

use crate::direction::Pause;
use crate::framer::rtu::certain::{third_copy, SURELY_AN_ANSWER};
use crate::framer::rtu::costs::Copy;
use crate::framer::rtu::gain::REQUEST;
use crate::framer::rtu::Rtu;

impl Rtu {
    /// Whether unit and function are known by now.
    pub fn knows(&self, unit: u8, code: u8) -> bool {
        self.search.model.familiar(unit, code, REQUEST)
    }

    /// Takes note of a request and its answer, whose checksums are right. `mirrored`: they look the same.
    #[inline]
    pub fn again(&mut self, request: &[u8], response: &[u8], mirrored: bool) {
        self.search.model.learn_exchange(request, response, if mirrored { Copy::Unclear } else { Copy::First });
    }

    /// Whether a request and the same once more are an exchange, by the silence between or by what follows.
    pub fn answers_itself(pause: Pause, timed: bool, behind: &[u8], length: usize) -> bool {
        pause <= SURELY_AN_ANSWER || (!timed && third_copy(behind, length) == Some(false))
    }

    /// The last of such exchanges, which ends at this stream offset.
    pub fn resume(&mut self, request: &[u8], response: &[u8], end: u64) {
        self.after_damage = false;
        self.search.resume(request, response, end);
    }
}
