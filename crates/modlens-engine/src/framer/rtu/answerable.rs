//! The requests that a frame may answer.
//!
//! Every path of the search has its own, and most are the same: so requests are kept once, by number, and the room of
//! those that no path holds any more is used again. Nothing is allocated while a line talks.

use crate::framer::rtu::gain::RESPONSE;
use modlens_protocol::direction::Asked;
use modlens_protocol::framing::BROADCAST;

/// A request that may be answered.
#[derive(Clone, Debug, Default)]
pub struct Request {
    /// Unit asked.
    pub unit: u8,
    /// Its PDU.
    pub pdu: Vec<u8>,
    /// Its checksum was wrong: what the answer repeats may differ.
    pub damaged: bool,
    /// It was already heard twice.
    pub copied: bool,
    /// It is isolated in noise.
    pub tentative: bool,
    /// The count that its answer begins with, and the answer's whole length, where that was worked out.
    pub answer: Option<(u8, usize)>,
}

impl Request {
    /// The same as the rest of the core knows it.
    pub fn asked(&self) -> Asked<'_> {
        Asked { unit: self.unit, pdu: &self.pdu }
    }

    /// Whether it is of this unit and function.
    pub fn is_of(&self, unit: u8, function: u8) -> bool {
        self.unit == unit && self.pdu.first() == Some(&function)
    }
}

/// The number of a request that is kept.
pub type Slot = u16;

/// The numbers of the requests that a frame may answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pending {
    /// The one that waits.
    pub asked: Option<Slot>,
    /// The one before it, if it was not answered: its answer may come late.
    pub late: Option<Slot>,
    /// The one that was answered last, and what tells its answer from others (length and checksum): it may come again.
    pub last: Option<(Slot, [u8; 4])>,
}

impl Pending {
    /// The request that waits was answered by this frame, without doubt.
    #[inline]
    pub fn answer(&mut self, frame: &[u8]) {
        self.last = self.asked.take().map(|asked| (asked, print(frame)));
    }

    fn slots(&self) -> impl Iterator<Item = Slot> {
        [self.asked, self.late, self.last.map(|(slot, _)| slot)].into_iter().flatten()
    }
}

/// The same, looked up.
#[derive(Clone, Copy, Debug)]
pub struct Open<'a> {
    /// See `Pending`.
    pub asked: Option<&'a Request>,
    /// See `Pending`.
    pub late: Option<&'a Request>,
    /// See `Pending`.
    pub last: Option<(&'a Request, [u8; 4])>,
}

/// What tells a frame from others: length and checksum.
#[inline]
pub fn print(frame: &[u8]) -> [u8; 4] {
    let [length, more] = (frame.len() as u16).to_le_bytes();
    [length, more, frame[frame.len() - 2], frame[frame.len() - 1]]
}

/// Makes `to` the first `length` of these bytes. Most frames are short, and sixteen bytes are copied at once.
#[inline]
pub fn set_first(to: &mut Vec<u8>, bytes: &[u8], length: usize) {
    to.clear();
    match bytes.first_chunk::<16>() {
        Some(head) if length <= 16 => {
            to.extend_from_slice(head);
            to.truncate(length);
        }
        _ => to.extend_from_slice(&bytes[..length]),
    }
}

/// The requests that are kept.
#[derive(Default)]
pub struct Requests {
    all: Vec<Request>,
    free: Vec<Slot>,
}

impl Requests {
    /// The request of this number.
    #[inline]
    pub fn get(&self, slot: Slot) -> &Request {
        &self.all[usize::from(slot)]
    }

    /// The same, to be changed for all that hold it.
    #[inline]
    pub fn get_mut(&mut self, slot: Slot) -> &mut Request {
        &mut self.all[usize::from(slot)]
    }

