//! How often a live line is read: as its bytes come, or less often where that loses nothing.

use std::time::Duration;

use crate::Ns;

/// Whether a line carries bytes without a pause, and how long it may be left alone then.
///
/// Each read costs the waking of a thread, whatever it brings. A line with pauses needs them: they tell where frames begin,
/// and how long an answer took. A line that has none is read less often, until a read brings less than the line carries.
#[derive(Default)]
pub struct Pace {
    bytes: usize,
    since: Ns,
    newest: Ns,
    resting: bool,
}

impl Pace {
    /// Frames that follow each other have at least t3.5 between them, 1.75 ms or more (serial line, 2.5.1.1).
    const PAUSE: Ns = 1_750_000;

    /// Bytes of two of the longest frames: a line that has carried so many without a pause has none to tell.
    const LEAST: usize = 512;

    /// What is printed of a line is printed so late.
    const REST: Ns = 8_000_000;

    /// Drivers hold a few thousand bytes.
    const MOST: usize = 2048;

    /// Counts a read; how long the line may be left alone.
    pub fn rest(&mut self, length: usize, time: Ns) -> Duration {
        let (gap, all) = (time - self.newest, self.newest - self.since);
        let paused = if self.resting {
            // Less than three quarters of what the line has carried in as much time.
            4 * length as i128 * i128::from(all) < 3 * self.bytes as i128 * i128::from(gap)
        } else {
            gap > Self::PAUSE
        };
        self.newest = time;
        if paused {
            *self = Self { bytes: 0, since: time, newest: time, resting: false };
            return Duration::ZERO;
        }
        self.bytes += length;
        self.resting = self.bytes > Self::LEAST;
        if !self.resting {
            return Duration::ZERO;
        }
        let filled = (time - self.since) as u64 * Self::MOST as u64 / self.bytes as u64;
        Duration::from_nanos(filled.min(Self::REST as u64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Ns = 1_000_000;

    /// Reads of so many bytes at so many ms; whether the line is left alone after each.
    fn rests(reads: impl IntoIterator<Item = (Ns, usize)>) -> Vec<bool> {
        let mut pace = Pace::default();
        reads.into_iter().map(|(ms, length)| !pace.rest(length, ms * MS).is_zero()).collect()
    }

    #[test]
    fn a_line_without_pauses_is_read_less_often() {
        let found = rests((100..200).map(|ms| (ms, 11)));
        assert_eq!(found.iter().position(|&rest| rest), Some(47), "behind the first read that ends 512 bytes");
        assert!(found[47..].iter().all(|&rest| rest));
    }

    #[test]
    fn a_line_with_pauses_is_read_as_its_bytes_come() {
        // 19 bytes, 2 ms of silence, and so on: frames of a bus that is as busy as the specification allows.
        let polls = (0..500).flat_map(|turn| [(100 + 4 * turn, 11), (101 + 4 * turn, 8)]);
        assert!(rests(polls).iter().all(|&rest| !rest));
    }

    #[test]
    fn a_pause_is_found_in_the_length_of_a_read() {
        let stream = (100..148).map(|ms| (ms, 11)).chain((1..20).map(|turn| (147 + 7 * turn, 77)));
        assert!(*rests(stream.clone()).last().unwrap());
        let paused = stream.chain([(287, 50), (288, 11), (289, 11)]);
        assert_eq!(rests(paused)[67..], [false, false, false]);
    }

    #[test]
    fn a_fast_line_is_read_before_its_driver_is_full() {
        let mut pace = Pace::default();
        let mut rest = Duration::ZERO;
        for ms in 1..20 {
            rest = pace.rest(300, ms * MS);
        }
        assert!(rest > Duration::from_millis(6) && rest < Duration::from_millis(7), "{rest:?}");
    }
}
