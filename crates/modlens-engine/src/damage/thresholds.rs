//! The thresholds and costs of the decision between noise and a damaged frame, with their reasons.

use modlens_protocol::Ns;

/// Score that a damaged frame needs to be reported. Noise looks like one with a probability of about 2 to the minus this.
pub const MIN_DAMAGED_FRAME_BITS: f32 = 10.0;

/// Tolerance for sums of the same numbers that were added in a different order.
pub const ROUNDING_BITS: f32 = 0.01;

/// Cost of a further damaged frame in the same region: damage is rare, so two damaged frames need more evidence than one.
pub const FURTHER_DAMAGED_FRAME_BITS: f32 = 8.0;

/// Damaged frames are searched for in so many bytes at each end of a region; what lies between in a longer one is noise.
pub const SEARCHED_BYTES: usize = 320;

/// Gain of a candidate that ends exactly where a pause, a valid frame or the end of the recording is.
pub const FRAME_END_BITS: f32 = 4.0;

/// The most that the stray bytes in front of a candidate cost together.
pub const MAX_STRAY_BITS: f32 = 6.8;

/// Cost of a frame that begins before the announced end of the damaged frame in front of it.
pub const OVERLAP_BITS: f32 = 3.0;

/// A line driver that is switched leaves at most so many stray bytes of one value next to a frame.
pub const MAX_GLITCH_BYTES: usize = 3;

/// In a longer frame, one inserted byte makes the CRC valid by chance in too many places to mean anything.
pub const MAX_INSERTION_CHECK_BYTES: usize = 40;

/// USB adapters and schedulers seldom delay the rest of a frame for longer than this.
pub const COARSE_FRAME_GAP_NS: Ns = 45_000_000;

/// Selection cost of the response to the outstanding request, or of the frame that the next one repeats or answers.
pub const DUE_FRAME_BITS: f32 = 1.0;

/// Selection cost of a retry of the outstanding request.
pub const RETRY_BITS: f32 = 4.0;

/// Selection cost of any request of the poll cycle.
pub const POLL_REQUEST_BITS: f32 = 5.0;

/// Cost of bytes that are missing in front of a frame.
pub const MISSING_HEAD_BITS: f32 = 5.0;

/// Cost of one to three bytes that are missing inside a frame: what happened, and where.
pub const MISSING_INSIDE_BITS: f32 = 6.0;

/// Cost of a byte that was received twice: what happened, and where.
pub const DOUBLED_BYTE_BITS: f32 = 8.0;

/// Cost of a second transmitter from some byte of a frame on.
pub const COLLISION_BITS: f32 = 5.0;

/// Cost of a byte in which a collision seems to have set bits to 1, which it cannot do.
pub const COLLISION_MISFIT_BITS: f32 = 4.0;

/// Cost of a byte with one flipped bit.
pub const ONE_FLIP_BITS: f32 = 9.0;

/// Cost of a byte with two flipped bits.
pub const TWO_FLIPS_BITS: f32 = 13.0;

/// Cost of a byte with three flipped bits. Bytes with more flipped bits do not agree at all.
pub const THREE_FLIPS_BITS: f32 = 17.0;

/// The most flipped bits in unit and function code together at which the two are still recognised.
pub const MAX_HEADER_FLIPS: u32 = 3;

/// Gain for a CRC that is valid once the damage is corrected.
pub const CRC_MATCH_BITS: f32 = 16.0;

/// Gain for a single flipped bit that explains the wrong CRC. The bits that say which one it is are subtracted from it.
pub const CRC_CORRECTABLE_BITS: f32 = 13.0;

/// Gain for one more byte of a run of equal values, which was to be expected.
pub const RUN_BYTE_BITS: f32 = 0.3;

/// Comparison stops where the score has fallen so far below its maximum.
pub const MAX_SCORE_DROP_BITS: f32 = 12.0;
