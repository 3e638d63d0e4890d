//! Exchanges that need no thought: what a request and its answer teach, where nothing about them is in doubt.
//!
//! Each has to do just what `Rtu::next` would for the request and then for the answer.

use crate::framer::exchange::Exchange;
use crate::framer::rtu::certain::{third_copy, SURELY_AN_ANSWER};
use crate::framer::rtu::gain::REQUEST;
use crate::framer::rtu::model::Copy;
use crate::framer::rtu::Rtu;
use crate::input::Input;
use modlens_protocol::checksum::{crc_valid_at, CHECKSUM};
use modlens_protocol::direction::Pause;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

impl Rtu {
    /// The exchange at the head of the input, if there is no doubt about it: unit and function are known by now, and the
    /// request and its answer follow each other with right checksums, in one read without times or within `patience`.
    ///
    /// Asked where nothing is open: `Framer::settled`. `before`: unit and function of the exchange before; `pause`: what
    /// the silence before a byte says.
    #[inline(always)]
    #[allow(clippy::inline_always)] // What it gives is large, and taken apart at once.
    pub fn exchange(
        &self,
        functions: &Functions,
        input: &Input,
        before: Option<(u8, u8)>,
        patience: Ns,
        pause: impl Fn(usize) -> Pause,
    ) -> Option<Exchange> {
        let known = Exchange::of(functions, Mode::Rtu, input.bytes())?;
        if known.ambiguous && before == Some((known.unit, known.code)) {
            return None;
        }
        let (asked, answered) = (known.asked + CHECKSUM, known.answered + CHECKSUM);
        let (request, rest) = input.bytes().split_at_checked(asked)?;
        let response = rest.get(..answered)?;
        let familiar = self.search.model.familiar(known.unit, known.code, REQUEST);
        let held = familiar && known.is_answered(request, response) && input.holds_exchange(Mode::Rtu, asked, answered, patience);
        if !held || !crc_valid_at(rest, answered) || !crc_valid_at(input.bytes(), asked) {
            return None;
        }
        (!known.mirrored || answers_itself(pause(asked), input.timed, rest, asked)).then_some(known)
    }

    /// Unit and function of the request that was answered last.
    pub fn before(&self) -> Option<(u8, u8)> {
        let (request, _) = self.search.pending().last?;
        Some((request.unit, *request.pdu.first()?))
    }

    /// Takes note of a request and its answer, whose checksums are right. `mirrored`: they look the same.
    #[inline]
    pub fn again(&mut self, request: &[u8], response: &[u8], mirrored: bool) {
        self.search.model.learn_exchange(request, response, if mirrored { Copy::Unclear } else { Copy::First });
    }

    /// The last of such exchanges, whose bytes were forgotten just now.
    pub fn resume(&mut self, input: &Input, known: &Exchange) {
        let lengths = [known.asked, known.answered].map(|length| length + CHECKSUM);
        let (request, response) = input.forgotten(lengths.iter().sum()).split_at(lengths[0]);
        self.after_damage = false;
        self.search.resume(request, response, input.offset());
    }
}

/// Whether a request and the same once more are an exchange, by the silence between or by what follows.
fn answers_itself(pause: Pause, timed: bool, behind: &[u8], length: usize) -> bool {
    pause <= SURELY_AN_ANSWER || (!timed && third_copy(behind, length) == Some(false))
}
