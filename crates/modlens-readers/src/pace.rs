//! Decides how often a live line is read: whenever bytes arrive, or less often where nothing is lost by that.

use std::time::Duration;

use modlens_protocol::Ns;

/// Measures whether a line is saturated, and how long its reader may sleep then.
///
/// Each read wakes a thread, which costs the same however many bytes it brings. A line with pauses has to be read at once,
/// because the times of the reads show the pauses, which tell where frames begin and how long a response took. A saturated
/// line carries character after character without pauses, so it is read less often, until a read brings fewer bytes than
/// the line can carry.
#[derive(Default)]
pub struct ReadPacer {
    /// Bytes since the last pause.
    bytes: usize,
    /// The time of the last pause.
    pause_end: Ns,
    /// The time of the last read.
    last_read: Ns,
    /// The reader has slept before the last read.
    has_slept: bool,
}

impl ReadPacer {
    /// A gap between reads that may be a pause between frames: t3.5 is 1.75 ms or more (serial line, 2.5.1.1).
    const PAUSE_NS: Ns = 1_750_000;

    /// A line is saturated only if it has carried so many bytes, two frames of the greatest length, without a pause.
    const MIN_BYTES_WITHOUT_PAUSE: usize = 512;

    /// The longest sleep, by which users see the traffic later.
    const MAX_SLEEP_NS: Ns = 8_000_000;

    /// A sleep must not last longer than the line needs for so many characters, because drivers buffer a few thousand.
    const MAX_SLEEP_CHARS: Ns = 2048;

    /// Records a read of `length` bytes at `time` and returns how long the reader may sleep before the next one. `char_ns`
    /// is the time of a character on the line; where it is 0, because it is not known, the reader never sleeps.
    pub fn sleep_after(&mut self, length: usize, time: Ns, char_ns: Ns) -> Duration {
        let gap = time - self.last_read;
        self.last_read = time;
        let has_pause = if self.has_slept {
            // A read after a sleep has to bring three quarters of what the line can carry; a scheduler that is late by a
            // millisecond or two explains the rest.
            4 * length as Ns * char_ns < 3 * gap
        } else {
            gap > Self::PAUSE_NS
        };
        self.bytes += length;
        // Nine tenths of the capacity count as saturated, because the count does not begin exactly with a character.
        let is_saturated = self.bytes as Ns * char_ns * 10 >= (time - self.pause_end) * 9;
        if has_pause || (self.bytes > Self::MIN_BYTES_WITHOUT_PAUSE && !is_saturated) {
            *self = Self { bytes: 0, pause_end: time, last_read: time, has_slept: false };
        }
        self.has_slept = self.bytes > Self::MIN_BYTES_WITHOUT_PAUSE;
        if self.has_slept {
            Duration::from_nanos((Self::MAX_SLEEP_CHARS * char_ns).clamp(0, Self::MAX_SLEEP_NS) as u64)
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

    /// For reads at these times in ms of so many bytes, whether the reader may sleep after each.
    fn rests(reads: impl IntoIterator<Item = (Ns, usize)>) -> Vec<bool> {
        let mut pace = ReadPacer::default();
        reads.into_iter().map(|(ms, length)| !pace.sleep_after(length, ms * MS, CHAR).is_zero()).collect()
    }

    #[test]
    fn a_saturated_line_is_read_less_often() {
        let found = rests((100..200).map(|ms| (ms, if ms % 2 == 0 { 10 } else { 11 })));
        assert_eq!(found.iter().position(|&rest| rest), Some(49), "512 bytes after the first read");
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
    fn a_short_read_after_a_sleep_shows_a_pause() {
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
            rest = pace.sleep_after(300, ms * MS, 3_333);
        }
        assert!(rest > Duration::from_millis(6) && rest < Duration::from_millis(7), "{rest:?}");
    }

    #[test]
    fn a_line_with_unknown_settings_is_read_at_once() {
        let mut pace = ReadPacer::default();
        assert!((1..500).all(|ms| pace.sleep_after(300, ms * MS, 0).is_zero()));
    }
}
