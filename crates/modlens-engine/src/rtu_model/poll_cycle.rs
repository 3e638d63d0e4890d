//! A dictionary of the requests seen, and the poll cycle: those of them that come again and again.

use std::ops::Range;

use crate::rtu_model::prefilter::{DamageCosts, Need, RequestPrefilter, MAX_LENGTHS};
use crate::rtu_model::prefix_index::{members, FrameSet, PrefixIndex, MAX_FRAMES};
use crate::weights::MAX_REQUEST_COUNT_FRAMES;

/// Slots of the dictionary.
const SLOTS: usize = 1024;

/// A request is kept with its bytes if it is shorter than this: those of a poll cycle are.
const TEXT_BYTES: usize = MAX_LENGTHS;

/// The length of a request and its bytes; length 0 for one that is too long to be kept.
type Text = [u8; TEXT_BYTES];

/// The requests seen, one per slot, and those that came again.
pub struct PollCycle {
    seen: Box<[SeenRequest; SLOTS]>,
    /// The bytes of the requests in `seen`, if they are short.
    texts: Box<[Text]>,
    /// The slots of up to 64 requests that came again, or of what has replaced them there since. A place in this list is the
    /// request's number in `index` and `prefilter`.
    polled: Vec<u16>,
    /// Once all 64 places are taken: the one that was filled first, which the next request takes. Those after it were filled
    /// later, and those before it later still.
    oldest: usize,
    index: PrefixIndex,
    prefilter: RequestPrefilter,
}

/// What a slot of the dictionary holds.
#[derive(Clone, Copy, Default)]
struct SeenRequest {
    /// A hash that distinguishes the request from others.
    key: u64,
    /// How often it came, less the other requests that wanted the slot.
    count: u32,
    /// The slot is in `PollCycle::polled`.
    is_polled: bool,
}

impl Default for PollCycle {
    fn default() -> Self {
        Self {
            seen: Box::new([SeenRequest::default(); SLOTS]),
            texts: vec![[0; TEXT_BYTES]; SLOTS].into_boxed_slice(),
            polled: Vec::new(),
            oldest: 0,
            index: PrefixIndex::default(),
            prefilter: RequestPrefilter::default(),
        }
    }
}

impl PollCycle {
    /// Whether this request was seen before.
    pub fn contains(&self, frame: &[u8]) -> bool {
        let name = RequestName::of(frame);
        let seen = self.seen[name.slot()];
        seen.key == name.0 && seen.count > 0
    }

    /// Counts a request.
    #[inline]
    pub fn record(&mut self, frame: &[u8]) {
        self.record_as(RequestName::of(frame), frame);
    }

    /// Counts a request that has this name.
    #[inline]
    pub fn record_as(&mut self, name: RequestName, frame: &[u8]) {
        let seen = &mut self.seen[name.slot()];
        if seen.key == name.0 && seen.count >= 2 {
            seen.count = (seen.count + 1).min(MAX_REQUEST_COUNT_FRAMES);
        } else {
            self.record_rare(frame, name);
        }
    }

    /// Counts a request that is new, has a count below two, or whose slot holds another one. A slot held by another request loses
    /// a count; if it has none left, this request takes it (`replace`). At a count of two, the request joins the poll cycle.
    fn record_rare(&mut self, frame: &[u8], name: RequestName) {
        let (key, slot) = (name.0, name.slot());
        let seen = &mut self.seen[slot];
        if seen.key == key {
            seen.count += 1;
            if seen.count == 2 {
                self.join_cycle(slot);
            }
        } else if seen.count > 0 {
            seen.count -= 1;
        } else {
            (seen.key, seen.count) = (key, 1);
            self.replace(frame, slot);
        }
    }

    /// Adds the request in this slot to the poll cycle, unless it is too long to be kept or its slot is in the cycle already. A
    /// full cycle loses the one in the place that was filled first, which does not join again before others of its slot have taken
    /// its count below two.
    fn join_cycle(&mut self, slot: usize) {
        if self.texts[slot][0] == 0 || self.seen[slot].is_polled {
            return;
        }
        self.seen[slot].is_polled = true;
        let mut number = self.polled.len();
        if number < MAX_FRAMES {
            self.polled.push(slot as u16);
        } else {
            number = self.oldest;
            self.oldest = (self.oldest + 1) % MAX_FRAMES;
            let out = usize::from(std::mem::replace(&mut self.polled[number], slot as u16));
            self.seen[out].is_polled = false;
            self.index.remove(number, bytes_of(&self.texts[out]));
            self.prefilter.remove(number, bytes_of(&self.texts[out]));
        }
        let frame = bytes_of(&self.texts[slot]);
        self.index.add(number, frame);
        self.prefilter.add(number, frame);
    }

