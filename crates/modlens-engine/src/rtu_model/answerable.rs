//! The requests that a frame may answer.
//!
//! Every path of the search has its own outstanding request, and most paths have the same one. So requests are kept once,
//! in a pool, and paths refer to them by number. Room of requests that no path refers to any more is used again: nothing is
//! allocated while a line talks.

use crate::rtu_model::frame_bytes::FrameBytes;
use crate::rtu_model::side::REQUEST;
use modlens_protocol::direction::{expected_data_bytes, RequestRef};
use modlens_protocol::framing::BROADCAST_UNIT;
use modlens_protocol::functions::Functions;

/// Bytes of a request that determine how its response begins: unit, function, and two fields of two bytes.
pub const REQUEST_HEAD_BYTES: usize = 6;

/// The first bytes of a request, with zeros after one that is shorter.
pub type RequestHead = [u8; REQUEST_HEAD_BYTES];

/// Returns whether these bytes, which begin with unit and function, may be the response to the request with this head: these are
/// equal, and where the request determines a byte count, that comes next.
///
/// Fields that a response repeats do not count: where only the responses of writes are heard, each of them looks like a request.
#[inline]
pub fn may_answer(functions: &Functions, request: RequestHead, bytes: &[u8]) -> bool {
    let count = || expected_data_bytes(functions.row(request[1], &request[2..])?, &request[1..]);
    bytes[..2] == request[..2] && count().zip(bytes.get(2)).is_none_or(|(count, &byte)| usize::from(byte) == count)
}

/// A request that may be answered.
#[derive(Clone, Debug, Default)]
pub struct AnswerableRequest {
    /// The unit that it is addressed to.
    pub unit: u8,
    /// Its PDU.
    pub pdu: Vec<u8>,
    /// Its CRC was invalid, so fields that the response repeats may differ.
    pub is_damaged: bool,
    /// It repeats the request before it, with no response between: heard twice already.
    pub is_repeated: bool,
    /// It is alone in noise and may be none.
    pub is_unconfirmed: bool,
    /// The byte count that its response begins with, and the response's whole length, where both are known.
    pub expected_response: Option<(u8, usize)>,
}

impl AnswerableRequest {
    /// The request as other parts of the engine refer to it.
    pub fn as_request_ref(&self) -> RequestRef<'_> {
        RequestRef { unit: self.unit, pdu: &self.pdu }
    }

    /// Its first bytes.
    pub fn head(&self) -> RequestHead {
        let mut head = [0; REQUEST_HEAD_BYTES];
        head[0] = self.unit;
        head[1..].iter_mut().zip(&self.pdu).for_each(|(to, byte)| *to = *byte);
        head
    }

    /// Whether this frame has its unit and its PDU.
    pub fn matches_frame(&self, frame: FrameBytes<'_>) -> bool {
        self.unit == frame.unit() && self.pdu == frame.pdu()
    }

    /// Whether it is addressed to this unit and has this function code.
    pub fn matches(&self, unit: u8, function: u8) -> bool {
        self.unit == unit && self.pdu.first() == Some(&function)
    }
}

/// The number of a request in the pool.
pub type RequestId = u16;

/// A frame's length and CRC, which tell it from others: one number, since it is written and read again for each frame, and a
/// processor waits for a number that was written in parts.
pub type Fingerprint = u32;

/// The requests that the next frame of a path may answer, by number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answerable {
    /// The outstanding request.
    pub outstanding: Option<RequestId>,
    /// The request before the outstanding one, if it got no response: that response may still come, late.
    pub superseded: Option<RequestId>,
    /// The request that was answered last, and its response: the same response may come again.
    pub last_answered: Option<(RequestId, Fingerprint)>,
}

impl Answerable {
    /// This frame is the response to the outstanding request, without doubt.
    #[inline]
    pub fn answer(&mut self, frame: &[u8]) {
        self.last_answered = self.outstanding.take().map(|request| (request, fingerprint(frame)));
    }

    /// The same, without a superseded request that this response, which answers no other, equals: it has its response now.
    fn without_superseded(self, pool: &RequestPool, frame: &[u8]) -> Self {
        let is_equal = |id: &RequestId| pool.get(*id).unit == frame[0] && pool.get(*id).pdu == frame[1..frame.len() - 2];
        Self { superseded: self.superseded.filter(|id| !is_equal(id)), ..self }
    }

    /// The same, without a request of another unit that was answered before this frame: what comes next does not follow its
    /// response.
    fn without_answered_of_others(self, pool: &RequestPool, unit: u8) -> Self {
        Self { last_answered: self.last_answered.filter(|&(id, _)| pool.get(id).unit == unit), ..self }
    }

    fn ids(&self) -> impl Iterator<Item = RequestId> {
        [self.outstanding, self.superseded, self.last_answered.map(|(request, _)| request)].into_iter().flatten()
    }
}

