//! How often a live line is read: as its bytes come, or less often where that loses nothing.

use std::time::Duration;

use modlens_protocol::Ns;

/// Whether a line is full, and how long it may be left alone then.
///
/// Each read costs the waking of a thread, whatever it brings. A line with pauses needs them: they tell where frames begin,
/// and how long an answer took. A line that carries character behind character has none to tell, and is read less often
/// until a read brings less than the line can carry.
#[derive(Default)]
pub struct ReadPacer {
    bytes: usize,
    since: Ns,
    newest: Ns,
    resting: bool,
}

impl ReadPacer {
    /// Frames that follow each other have at least t3.5 between them, 1.75 ms or more (serial line, 2.5.1.1).
    const PAUSE: Ns = 1_750_000;

    /// Bytes of two of the longest frames: who has seen so many without a pause knows whether the line is full.
    const LEAST: usize = 512;

    /// What is printed of a line is printed so late.
    const REST: Ns = 8_000_000;

    /// Drivers hold a few thousand bytes.
    const MOST: Ns = 2048;

    /// Counts a read of a line whose characters take `char_ns` (0: never left alone); how long to leave it alone.
    pub fn rest(&mut self, length: usize, time: Ns, char_ns: Ns) -> Duration {
        let gap = time - self.newest;
        self.newest = time;
        let paused = if self.resting {
            // Three quarters: a scheduler may be late by a millisecond or two.
            4 * length as Ns * char_ns < 3 * gap
        } else {
            gap > Self::PAUSE
        };
        self.bytes += length;
        // Nine tenths: receivers lose no character, but who counts begins in the middle of one.
        let full = self.bytes as Ns * char_ns * 10 >= (time - self.since) * 9;
        if paused || (self.bytes > Self::LEAST && !full) {
            *self = Self { bytes: 0, since: time, newest: time, resting: false };
        }
        self.resting = self.bytes > Self::LEAST;
        if self.resting {
            Duration::from_nanos((Self::MOST * char_ns).clamp(0, Self::REST) as u64)
        } else {
            Duration::ZERO
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    /// A character of 11 bits at 115200 baud.
    const CHAR: Ns = 95_486;

    /// Reads of so many bytes at so many ms; whether the line is left alone after each.
    fn rests(reads: impl IntoIterator<Item = (Ns, usize)>) -> Vec<bool> {
        let mut pace = ReadPacer::default();
        reads.into_iter().map(|(ms, length)| !pace.rest(length, ms * MS, CHAR).is_zero()).collect()
    }

    #[test]
    fn a_full_line_is_read_less_often() {
        let found = rests((100..200).map(|ms| (ms, if ms % 2 == 0 { 10 } else { 11 })));
        assert_eq!(found.iter().position(|&rest| rest), Some(49), "512 bytes behind the first read");
        assert!(found[49..].iter().all(|&rest| rest));
    }

    #[test]
    fn a_line_with_pauses_is_read_as_its_bytes_come() {
        // 19 bytes, 2 ms of silence, and so on: frames of a bus that is as busy as the specification allows.
        let polls = (0..500).flat_map(|turn| [(100 + 4 * turn, 11), (101 + 4 * turn, 8)]);
        assert!(rests(polls).iter().all(|&rest| !rest));
    }

    #[test]
    fn a_line_with_gaps_between_characters_is_read_as_its_bytes_come() {
        // Read late, such a line would seem to have pauses inside its frames.
        assert!(rests((100..5000).map(|ms| (ms, 4))).iter().all(|&rest| !rest));
    }

    #[test]
    fn a_pause_is_found_in_the_length_of_a_read() {
        let full = (100..150).map(|ms| (ms, 11)).chain((1..20).map(|turn| (149 + 8 * turn, 83)));
        assert!(rests(full.clone())[50..].iter().all(|&rest| rest));
        let paused = full.chain([(309, 50), (310, 11), (311, 11)]);
        assert_eq!(rests(paused)[69..], [false, false, false]);
    }

    #[test]
    fn a_fast_line_is_read_before_its_driver_is_full() {
        let mut pace = ReadPacer::default();
        let mut rest = Duration::ZERO;
        for ms in 1..20 {
            rest = pace.rest(300, ms * MS, 3_333);
        }
        assert!(rest > Duration::from_millis(6) && rest < Duration::from_millis(7), "{rest:?}");
    }

    #[test]
    fn a_line_without_settings_is_never_left_alone() {
        let mut pace = ReadPacer::default();
        assert!((1..500).all(|ms| pace.rest(300, ms * MS, 0).is_zero()));
    }
}