    /// Puts another request in a slot, and in its place in the poll cycle if the slot has one. A request that is too long to be
    /// kept leaves both empty.
    fn replace(&mut self, frame: &[u8], slot: usize) {
        let place = || self.polled.iter().position(|&polled| usize::from(polled) == slot);
        let number = self.seen[slot].is_polled.then(place).flatten();
        let text = &mut self.texts[slot];
        if let Some(number) = number {
            self.index.remove(number, bytes_of(text));
            self.prefilter.remove(number, bytes_of(text));
        }
        text[0] = 0;
        if frame.len() < TEXT_BYTES {
            text[0] = frame.len() as u8;
            text[1..=frame.len()].copy_from_slice(frame);
        }
        if let Some(number) = number {
            self.index.add(number, bytes_of(text));
            self.prefilter.add(number, bytes_of(text));
        }
    }

    /// These requests of the poll cycle, those that joined first first; empty where a slot was taken by a long request.
    pub fn get_all(&self, set: FrameSet) -> impl Iterator<Item = &[u8]> {
        let by_age = members(set.rotate_right(self.oldest as u32));
        by_age.map(|age| bytes_of(&self.texts[usize::from(self.polled[(age + self.oldest) % MAX_FRAMES])]))
    }

    /// All requests of the poll cycle, in the same order.
    #[cfg(test)]
    pub fn all(&self) -> Vec<Vec<u8>> {
        let set = FrameSet::MAX.checked_shr(MAX_FRAMES as u32 - self.polled.len() as u32).unwrap_or(0);
        self.get_all(set).map(<[u8]>::to_vec).collect()
    }

    /// Whether no request came again yet.
    pub fn is_empty(&self) -> bool {
        self.polled.is_empty()
    }

    /// The requests of the poll cycle that may begin with these bytes.
    pub fn possible_frames(&self, bytes: &[u8]) -> FrameSet {
        self.index.possible_frames(bytes)
    }

    /// Those of `possible` that may reach what they need once `costs` are paid; `bits` is the information content of a byte.
    pub fn likely(
        &self,
        possible: FrameSet,
        bytes: &[u8],
        bits: impl Fn(u8) -> f32,
        need: Need,
        costs: &DamageCosts,
    ) -> FrameSet {
        self.prefilter.likely(possible, bytes, bits, need, costs)
    }

    /// The requests of the poll cycle that have one of these numbers of bytes.
    pub fn with_length_in(&self, lengths: Range<usize>) -> FrameSet {
        self.prefilter.with_length_in(lengths)
    }
}

/// The bytes of a request that is kept.
fn bytes_of(text: &Text) -> &[u8] {
    &text[1..=usize::from(text[0])]
}

/// A hash that distinguishes a request from others, from which its slot in the dictionary follows. It covers the first eight bytes, the
/// last four, the CRC among them, and the length: that is quicker than going through all bytes.
#[derive(Clone, Copy, Debug)]
pub struct RequestName(u64);

impl RequestName {
    /// The name of a request, which has its CRC.
    #[inline]
    pub fn of(frame: &[u8]) -> Self {
        let head = frame.first_chunk().map_or_else(
            || frame.iter().fold(0, |head, &byte| head << 8 | u64::from(byte)),
            |head: &[u8; 8]| u64::from_le_bytes(*head),
        );
        let tail = frame.last_chunk().map_or(0, |tail: &[u8; 4]| u64::from(u32::from_le_bytes(*tail)));
        let tail = tail << 16 ^ frame.len() as u64;
        // Multiplication by odd numbers without pattern (bits of the golden ratio and of the square root of two) spreads
        // requests that differ in few bits.
        Self(head.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ tail.wrapping_mul(0xB504_F333_F9DE_6485))
    }

    #[inline]
    fn slot(self) -> usize {
        (self.0 >> 48) as usize % SLOTS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_cycle_loses_the_request_that_joined_first() {
        let mut cycle = PollCycle::default();
        let request = |number: u8| [1, 3, number, number, 0, 1, number, 7];
        let mut joined: Vec<[u8; 8]> = Vec::new();
        for number in 0..200 {
            let request = request(number);
            cycle.record(&request);
            cycle.record(&request);
            // Two requests may want the same slot: then the second one has to wait.
            if cycle.get_all(FrameSet::MAX >> (64 - cycle.polled.len())).any(|polled| polled == request) {
                joined.push(request);
            }
            let latest = &joined[joined.len().saturating_sub(MAX_FRAMES)..];
            assert!(cycle.get_all(FrameSet::MAX >> (64 - cycle.polled.len())).eq(latest.iter().map(|request| &request[..])));
            let found = cycle.get_all(cycle.possible_frames(&request)).any(|polled| polled == request);
            assert_eq!(found, joined.last() == Some(&request));
        }
        assert!(joined.len() > 2 * MAX_FRAMES);
    }
}