/// The requests that the next frame of a path may answer, looked up in the pool: see `Answerable`.
#[derive(Clone, Copy, Debug)]
pub struct AnswerableRequests<'a> {
    /// The outstanding request.
    pub outstanding: Option<&'a AnswerableRequest>,
    /// The request before the outstanding one, if it got no response.
    pub superseded: Option<&'a AnswerableRequest>,
    /// The request that was answered last, and its response.
    pub last_answered: Option<(&'a AnswerableRequest, Fingerprint)>,
}

impl AnswerableRequests<'_> {
    /// Whether the outstanding request was heard twice, or else the one that was answered last.
    pub fn heard_twice(&self) -> bool {
        self.outstanding.or(self.last_answered.map(|(request, _)| request)).is_some_and(|request| request.is_repeated)
            || self.last_answered.is_some_and(|(request, _)| request.is_repeated)
    }
}

/// Length and CRC of a frame.
#[inline]
pub fn fingerprint(frame: &[u8]) -> Fingerprint {
    let crc = u16::from_le_bytes([frame[frame.len() - 2], frame[frame.len() - 1]]);
    (frame.len() as u32) << u16::BITS | u32::from(crc)
}

/// Makes `to` the first `length` of these bytes. Most frames are short, and a copy of sixteen bytes is one instruction.
#[inline]
pub fn copy_prefix(to: &mut Vec<u8>, bytes: &[u8], length: usize) {
    to.clear();
    match bytes.first_chunk::<16>() {
        Some(head) if length <= 16 => {
            to.extend_from_slice(head);
            to.truncate(length);
        }
        _ => to.extend_from_slice(&bytes[..length]),
    }
}

/// All requests that any path refers to.
#[derive(Default)]
pub struct RequestPool {
    requests: Vec<AnswerableRequest>,
    free: Vec<RequestId>,
}

impl RequestPool {
    /// The request of this number.
    #[inline]
    pub fn get(&self, id: RequestId) -> &AnswerableRequest {
        &self.requests[usize::from(id)]
    }

    /// The request of this number, to be changed for all paths that refer to it.
    #[inline]
    pub fn get_mut(&mut self, id: RequestId) -> &mut AnswerableRequest {
        &mut self.requests[usize::from(id)]
    }

