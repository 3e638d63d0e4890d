//! Which frames may begin at a place with a few bytes missing, told from two bytes: nearly everywhere it is none.

/// Bytes that are lost at one place, at most, where a frame is to be recognised behind them.
pub const MOST_LOST: usize = 3;

/// Frames, one bit each.
pub type Set = u64;

/// The most frames that are told apart.
pub const MOST: usize = Set::BITS as usize;

/// Frames whose unit or function code stands here, or two of whose next bytes do, the first ones missing.
///
/// `has` says of which frames the byte at a place is this one.
pub fn possible(bytes: &[u8], has: impl Fn(usize, u8) -> Set) -> Set {
    let Some(&first) = bytes.first() else { return 0 };
    // A single byte left of a short frame.
    let Some(&second) = bytes.get(1) else { return has(0, first) | has(1, first) };
    (1..=MOST_LOST).fold(has(0, first) | has(1, second), |set, head| set | has(head, first) & has(head + 1, second))
}

/// Whether this byte of a frame of which the first bytes are known may be that one: behind them any may stand.
pub fn may_be(known: &[u8], place: usize, byte: u8) -> bool {
    known.get(place).is_none_or(|&known| known == byte)
}

/// The values that `possible` looks for, of a few frames.
#[derive(Default)]
pub struct Values {
    /// In a first byte.
    first: [u64; 4],
    /// In a second one.
    second: [u64; 4],
}

impl Values {
    /// Of one more frame of which the first bytes are known.
    pub fn add(&mut self, known: &[u8]) {
        let put = |set: &mut [u64; 4], byte: u8| set[usize::from(byte >> 6)] |= 1 << (byte & 63);
        // Of so few nothing may be left.
        if known.len() <= MOST_LOST {
            self.first = [u64::MAX; 4];
        }
        for &byte in known.iter().take(MOST_LOST + 1) {
            put(&mut self.first, byte);
        }
        if let Some(&byte) = known.get(1) {
            put(&mut self.second, byte);
        }
    }

    /// Whether any of the frames may begin here; `possible` says which.
    pub fn admit(&self, bytes: &[u8]) -> bool {
        let has = |set: &[u64; 4], byte: u8| set[usize::from(byte >> 6)] >> (byte & 63) & 1 == 1;
        bytes.first().is_some_and(|&byte| has(&self.first, byte)) || bytes.get(1).is_some_and(|&byte| has(&self.second, byte))
    }
}

/// For the first bytes of many frames and every value: the frames that have it there.
pub struct Index {
    values: Box<[[Set; 256]; MOST_LOST + 2]>,
}

impl Default for Index {
    fn default() -> Self {
        Self { values: Box::new([[0; 256]; MOST_LOST + 2]) }
    }
}

impl Index {
    /// The index of these frames, `MOST` of them at most.
    #[cfg(test)]
    pub fn of<'a>(frames: impl Iterator<Item = &'a [u8]>) -> Self {
        let mut this = Self::default();
        for (at, frame) in frames.enumerate() {
            this.add(at, frame);
        }
        this
    }

    /// Adds a frame under a number that is free; an empty one begins nowhere.
    pub fn add(&mut self, at: usize, frame: &[u8]) {
        self.change(at, frame, |set, one| set | one);
    }

    /// Takes the frame of this number away.
    pub fn remove(&mut self, at: usize, frame: &[u8]) {
        self.change(at, frame, |set, one| set & !one);
    }

    fn change(&mut self, at: usize, frame: &[u8], change: impl Fn(Set, Set) -> Set) {
        if frame.is_empty() {
            return;
        }
        for (place, values) in self.values.iter_mut().enumerate() {
            match frame.get(place) {
                Some(&byte) => {
                    let set = &mut values[usize::from(byte)];
                    *set = change(*set, 1 << at);
                }
                None => values.iter_mut().for_each(|set| *set = change(*set, 1 << at)),
            }
        }
    }

    /// Forgets the first frame: each of the others takes the number before its own.
    pub fn shift(&mut self) {
        self.values.iter_mut().flatten().for_each(|set| *set >>= 1);
    }

    /// See `possible`.
    pub fn possible(&self, bytes: &[u8]) -> Set {
        possible(bytes, |place, byte| self.values[place][usize::from(byte)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_index_says_what_the_frames_say(
            frames in proptest::collection::vec(proptest::collection::vec(0u8..4, 0..8), 0..20),
            bytes in proptest::collection::vec(0u8..4, 0..4),
        ) {
            let index = Index::of(frames.iter().map(Vec::as_slice));
            let single = |frame: &[u8]| possible(&bytes, |place, byte| Set::from(may_be(frame, place, byte))) != 0;
            let mut values = Values::default();
            for frame in frames.iter().filter(|frame| frame.len() >= 2) {
                values.add(frame);
            }
            prop_assert!(values.admit(&bytes) || frames.iter().all(|frame| frame.len() < 2 || !single(frame)));
            let one_by_one = frames.iter().enumerate().filter(|(_, frame)| !frame.is_empty() && single(frame));
            prop_assert_eq!(index.possible(&bytes), one_by_one.fold(0, |set, (at, _)| set | 1 << at));
        }

        #[test]
        fn what_is_changed_one_by_one_is_the_index_of_what_is_left(
            mut frames in proptest::collection::vec(proptest::collection::vec(0u8..4, 0..8), 1..20),
            other in proptest::collection::vec(0u8..4, 0..8),
            at in any::<usize>(),
        ) {
            let mut index = Index::of(frames.iter().map(Vec::as_slice));
            let at = at % frames.len();
            index.remove(at, &frames[at]);
            index.add(at, &other);
            index.shift();
            frames[at] = other;
            prop_assert_eq!(index.values, Index::of(frames[1..].iter().map(Vec::as_slice)).values);
        }
    }
}
