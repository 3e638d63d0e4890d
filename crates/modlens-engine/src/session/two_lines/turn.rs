//! Which of the two lines of a bus is next, where a clock gives the times of their reads.
//!
//! It is the line whose first unframed byte is older, if the two times differ by more than the adapters' delays. If they
//! do not, a response may have been seen before its request, because adapters hold bytes back on each line by itself. Then
//! the content decides: a response comes after the request that it fits, and a line whose frame is not due waits for the
//! bytes of the other one.

use std::cmp::Ordering;

use crate::framer::Framer;
use crate::session::bus::BusState;
use crate::session::two_lines::peek::{first_frame, response_fit, Fit};
use modlens_protocol::direction::{Direction, RequestRef};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

impl BusState {
    /// The index of the line whose frame is next; `None` if no line has bytes, or while bytes of the other line may still come
    /// that were on the wire before.
    ///
    /// Where times are exact or it is unknown who speaks where (`roles`), it is the line whose first unframed byte is older, a
    /// byte without time being the oldest. Else, if one line only has bytes, it is that line unless it must wait; and if both
    /// have, the older one, as long as they are at least `max_reordering` apart or a time is missing. Closer times are decided
    /// by content.
    pub(in crate::session) fn turn(&self, functions: &Functions) -> Option<usize> {
        let with_bytes = (0..self.lines.len()).filter(|&at| !self.lines[at].1.input.bytes().is_empty());
        let oldest = with_bytes.clone().min_by_key(|&at| self.first_seen(at))?;
        let Some((requests, responses)) = self.roles() else { return Some(oldest) };
        if with_bytes.count() == 1 {
            return Some(oldest).filter(|_| !self.must_wait(functions, oldest, requests));
        }
        let times = self.first_seen(requests).zip(self.first_seen(responses));
        let apart = times.map(|(request, response)| (request - response).abs());
        if apart.is_none_or(|apart| apart >= self.max_reordering()) {
            return Some(oldest);
        }
        self.turn_by_content(functions, oldest, (requests, responses))
    }

    /// Which of two lines is next where both have bytes and the clock does not tell: the response goes to the request that it
    /// fits best, the outstanding one (the line of the responses is next) or the first one that is not emitted yet (that of
    /// the requests is). If it fits both equally well or neither, the `oldest` line is next. `None` only while the frame
    /// after a repeated response to a retry is waited for.
    fn turn_by_content(&self, functions: &Functions, oldest: usize, (requests, responses): (usize, usize)) -> Option<usize> {
        let response_bytes = self.lines[responses].1.input.bytes();
        let fit_of_next = self.fit_of_next_request(functions, requests, response_bytes);
        let Some(outstanding) = self.pairing.outstanding_request() else {
            if fit_of_next >= Fit::Header && self.repeats_response_to_retry(functions, response_bytes) {
                return self.turn_after_retry(functions, requests, responses);
            }
            return Some(if fit_of_next >= Fit::Header { requests } else { oldest });
        };
        match response_fit(functions, response_bytes, outstanding).cmp(&fit_of_next) {
            // After a timeout, it is the response to the retry that is next.
            _ if fit_of_next != Fit::No && self.is_after_timeout(responses) => Some(requests),
            Ordering::Greater => Some(responses),
            Ordering::Less => Some(requests),
            Ordering::Equal => Some(oldest),
        }
    }

    /// How well the response that `response` begins with fits the first request of line `requests`. If that request is not
    /// whole or is damaged, its first two bytes are taken for unit and function, which give `Header` at best; with fewer,
    /// `No`.
    fn fit_of_next_request(&self, functions: &Functions, requests: usize, response: &[u8]) -> Fit {
        let bytes = self.lines[requests].1.input.bytes();
        if let Some((frame, _)) = first_frame(functions, bytes, Direction::Request) {
            return response_fit(functions, response, RequestRef { unit: frame[0], pdu: &frame[1..] });
        }
        match bytes {
            &[unit, ref pdu @ ..] if !pdu.is_empty() => {
                response_fit(functions, response, RequestRef { unit, pdu: &pdu[..1] }).min(Fit::Header)
            }
            _ => Fit::No,
        }
    }

