//! What a line's clock is worth: how late its reads come, learned from the frames themselves.
//!
//! Inside a frame there is next to no silence. Where a read ends inside a frame, the silence that its time seems to
//! show is lateness: of the FTDI latency timer (16 ms out of the box), of CH340 packets, of a 16550's FIFO, of a serial
//! server's segments, or of the scheduler. Times that differ by less than that cannot be told apart.

use crate::input::Input;
use modlens_protocol::Ns;

/// Single bytes with their own times.
const BYTE_RESOLUTION: Ns = 1_000;

/// Reads of several bytes: schedulers make them late by about so much, whatever the adapter.
const READ_RESOLUTION: Ns = 1_000_000;

/// No adapter holds bytes back for longer; a longer pause is the sender's.
const MOST_LATENESS: f64 = 50e6;

/// One read in ten may be later than what is learned.
const LATER: f64 = 0.1;

/// How fast that is learned.
const RATE: f64 = 0.15;

/// How late the reads of a line are.
#[derive(Clone, Copy, Debug)]
pub struct Lateness {
    /// Nine reads in ten are less late than this.
    ns: f64,
}

impl Default for Lateness {
    fn default() -> Self {
        Self { ns: READ_RESOLUTION as f64 }
    }
}

impl Lateness {
    /// Learns from a good frame: the first `length` bytes of the input.
    pub fn learn(&mut self, input: &Input, length: usize) {
        if !input.coarse {
            return;
        }
        let (later, all) = input.later_reads(length, self.ns as Ns);
        if all == 0 {
            return;
        }
        // Every read counts: the longest pause of a long frame is one of a hundred, and says little of the others.
        let step = later as f64 / all as f64 - LATER;
        self.ns = (self.ns * (RATE * step).exp()).clamp(READ_RESOLUTION as f64, MOST_LATENESS);
    }

    /// What the clock of this line can tell apart.
    pub fn resolution(self, input: &Input) -> Ns {
        if input.coarse {
            self.ns as Ns
        } else {
            BYTE_RESOLUTION
        }
    }

    /// What pairing weighs: a time that is too coarse to be reported is evidence all the same.
    pub fn least(input: &Input) -> Ns {
        if input.coarse {
            READ_RESOLUTION
        } else {
            BYTE_RESOLUTION
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_readers::chunk::{Chunk, Times};

    /// Frames of 40 bytes at 1 ms a byte, seen in reads that come so late.
    fn learned(lateness: impl Fn(usize) -> Ns) -> Ns {
        let mut clock = Lateness::default();
        for frame in 0..200 {
            let mut input = Input::new(Some(1_000_000));
            for read in 0..4 {
                let time = (read as Ns + 1) * 10_000_000 + lateness(4 * frame + read);
                input.push(&Chunk { bytes: &[0; 10], times: Times::Read(time), ..Chunk::default() });
            }
            clock.learn(&input, 40);
            if frame == 199 {
                return clock.resolution(&input);
            }
        }
        0
    }

    #[test]
    fn reads_in_time_have_the_clock_of_a_scheduler() {
        assert_eq!(learned(|_| 0), READ_RESOLUTION);
    }

    #[test]
    fn a_late_read_among_many_does_not_spoil_the_clock() {
        let mut clock = Lateness::default();
        for _ in 0..200 {
            let mut input = Input::new(Some(1_000_000));
            for read in 0..40 {
                let late = if read == 20 { 3_000_000 } else { 0 };
                let bytes: &[u8] = if read == 0 { &[0; 2] } else { &[0] };
                let time = (read + 1) * 1_000_000 + late;
                input.push(&Chunk { bytes, times: Times::Read(time), ..Chunk::default() });
            }
            clock.learn(&input, 41);
            assert_eq!(clock.resolution(&input), READ_RESOLUTION);
        }
    }

    #[test]
    fn a_latency_timer_shows() {
        let resolution = learned(|read| (read * 7 % 16) as Ns * 1_000_000);
        assert!((5_000_000..16_000_000).contains(&resolution), "{resolution}");
    }
}
