//! What a stream has delivered last, to compare it with what comes again.

/// So many bytes of a direction are kept at least, and fewer than twice as many.
const KEPT_BYTES: usize = 2048;

/// How far the sequence number `a` is ahead of `b`, modulo 2^32 (RFC 9293, 3.4).
pub(super) fn ahead(a: u32, b: u32) -> i32 {
    a.wrapping_sub(b) as i32
}

/// Bytes that came twice with the same sequence numbers, and not the same: from the first to the last one that differs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Conflict {
    /// Position in the payload of the second version.
    pub at: usize,
    /// The version that came first, which the stream has delivered or will.
    pub first: Vec<u8>,
    /// The version that came second, which is in no frame.
    pub second: Vec<u8>,
}

impl Conflict {
    /// The one between two pieces of a direction, each with the sequence number of its first byte.
    pub(super) fn between((start, first): (u32, &[u8]), (again, second): (u32, &[u8])) -> Option<Self> {
        let distance = ahead(again, start);
        let (skip_first, skip_second) = (distance.max(0) as usize, distance.saturating_neg().max(0) as usize);
        let common = first.get(skip_first..)?.iter().zip(second.get(skip_second..)?);
        let mut differing = common.enumerate().filter(|(_, (one, other))| one != other).map(|(at, _)| at);
        let from = differing.next()?;
        let to = differing.next_back().unwrap_or(from) + 1;
        Some(Self {
            at: skip_second + from,
            first: first[skip_first + from..skip_first + to].to_vec(),
            second: second[skip_second + from..skip_second + to].to_vec(),
        })
    }
}

/// The last bytes of a direction, without a gap, up to the next one expected.
#[derive(Debug, Default)]
pub(super) struct Delivered {
    bytes: Vec<u8>,
}

impl Delivered {
    /// Adds the next bytes.
    #[inline]
    pub(super) fn push(&mut self, bytes: &[u8]) {
        if self.bytes.len() + bytes.len() > 2 * KEPT_BYTES {
            self.make_room(bytes.len());
        }
        self.bytes.extend_from_slice(&bytes[bytes.len().saturating_sub(2 * KEPT_BYTES)..]);
    }

    /// Keeps what fits beside so many bytes.
    #[cold]
    fn make_room(&mut self, coming: usize) {
        let kept = self.bytes.len().min(KEPT_BYTES.saturating_sub(coming));
        self.bytes.drain(..self.bytes.len() - kept);
    }

    /// Forgets all of them: bytes are missing after them.
    pub(super) fn clear(&mut self) {
        self.bytes.clear();
    }

    /// Where these bytes, which begin at the sequence number `start`, contradict those before `next`.
    pub(super) fn conflict(&self, next: u32, start: u32, bytes: &[u8]) -> Option<Conflict> {
        let first = next.wrapping_sub(self.bytes.len() as u32);
        Conflict::between((first, &self.bytes), (start, bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sequence numbers wrap inside of what is kept.
    const NEXT: u32 = 3;

    fn delivered() -> Delivered {
        let mut delivered = Delivered::default();
        delivered.push(b"abcd");
        delivered.push(b"efgh");
        delivered
    }

    #[test]
    fn the_same_bytes_are_no_conflict_wherever_they_begin() {
        for start in 0..8 {
            let again = &b"abcdefgh12"[start..];
            assert_eq!(delivered().conflict(NEXT, NEXT.wrapping_sub(8 - start as u32), again), None);
        }
        // Before all that is kept, and after it.
        assert_eq!(delivered().conflict(NEXT, NEXT.wrapping_sub(12), b"1234abcd"), None);
        assert_eq!(delivered().conflict(NEXT, NEXT.wrapping_sub(40), b"1234"), None);
        assert_eq!(delivered().conflict(NEXT, NEXT, b"1234"), None);
        assert_eq!(delivered().conflict(NEXT, NEXT.wrapping_add(9), b"1234"), None);
    }

    #[test]
    fn other_bytes_are_named_from_the_first_to_the_last() {
        let found = |at, first: &[u8], second: &[u8]| Some(Conflict { at, first: first.to_vec(), second: second.to_vec() });
        assert_eq!(delivered().conflict(NEXT, NEXT.wrapping_sub(5), b"dEfGh12"), found(1, b"efg", b"EfG"));
        assert_eq!(delivered().conflict(NEXT, NEXT.wrapping_sub(9), b"?Abcdefgh"), found(1, b"a", b"A"));
    }

    #[test]
    fn the_last_bytes_are_kept_and_no_more_than_twice_the_least() {
        let mut delivered = Delivered::default();
        for turn in 0..1000u32 {
            delivered.push(&turn.to_be_bytes());
            assert!(delivered.bytes.len() <= 2 * KEPT_BYTES);
        }
        assert!(delivered.bytes.len() >= KEPT_BYTES && delivered.bytes.ends_with(&999u32.to_be_bytes()));
        delivered.push(&[7; 5 * KEPT_BYTES]);
        assert_eq!(delivered.bytes, [7; 2 * KEPT_BYTES]);
    }
}