    /// Those behind some numbers.
    pub fn open(&self, pending: Pending) -> Open<'_> {
        Open {
            asked: pending.asked.map(|slot| self.get(slot)),
            late: pending.late.map(|slot| self.get(slot)),
            last: pending.last.map(|(slot, print)| (self.get(slot), print)),
        }
    }

    /// Room for another request; `held` are all that are in use.
    #[inline]
    pub fn make_room<'a>(&mut self, held: impl Iterator<Item = &'a Pending>) {
        if self.free.is_empty() {
            self.sweep(held);
        }
    }

    #[cold]
    fn sweep<'a>(&mut self, held: impl Iterator<Item = &'a Pending>) {
        let mut used = vec![false; self.all.len()];
        held.flat_map(Pending::slots).for_each(|slot| used[usize::from(slot)] = true);
        self.free.extend((0..used.len()).filter(|&slot| !used[slot]).map(|slot| slot as Slot));
        // Where most of them are in use, looking for the others would soon be necessary again.
        if self.free.len() <= self.all.len() / 2 {
            let more = self.all.len()..2 * self.all.len() + 8;
            self.free.extend(more.clone().map(|slot| slot as Slot));
            self.all.resize_with(more.end, Request::default);
        }
    }

    /// Keeps a request. There must be room.
    pub fn keep(&mut self, unit: u8, pdu: &[u8]) -> Slot {
        self.keep_first(unit, pdu, pdu.len())
    }

    /// The same with a PDU that is the first so many of these bytes.
    #[inline]
    fn keep_first(&mut self, unit: u8, bytes: &[u8], length: usize) -> Slot {
        let slot = self.free.pop().expect("room was made");
        let request = &mut self.all[usize::from(slot)];
        set_first(&mut request.pdu, bytes, length);
        request.unit = unit;
        (request.damaged, request.copied, request.tentative, request.answer) = (false, false, false, None);
        slot
    }

    /// The first `length` of these bytes are a request without doubt, another one than waits. There must be room.
    ///
    /// `answer`: see `Request`.
    #[inline]
    pub fn ask(&mut self, pending: &mut Pending, bytes: &[u8], length: usize, answer: Option<(u8, usize)>) {
        pending.late = pending.asked.take();
        pending.last = self.still(pending.last, bytes[0], &bytes[1..length - 2]);
        if bytes[0] != BROADCAST {
            let slot = self.keep_first(bytes[0], &bytes[1..], length - 3);
            self.get_mut(slot).answer = answer;
            pending.asked = Some(slot);
        }
    }

    /// What was answered last, if it is asked for again: then the same answer may come again.
    #[inline]
    fn still(&self, last: Option<(Slot, [u8; 4])>, unit: u8, pdu: &[u8]) -> Option<(Slot, [u8; 4])> {
        last.filter(|&(slot, _)| self.get(slot).unit == unit && self.get(slot).pdu == pdu)
    }

    /// Keeps a copy of a request that is perhaps none: it stays one for those that hold it. There must be room.
    pub fn keep_doubted(&mut self, slot: Slot) -> Slot {
        let doubted = Request { tentative: true, ..self.get(slot).clone() };
        let copy = self.keep(doubted.unit, &[]);
        *self.get_mut(copy) = doubted;
        copy
    }

    /// The requests that may be answered behind this frame. There must be room for one more.
    pub fn after(&mut self, before: Pending, frame: &[u8], direction: usize, answered: bool, whole: bool) -> Pending {
        if direction == RESPONSE {
            return match before.asked {
                Some(asked) if answered => Pending { asked: None, late: before.late, last: Some((asked, print(frame))) },
                _ => before,
            };
        }
        let (unit, pdu) = (frame[0], &frame[1..frame.len() - 2]);
        let asked = before.asked.map(|slot| self.get(slot));
        let last = self.still(before.last, unit, pdu);
        let copied = asked.is_some_and(|before| before.unit == unit && before.pdu == pdu && !before.copied);
        // A broadcast is never answered.
        let asked = (unit != BROADCAST).then(|| {
            let slot = self.keep(unit, pdu);
            let request = self.get_mut(slot);
            (request.damaged, request.copied) = (!whole, copied);
            slot
        });
        Pending { asked, late: before.asked, last }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::framer::rtu::gain::REQUEST;

    #[test]
    fn room_is_used_again_and_what_is_held_stays() {
        let mut requests = Requests::default();
        let held = [Pending::default()];
        requests.make_room(held.iter());
        let first = requests.after(Pending::default(), &[1, 3, 0, 9, 0, 1, 0, 0], REQUEST, false, true);
        let mut pending = first;
        for round in 0..1000u16 {
            let [high, low] = round.to_be_bytes();
            requests.make_room([&first, &pending].into_iter());
            pending = requests.after(pending, &[2, 3, high, low, 0, 1, 0, 0], REQUEST, false, true);
            requests.make_room([&first, &pending].into_iter());
            pending = requests.after(pending, &[2, 3, 2, 0, 0, 0, 0], RESPONSE, true, true);
            let open = requests.open(pending);
            assert_eq!(open.last.unwrap().0.pdu, [3, high, low, 0, 1]);
            assert_eq!(requests.open(first).asked.unwrap().pdu, [3, 0, 9, 0, 1]);
        }
        assert!(requests.all.len() <= 32);
    }

    #[test]
    fn a_broadcast_waits_for_nothing_and_a_repetition_is_one() {
        let mut requests = Requests::default();
        let mut pending = Pending::default();
        for copied in [false, true, false] {
            requests.make_room([&pending].into_iter());
            pending = requests.after(pending, &[2, 6, 0, 1, 0, 1, 0, 0], REQUEST, false, true);
            assert_eq!(requests.open(pending).asked.unwrap().copied, copied);
        }
        requests.make_room([&pending].into_iter());
        pending = requests.after(pending, &[0, 6, 0, 1, 0, 1, 0, 0], REQUEST, false, true);
        assert!(pending.asked.is_none() && pending.late.is_some());
    }
}
