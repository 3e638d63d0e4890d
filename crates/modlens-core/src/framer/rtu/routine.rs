//! Exchanges that need no thought: what a request and its answer teach, where nothing about them is in doubt.
//!
//! Each has to do just what `Rtu::next` would for the request and then for the answer.

use crate::framer::rtu::gain::REQUEST;
use crate::framer::rtu::Rtu;

impl Rtu {
    /// A request and its answer, checksums right: takes note of both, if unit and function are known by now.
    #[inline]
    pub fn again(&mut self, request: &[u8], response: &[u8]) -> bool {
        let familiar = self.search.model.familiar(request[0], request[1], REQUEST);
        if familiar {
            self.search.model.learn_exchange(request, response);
        }
        familiar
    }

    /// The last of such exchanges, which ends at this stream offset.
    pub fn resume(&mut self, request: &[u8], response: &[u8], end: u64) {
        self.after_damage = false;
        self.search.resume(request, response, end);
    }
}
