//! What no line can do with the settings that are given: bytes that come closer together than the rate allows, more of them
//! than fit into the time, and line errors in frames whose checksum proves that they arrived right.
//!
//! One frame proves nothing: a busy host delivers a late read and the next one in time. So frames are counted, and the line is
//! judged at the end of its recording.

use crate::input::Input;
use modlens_protocol::Ns;

/// Frames before a line is judged.
const MIN_FRAMES: u64 = 20;

/// Bytes are closer together than the rate allows if they take less than this share of their time: clocks, stop bits and
/// tolerances of rates (serial line specification, 3.2) explain the rest.
const MIN_TIME_SHARE: f64 = 0.85;

/// The bytes need more time than the recording has if they exceed it by this factor, ...
const MIN_OVERFULL_FACTOR: f64 = 1.1;

/// ... and by this time, which covers clocks with a step of a second.
const MIN_OVERFULL_NS: Ns = 2_000_000_000;

/// A line contradicts its settings if more than one in so many of its frames does.
const FRAMES_PER_CONTRADICTION: u64 = 2;

/// Errors are reported in nearly all valid frames if at most one in so many has none.
const FRAMES_PER_CLEAN_FRAME: u64 = 10;

/// What contradicts physics or the settings of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Contradiction {
    /// Bytes of `frames` of `timed` frames come too close together; those of the worst one take `needed` and came within `had`.
    Faster { frames: u64, timed: u64, bytes: usize, needed: Ns, had: Ns },
    /// All bytes take `needed`, and the recording lasts `had`.
    Overfull { bytes: u64, needed: Ns, had: Ns },
    /// The receiver reported errors in `frames` of `valid` frames.
    ErrorsOnValid { frames: u64, valid: u64 },
}

/// Good frames that contradict the settings of their line.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ContradictionCounts {
    /// Frames of several reads with times.
    timed: u64,
    /// Those of them whose bytes come closer together than the rate allows.
    faster: u64,
    /// The bytes of the worst one, the time that they take, and the time within which they came.
    worst: Option<(usize, Ns, Ns)>,
    /// Frames in which the receiver reported errors.
    with_errors: u64,
}

impl ContradictionCounts {
    /// Counts a good frame, the first `length` bytes of the input. `step`: the finest step of the line's clock, in ns.
    pub(crate) fn add(&mut self, input: &Input, length: usize, step: Ns) {
        self.with_errors += u64::from(input.has_line_error(0, length));
        let Some((bytes, had)) = input.span_of_reads(length) else { return };
        let needed = bytes as Ns * input.char_ns.unwrap_or(0);
        self.timed += 1;
        if (needed as f64 * MIN_TIME_SHARE) as Ns <= had + 2 * step {
            return;
        }
        self.faster += 1;
        if self.worst.is_none_or(|(_, worst, within)| needed - had > worst - within) {
            self.worst = Some((bytes, needed, had));
        }
    }

    /// What contradicts the settings of the line. The counts begin again.
    ///
    /// `valid`: its good frames; `all`: its bytes, the time that they take at its settings, and how long its recording lasts.
    pub(crate) fn take(&mut self, valid: u64, all: Option<(u64, Ns, Ns)>) -> Vec<Contradiction> {
        let Self { timed, faster, worst, with_errors } = std::mem::take(self);
        let mut found = Vec::new();
        if let Some((bytes, needed, had)) = worst.filter(|_| timed >= MIN_FRAMES && faster * FRAMES_PER_CONTRADICTION > timed) {
            found.push(Contradiction::Faster { frames: faster, timed, bytes, needed, had });
        }
        let is_overfull =
            |needed: Ns, had: Ns| had > 0 && needed - had > MIN_OVERFULL_NS && needed as f64 > MIN_OVERFULL_FACTOR * had as f64;
        if let Some((bytes, needed, had)) = all.filter(|&(_, needed, had)| valid >= MIN_FRAMES && is_overfull(needed, had)) {
            found.push(Contradiction::Overfull { bytes, needed, had });
        }
        if valid >= MIN_FRAMES && with_errors.min(valid) * FRAMES_PER_CLEAN_FRAME >= valid * (FRAMES_PER_CLEAN_FRAME - 1) {
            found.push(Contradiction::ErrorsOnValid { frames: with_errors.min(valid), valid });
        }
        found
    }
}
