//! Requests that come again and again: a master's poll cycle.

use crate::framer::rtu::index::{Index, Set, MOST};
use crate::framer::rtu::sift::{Costs, Sift};

/// Places in the dictionary of requests seen.
const SEEN: usize = 1024;

/// A request is remembered with its bytes, if it is shorter than this: those of a poll cycle are.
const SHORT: usize = 24;

/// Times that are counted at most: after so many newcomers a request that has not come back is forgotten.
const OFTEN: u32 = 15;

/// Its length, and its bytes.
type Text = [u8; SHORT];

/// The requests seen.
pub struct Polls {
    seen: Box<[Seen]>,
    /// The bytes of those requests, if they are short.
    texts: Box<[Text]>,
    /// The places of those that came again, the latest last.
    places: Vec<u16>,
    index: Index,
    sift: Sift,
}

/// A request that was seen.
#[derive(Clone, Copy, Default)]
struct Seen {
    /// What tells it from others.
    key: u64,
    /// How often it came.
    count: u32,
    /// Its place is one of `Polls::places`.
    listed: bool,
}

impl Default for Polls {
    fn default() -> Self {
        Self {
            seen: vec![Seen::default(); SEEN].into_boxed_slice(),
            texts: vec![[0; SHORT]; SEEN].into_boxed_slice(),
            places: Vec::new(),
            index: Index::default(),
            sift: Sift::default(),
        }
    }
}

impl Polls {
    /// Whether this request was seen before.
    pub fn knows(&self, frame: &[u8]) -> bool {
        let (key, slot) = key(frame);
        let seen = self.seen[slot];
        seen.key == key && seen.count > 0
    }

    /// Takes note of a request.
    #[inline]
    pub fn remember(&mut self, frame: &[u8]) {
        let (key, slot) = key(frame);
        let seen = &mut self.seen[slot];
        if seen.key == key && seen.count >= 2 {
            seen.count = (seen.count + 1).min(OFTEN);
        } else {
            self.newcomer(frame, key, slot);
        }
    }

    /// The same of one that was not seen twice yet.
    fn newcomer(&mut self, frame: &[u8], key: u64, slot: usize) {
        let seen = &mut self.seen[slot];
        // It takes the place of a request that has not come back for long.
        if seen.key != key {
            if seen.count > 0 {
                seen.count -= 1;
                return;
            }
            (seen.key, seen.count) = (key, 1);
            self.replace(frame, slot);
            return;
        }
        seen.count += 1;
        if seen.count == 2 && self.texts[slot][0] > 0 && !seen.listed {
            seen.listed = true;
            if self.places.len() == MOST {
                let first = self.places.remove(0);
                self.seen[usize::from(first)].listed = false;
                self.index.shift();
                self.sift.shift();
            }
            let (at, frame) = (self.places.len(), text(&self.texts[slot]));
            self.index.add(at, frame);
            self.sift.add(at, frame);
            self.places.push(slot as u16);
        }
    }

    /// Puts another request in a place.
    fn replace(&mut self, frame: &[u8], slot: usize) {
        let place = || self.places.iter().position(|&place| usize::from(place) == slot);
        let listed = self.seen[slot].listed.then(place).flatten();
        let bytes = &mut self.texts[slot];
        if let Some(at) = listed {
            self.index.remove(at, text(bytes));
            self.sift.remove(at, text(bytes));
        }
        bytes[0] = 0;
        if frame.len() < SHORT {
            bytes[0] = frame.len() as u8;
            bytes[1..=frame.len()].copy_from_slice(frame);
        }
        if let Some(at) = listed {
            self.index.add(at, text(bytes));
            self.sift.add(at, text(bytes));
        }
    }

    /// One of those that came again; empty, if its place was taken by a long one.
    pub fn get(&self, at: usize) -> &[u8] {
        text(&self.texts[usize::from(self.places[at])])
    }

    /// Whether none came again yet.
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Those that may begin here.
    pub fn possible(&self, bytes: &[u8]) -> Set {
        self.index.possible(bytes)
    }

    /// Those of them that are worth `need` bits once `costs` are paid; `bits` says what a byte is worth.
    pub fn likely(&self, possible: Set, bytes: &[u8], bits: impl Fn(u8) -> f32, need: f32, costs: &Costs) -> Set {
        self.sift.likely(possible, bytes, bits, need, costs)
    }
}

/// A request as it is remembered.
fn text(text: &Text) -> &[u8] {
    &text[1..=usize::from(text[0])]
}

/// What tells a request from others, and its place in the dictionary: its first and last bytes, the checksum among
/// them, and its length. That is quicker than to go through all of its bytes.
fn key(frame: &[u8]) -> (u64, usize) {
    let head = frame.first_chunk().map_or_else(
        || frame.iter().fold(0, |head, &byte| head << 8 | u64::from(byte)),
        |head: &[u8; 8]| u64::from_le_bytes(*head),
    );
    let tail = frame.last_chunk().map_or(0, |tail: &[u8; 4]| u64::from(u32::from_le_bytes(*tail)));
    let tail = tail << 16 ^ frame.len() as u64;
    // Odd numbers without pattern (the golden ratio's and the square root of two's bits) spread what differs in few bits.
    let hash = head.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ tail.wrapping_mul(0xB504_F333_F9DE_6485);
    (hash, (hash >> 48) as usize % SEEN)
}