    /// Looks requests up.
    pub fn look_up(&self, answerable: Answerable) -> AnswerableRequests<'_> {
        AnswerableRequests {
            outstanding: answerable.outstanding.map(|id| self.get(id)),
            superseded: answerable.superseded.map(|id| self.get(id)),
            last_answered: answerable.last_answered.map(|(id, response)| (self.get(id), response)),
        }
    }

    /// Makes room for one more request; `in_use` are the references of all paths.
    #[inline]
    pub fn make_room<'a>(&mut self, in_use: impl Iterator<Item = &'a Answerable>) {
        if self.free.is_empty() {
            self.collect_free(in_use);
        }
    }

    /// Finds the requests that no path refers to; grows the pool if these are few.
    #[cold]
    fn collect_free<'a>(&mut self, in_use: impl Iterator<Item = &'a Answerable>) {
        let mut used = vec![false; self.requests.len()];
        in_use.flat_map(Answerable::ids).for_each(|id| used[usize::from(id)] = true);
        self.free.extend((0..used.len()).filter(|&id| !used[id]).map(|id| id as RequestId));
        // Where most are in use, the few others would soon be used up, and all would be looked through again.
        if self.free.len() <= self.requests.len() / 2 {
            let more = self.requests.len()..2 * self.requests.len() + 8;
            self.free.extend(more.clone().map(|id| id as RequestId));
            self.requests.resize_with(more.end, AnswerableRequest::default);
        }
    }

    /// Adds a request. `make_room` has to be called before.
    pub fn add(&mut self, unit: u8, pdu: &[u8]) -> RequestId {
        self.add_prefix(unit, pdu, pdu.len())
    }

    /// Adds a request whose PDU is the first `length` of these bytes. `make_room` has to be called before.
    #[inline]
    fn add_prefix(&mut self, unit: u8, bytes: &[u8], length: usize) -> RequestId {
        let id = self.free.pop().expect("room was made");
        let request = &mut self.requests[usize::from(id)];
        copy_prefix(&mut request.pdu, bytes, length);
        request.unit = unit;
        (request.is_damaged, request.is_repeated, request.is_unconfirmed) = (false, false, false);
        request.expected_response = None;
        id
    }

    /// Makes the first `length` of these bytes, an unambiguous request with its unit and CRC, the outstanding one.
    ///
    /// It is another request than the one outstanding before. `make_room` has to be called before.
    #[inline]
    pub fn set_outstanding(
        &mut self,
        answerable: &mut Answerable,
        bytes: &[u8],
        length: usize,
        expected_response: Option<(u8, usize)>,
    ) {
        answerable.superseded = answerable.outstanding.take();
        answerable.last_answered = self.if_asked_again(answerable.last_answered, bytes[0], &bytes[1..length - 2]);
        if bytes[0] != BROADCAST_UNIT {
            let id = self.add_prefix(bytes[0], &bytes[1..], length - 3);
            self.get_mut(id).expected_response = expected_response;
            answerable.outstanding = Some(id);
        }
    }

    /// Keeps the request that was answered last only if it is asked again: then the same response may come again.
    #[inline]
    fn if_asked_again(
        &self,
        last_answered: Option<(RequestId, Fingerprint)>,
        unit: u8,
        pdu: &[u8],
    ) -> Option<(RequestId, Fingerprint)> {
        last_answered.filter(|&(id, _)| self.get(id).unit == unit && self.get(id).pdu == pdu)
    }

    /// Adds an unconfirmed copy of a request. The original stays as it is for the paths that refer to it. `make_room` has to be
    /// called before.
    pub fn add_unconfirmed_copy(&mut self, id: RequestId) -> RequestId {
        let unconfirmed = AnswerableRequest { is_unconfirmed: true, ..self.get(id).clone() };
        let copy = self.add(unconfirmed.unit, &[]);
        *self.get_mut(copy) = unconfirmed;
        copy
    }

    /// What may be answered after this frame, given what might have been answered before it. `make_room` has to be called
    /// before. `frame` includes the CRC.
    ///
    /// A response that answers clears the outstanding request and is remembered; any other changes nothing. A request becomes the
    /// outstanding one and the one before it superseded (`after_request`).
    pub fn after(
        &mut self,
        before: Answerable,
        frame: &[u8],
        direction: usize,
        answers_outstanding: bool,
        is_crc_valid: bool,
    ) -> Answerable {
        match before.outstanding {
            _ if direction == REQUEST => self.after_request(before, frame, is_crc_valid),
            Some(request) if answers_outstanding => {
                let last_answered = Some((request, fingerprint(frame)));
                Answerable { outstanding: None, superseded: before.superseded, last_answered }
            }
            _ => before.without_superseded(self, frame).without_answered_of_others(self, frame[0]),
        }
    }

    /// What may be answered after a request. It is outstanding itself, unless it is a broadcast, which is never answered: then
    /// nothing is. It is marked as repeated if it equals the one outstanding before and that one is not repeated itself, and as
    /// damaged if its CRC is invalid.
    fn after_request(&mut self, before: Answerable, frame: &[u8], is_crc_valid: bool) -> Answerable {
        let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
        let last_answered = self.if_asked_again(before.last_answered, unit, pdu);
        let previous = before.outstanding.map(|id| self.get(id));
        let is_repeated = previous.is_some_and(|request| request.unit == unit && request.pdu == pdu && !request.is_repeated);
        let outstanding = (unit != BROADCAST_UNIT).then(|| {
            let id = self.add(unit, pdu);
            let request = self.get_mut(id);
            (request.is_damaged, request.is_repeated) = (!is_crc_valid, is_repeated);
            id
        });
        Answerable { outstanding, superseded: before.outstanding, last_answered }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rtu_model::side::RESPONSE;

    #[test]
    fn room_is_used_again_and_requests_referred_to_stay() {
        let mut pool = RequestPool::default();
        let in_use = [Answerable::default()];
        pool.make_room(in_use.iter());
        let first = pool.after(Answerable::default(), &[1, 3, 0, 9, 0, 1, 0, 0], REQUEST, false, true);
        let mut answerable = first;
        for round in 0..1000u16 {
            let [high, low] = round.to_be_bytes();
            pool.make_room([&first, &answerable].into_iter());
            answerable = pool.after(answerable, &[2, 3, high, low, 0, 1, 0, 0], REQUEST, false, true);
            pool.make_room([&first, &answerable].into_iter());
            answerable = pool.after(answerable, &[2, 3, 2, 0, 0, 0, 0], RESPONSE, true, true);
            let requests = pool.look_up(answerable);
            assert_eq!(requests.last_answered.unwrap().0.pdu, [3, high, low, 0, 1]);
            assert_eq!(pool.look_up(first).outstanding.unwrap().pdu, [3, 0, 9, 0, 1]);
        }
        assert!(pool.requests.len() <= 32);
    }

    #[test]
    fn a_broadcast_is_not_outstanding_and_a_repeated_request_is_marked() {
        let mut pool = RequestPool::default();
        let mut answerable = Answerable::default();
        for is_repeated in [false, true, false] {
            pool.make_room([&answerable].into_iter());
            answerable = pool.after(answerable, &[2, 6, 0, 1, 0, 1, 0, 0], REQUEST, false, true);
            assert_eq!(pool.look_up(answerable).outstanding.unwrap().is_repeated, is_repeated);
        }
        pool.make_room([&answerable].into_iter());
        answerable = pool.after(answerable, &[0, 6, 0, 1, 0, 1, 0, 0], REQUEST, false, true);
        assert!(answerable.outstanding.is_none() && answerable.superseded.is_some());
    }
}
