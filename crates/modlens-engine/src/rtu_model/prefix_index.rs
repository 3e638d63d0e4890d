//! Which of up to 64 known frames may begin at a place, with up to `MAX_LOST_BYTES` bytes missing in front.
//!
//! Two bytes tell it, and nearly everywhere the answer is none. A set of frames is one machine word, so all of them are
//! looked at in a few operations.

/// Bytes that are lost at one place, at most, where a frame is still recognised by what is left of it.
pub const MAX_LOST_BYTES: usize = 3;

/// A set of frames: bit `n` stands for frame number `n`.
pub type FrameSet = u64;

/// The number of frames that a set holds.
pub const MAX_FRAMES: usize = FrameSet::BITS as usize;

/// The numbers in a set, in ascending order.
pub fn members(mut set: FrameSet) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let at = (set != 0).then(|| set.trailing_zeros() as usize);
        set &= set.wrapping_sub(1);
        at
    })
}

/// The frames that may begin with these bytes: their unit or function code is here, or two of their next bytes are and
/// the ones before, `most_missing` at most, are missing.
///
/// `with_byte(place, byte)` is the set of frames that have this byte at this place.
pub fn possible_frames(bytes: &[u8], most_missing: usize, with_byte: impl Fn(usize, u8) -> FrameSet) -> FrameSet {
    let Some(&first) = bytes.first() else { return 0 };
    // A single byte is left of a short frame.
    let Some(&second) = bytes.get(1) else { return with_byte(0, first) | with_byte(1, first) };
    let headless = |lost: usize| with_byte(lost, first) & with_byte(lost + 1, second);
    (1..=most_missing).fold(with_byte(0, first) | with_byte(1, second), |set, lost| set | headless(lost))
}

/// Whether a frame of which only the first bytes are known may have this byte at this place.
pub fn may_have_byte(known: &[u8], place: usize, byte: u8) -> bool {
    known.get(place).is_none_or(|&known| known == byte)
}

/// A coarse test before `possible_frames`: the byte values that a few frames may begin with. It admits too much, never too
/// little.
#[derive(Default)]
pub struct PrefixFilter {
    /// Values that the first byte may have, one bit each.
    first: [u64; 4],
    /// Values that the second byte may have.
    second: [u64; 4],
}

impl PrefixFilter {
    /// Admits one more frame, of which the first bytes are known, and `most_missing` of them may be lost.
    pub fn add(&mut self, known: &[u8], most_missing: usize) {
        let put = |set: &mut [u64; 4], byte: u8| set[usize::from(byte >> 6)] |= 1 << (byte & 63);
        // Where all of them may be lost, any byte may be first.
        if known.len() <= most_missing {
            self.first = [u64::MAX; 4];
        }
        for &byte in known.iter().take(most_missing + 1) {
            put(&mut self.first, byte);
        }
        if let Some(&byte) = known.get(1) {
            put(&mut self.second, byte);
        }
    }

    /// Whether any of the frames may begin with these bytes; `possible_frames` says which.
    pub fn admits(&self, bytes: &[u8]) -> bool {
        let has = |set: &[u64; 4], byte: u8| set[usize::from(byte >> 6)] >> (byte & 63) & 1 == 1;
        bytes.first().is_some_and(|&byte| has(&self.first, byte)) || bytes.get(1).is_some_and(|&byte| has(&self.second, byte))
    }
}

/// An index over the first bytes of up to 64 frames: for each place and byte value, the frames that have it there.
pub struct PrefixIndex {
    with_byte: Box<[[FrameSet; 256]; MAX_LOST_BYTES + 2]>,
}

impl Default for PrefixIndex {
    fn default() -> Self {
        Self { with_byte: Box::new([[0; 256]; MAX_LOST_BYTES + 2]) }
    }
}

impl PrefixIndex {
    /// An index of these frames, `MAX_FRAMES` of them at most.
    #[cfg(test)]
    pub fn of<'a>(frames: impl Iterator<Item = &'a [u8]>) -> Self {
        let mut this = Self::default();
        for (number, frame) in frames.enumerate() {
            this.add(number, frame);
        }
        this
    }

    /// Adds a frame under a number that is free. An empty frame begins nowhere.
    pub fn add(&mut self, number: usize, frame: &[u8]) {
        self.update(number, frame, |set, one| set | one);
    }

    /// Removes the frame of this number.
    pub fn remove(&mut self, number: usize, frame: &[u8]) {
        self.update(number, frame, |set, one| set & !one);
    }

    fn update(&mut self, number: usize, frame: &[u8], change: impl Fn(FrameSet, FrameSet) -> FrameSet) {
        if frame.is_empty() {
            return;
        }
        for (place, by_value) in self.with_byte.iter_mut().enumerate() {
            match frame.get(place) {
                Some(&byte) => {
                    let set = &mut by_value[usize::from(byte)];
                    *set = change(*set, 1 << number);
                }
                // After the known bytes any value may stand.
                None => by_value.iter_mut().for_each(|set| *set = change(*set, 1 << number)),
            }
        }
    }

    /// The frames that may begin with these bytes.
    pub fn possible_frames(&self, bytes: &[u8]) -> FrameSet {
        possible_frames(bytes, MAX_LOST_BYTES, |place, byte| self.with_byte[place][usize::from(byte)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_index_finds_the_frames_that_each_frame_alone_would(
            frames in proptest::collection::vec(proptest::collection::vec(0u8..4, 0..8), 0..20),
            bytes in proptest::collection::vec(0u8..4, 0..4),
        ) {
            let index = PrefixIndex::of(frames.iter().map(Vec::as_slice));
            let alone = |frame: &[u8]| {
                possible_frames(&bytes, MAX_LOST_BYTES, |place, byte| FrameSet::from(may_have_byte(frame, place, byte))) != 0
            };
            let mut filter = PrefixFilter::default();
            for frame in frames.iter().filter(|frame| frame.len() >= 2) {
                filter.add(frame, MAX_LOST_BYTES);
            }
            prop_assert!(filter.admits(&bytes) || frames.iter().all(|frame| frame.len() < 2 || !alone(frame)));
            let one_by_one = frames.iter().enumerate().filter(|(_, frame)| !frame.is_empty() && alone(frame));
            prop_assert_eq!(index.possible_frames(&bytes), one_by_one.fold(0, |set, (number, _)| set | 1 << number));
        }

        #[test]
        fn an_updated_index_equals_a_new_one_of_the_same_frames(
            mut frames in proptest::collection::vec(proptest::collection::vec(0u8..4, 0..8), 1..20),
            other in proptest::collection::vec(0u8..4, 0..8),
            number in any::<usize>(),
        ) {
            let mut index = PrefixIndex::of(frames.iter().map(Vec::as_slice));
            let number = number % frames.len();
            index.remove(number, &frames[number]);
            index.add(number, &other);
            frames[number] = other;
            prop_assert_eq!(index.with_byte, PrefixIndex::of(frames.iter().map(Vec::as_slice)).with_byte);
        }
    }
}