    /// Whether a line begins with the same response that a retry has just had. It is the second of the two responses, to
    /// the first request and to the retry, or it is that of the next request and has the same content by chance.
    fn repeats_response_to_retry(&self, functions: &Functions, bytes: &[u8]) -> bool {
        let first = first_frame(functions, bytes, Direction::Response);
        let last = self.pairing.last_response_to_retry();
        first.zip(last).is_some_and(|((frame, _), (unit, pdu))| frame[0] == unit && frame[1..] == *pdu)
    }

    /// The line that is next after an answered retry whose response repeats: that of the responses, if the frame after the
    /// repeated one is the whole response to the next request, so that the repeated one is left over; else that of the
    /// requests. `None`: the frame after may still come, so it is waited for.
    fn turn_after_retry(&self, functions: &Functions, requests: usize, responses: usize) -> Option<usize> {
        let input = &self.lines[responses].1.input;
        let (_, behind) = first_frame(functions, input.bytes(), Direction::Response)?;
        if self.fit_of_next_request(functions, requests, behind) == Fit::Fully {
            return Some(responses);
        }
        let may_come = !input.is_ended && !input.is_closed && self.may_be_overtaken(responses);
        (!may_come).then_some(requests)
    }

    /// Whether the first bytes of a line came so long after the outstanding request that its master has rather given up.
    fn is_after_timeout(&self, at: usize) -> bool {
        let times = self.first_seen(at).zip(self.pairing.outstanding_request_end());
        self.pairing.timing.timeout_log_odds(times.map(|(seen, request_end)| seen - request_end)) > 0.0
    }

    /// When a line need not wait for the other one any more, or when the survey ends; `None` if neither is still to come. Only
    /// times after `now` count, since one that has passed has had its effect.
    pub(in crate::session) fn turn_deadline(&self) -> Option<Ns> {
        if let Some(survey) = self.survey_deadline().filter(|&until| self.now.is_some_and(|now| now < until)) {
            return Some(survey);
        }
        self.roles()?;
        let waiting = self.lines.iter().enumerate().filter(|(_, (_, line))| !line.input.bytes().is_empty());
        let until = waiting.filter_map(|(at, _)| Some(self.first_seen(at)? + self.max_reordering())).min();
        until.filter(|&until| self.now.is_some_and(|now| now < until))
    }

    /// The indices of the lines of the requests and of the responses, where the order of reads may differ from that on the
    /// wire. `None` for anything but two RTU lines of a tap, for byte-exact times, and as long as it is unknown who speaks
    /// where.
    fn roles(&self) -> Option<(usize, usize)> {
        let is_two_line_tap = self.lines.len() == 2 && self.options.bus.network.is_none();
        if !is_two_line_tap || !self.lines.iter().any(|(_, line)| line.input.has_multibyte_reads) {
            return None;
        }
        let is_rtu = self.lines.iter().all(|(_, line)| line.framer.mode() == Mode::Rtu);
        match self.speaker(0).filter(|_| is_rtu)? {
            Direction::Request => Some((0, 1)),
            _ => Some((1, 0)),
        }
    }

    /// Whether the only line with bytes, `at`, has to wait, since bytes of the other line may come that were on the wire
    /// before: a request waits while another one is outstanding; a response waits while no request is outstanding, or one
    /// that it does not fit, or one that its master has rather given up. It waits for at most `max_reordering`, and not once
    /// its input is closed. `requests` is the line of the requests.
    fn must_wait(&self, functions: &Functions, at: usize, requests: usize) -> bool {
        let input = &self.lines[at].1.input;
        let is_due = match self.pairing.outstanding_request() {
            None => at == requests,
            Some(request) => {
                at != requests && response_fit(functions, input.bytes(), request) != Fit::No && !self.is_after_timeout(at)
            }
        };
        let is_over = input.is_ended || input.is_closed;
        !is_due && !is_over && self.may_be_overtaken(at)
    }

    /// Whether bytes of the other line that come now may have been on the wire before the first bytes of this one.
    fn may_be_overtaken(&self, at: usize) -> bool {
        self.now.zip(self.first_seen(at)).is_some_and(|(now, seen)| now - seen < self.max_reordering())
    }

    /// Reads on the two lines that are less than this apart, in ns, may have been on the wire in any order.
    fn max_reordering(&self) -> Ns {
        self.pairing.timing.max_skew().max(2 * self.coarsest_resolution())
    }

    /// Time of the first unframed byte of a line.
    fn first_seen(&self, at: usize) -> Option<Ns> {
        self.lines[at].1.input.byte_time(0)
    }
}
