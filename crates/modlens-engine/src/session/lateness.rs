//! How late the reads of a line come, learned from the frames themselves. It limits what times on this line mean.
//!
//! Inside a frame there is next to no silence. Where a read ends inside a frame, the silence that its time seems to show
//! is the lateness of the next read: from the FTDI latency timer (16 ms by default), CH340 packets, the FIFO of a 16550,
//! the segments of a serial server, or the scheduler. Times that differ by less than that may be in any order.

use crate::input::Input;
use modlens_protocol::Ns;

/// The resolution where every byte has its own time.
const BYTE_RESOLUTION_NS: Ns = 1_000;

/// The finest resolution where reads have several bytes: schedulers make them late by about this, whatever the adapter.
const READ_RESOLUTION_NS: Ns = 1_000_000;

/// No adapter holds bytes back for longer than this; a longer silence inside a frame is the sender's.
const MAX_LATENESS_NS: f64 = 50e6;

/// Share of the reads that may be later than the learned lateness, which is thus the 90th percentile.
const LATER_SHARE: f64 = 0.1;

/// How far one frame moves the estimate: its logarithm changes by at most this.
const LEARNING_RATE: f64 = 0.15;

/// How late the reads of a line come.
#[derive(Clone, Copy, Debug)]
pub struct Lateness {
    /// Nine reads in ten are less late than this, in ns.
    percentile_90: f64,
}

impl Default for Lateness {
    fn default() -> Self {
        Self { percentile_90: READ_RESOLUTION_NS as f64 }
    }
}

impl Lateness {
    /// Learns from a good frame, the first `length` bytes of the input, by a step towards the percentile: up by the share of
    /// its reads, the first one left out, that were later than the estimate, down by the share that may be. The estimate
    /// stays between 1 and 50 ms. Nothing is learned from a frame in one read, or if every byte has its own time.
    pub fn learn(&mut self, input: &Input, length: usize) {
        if !input.has_multibyte_reads {
            return;
        }
        let (later, reads) = input.count_pauses(length, self.percentile_90 as Ns);
        if reads == 0 {
            return;
        }
        // All reads count, not only the latest: in a long frame that is one of a hundred and says little about the rest.
        let step = later as f64 / reads as f64 - LATER_SHARE;
        let moved = self.percentile_90 * (LEARNING_RATE * step).exp();
        self.percentile_90 = moved.clamp(READ_RESOLUTION_NS as f64, MAX_LATENESS_NS);
    }

    /// The step of this line's clock as reports have it: two times that differ by less may be in any order.
    pub fn resolution(self, input: &Input) -> Ns {
        if input.has_multibyte_reads {
            self.percentile_90 as Ns
        } else {
            BYTE_RESOLUTION_NS
        }
    }

    /// The step of this line's clock at best, as pairing has it: a time too coarse to be reported is still evidence.
    pub fn finest_resolution(input: &Input) -> Ns {
        if input.has_multibyte_reads {
            READ_RESOLUTION_NS
        } else {
            BYTE_RESOLUTION_NS
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_readers::chunk::{Chunk, Times};

    /// The resolution learned from 200 frames of 40 bytes at 1 ms a byte, in four reads each that come late by this.
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
    fn reads_in_time_have_the_resolution_of_a_scheduler() {
        assert_eq!(learned(|_| 0), READ_RESOLUTION_NS);
    }

    #[test]
    fn one_late_read_among_forty_does_not_coarsen_the_resolution() {
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
            assert_eq!(clock.resolution(&input), READ_RESOLUTION_NS);
        }
    }

    #[test]
    fn a_latency_timer_coarsens_the_resolution() {
        let resolution = learned(|read| (read * 7 % 16) as Ns * 1_000_000);
        assert!((5_000_000..16_000_000).contains(&resolution), "{resolution}");
    }
}
