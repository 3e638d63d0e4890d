//! What evidence is worth, in bits: the table of costs and priors, with their reasons.
//!
//! A reading of the bytes is scored by the bits that it saves over reading them as line noise. One model of a byte for
//! noise and payload alike, so that a field that agrees is worth exactly the bits of the bytes it predicts, and runs of
//! zeros cannot fake evidence. What a line teaches is in `model`.

use modlens_protocol::functions::Functions;

pub use crate::framer::rtu::shapes::OPEN_LENGTH;

/// Learned counts are halved here: units and functions may change after hours.
pub const FORGET: f32 = 4000.0;

/// Whose turn it is, is forgotten sooner: time-outs come in bursts.
pub const FORGET_TURNS: f32 = 500.0;

/// Observations that a prior is worth.
pub const PRIOR_WEIGHT: f32 = 6.0;

/// A quarter of all bytes on real lines are 00, a twelfth FF.
pub const ZERO_BITS: f32 = 2.0;
/// See `ZERO_BITS`.
pub const ONES_BITS: f32 = 3.6;
/// The bits of any other byte.
pub const OTHER_BITS: f32 = 8.56;

/// Rules of the specification that a frame may break, but seldom does.
pub const BROKEN_RULE: f32 = 7.0;

/// A frame that lacks the last byte of its layout, although the checksum is right.
pub const CUT_SHORT: f32 = 40.0;

/// A response that nobody asked for: one in sixty at first.
pub const ORPHAN: f32 = 5.9;

/// The old answer behind the answer to a retry: behind one retry in ten at first.
pub const FIRST_LATES: f32 = 1.0 / 10.0;

/// A unit that did not answer a request and its retry may well be silent once more: one in four.
pub const STILL_SILENT: f32 = 2.0;

/// A request as soon behind another one as answers come is a second master's, or an answer that looks like one.
pub const TOO_SOON: f32 = 6.0;

/// The same answer again: one in a hundred.
pub const AGAIN: f32 = 6.6;

/// Responses among frames while no request waits, without and with bytes before them that are no frame: a damaged request
/// may be among those.
pub const FIRST_ORPHANS: [f32; 2] = [1.0 / 60.0, 1.0 / 20.0];
/// Requests among frames while another one waits, without and with such bytes.
pub const FIRST_UNANSWERED: [f32; 2] = [1.0 / 30.0, 1.0 / 12.0];

/// So many bytes between two frames may hold a damaged one.
pub const MAY_HOLD_A_FRAME: u64 = 4;

/// Unit and function of a response that nobody asked for stand among the bytes before it: its request was damaged.
pub const BEGUN: f32 = 4.0;

/// A frame whose checksum is wrong, where everything else fits: one in two hundred, and no checksum to vouch for it.
pub const DAMAGED: f32 = 9.0;

/// A frame of the other side on a line that one side has for itself.
pub const WRONG_LINE: f32 = 25.0;

/// A request while another one waits: one in thirty at first.
pub const UNANSWERED: f32 = 4.9;

/// A frame that holds whole frames of this line: one write of a file or loopback in a thousand.
pub const HOLDS_FRAMES: f32 = 10.0;

/// The answer to the request that waits.
pub const ANSWERED: f32 = 0.1;

/// Exceptions among answers.
pub const EXCEPTION: f32 = 4.0;

/// A request for everybody is seldom a read, and nobody answers as unit 0.
pub const BROADCAST_READ: f32 = 9.0;

/// A request seen before in this poll cycle is worth so much at most.
pub const REPEATED_AT_MOST: f32 = 12.0;

/// Frames follow each other without strays but for one in forty at first.
pub const FIRST_JUNK: f32 = 1.0 / 40.0;

/// The next stray byte of a short run; the way from it into a frame.
pub const STRAY: f32 = 1.2;
/// The way from it into a frame.
pub const AFTER_STRAYS: f32 = 0.8;
/// The way into it.
pub const BEFORE_STRAYS: f32 = 0.5;

/// The ways into and out of a long run of noise. Its bytes cost nothing: else a long accident would pay.
pub const INTO_NOISE: f32 = 1.8;
/// The way out.
pub const OUT_OF_NOISE: f32 = 5.0;

/// A pause that only ends of frames should have, at the start of a frame or inside one.
pub const PAUSE_BEFORE: f32 = 2.0;
/// The same inside a frame.
pub const PAUSE_INSIDE: f32 = 2.0;

/// Bytes of noise that weigh as much as the usual bits, after which the bits are worked out again, and half forgotten.
pub const NOISE_WEIGHT: f32 = 256.0;
/// Bytes after which the bits are worked out again.
pub const NOISE_STEP: f32 = 128.0;
/// Bytes after which half is forgotten.
pub const NOISE_FORGET: f32 = 8192.0;

/// Adapters that hear themselves: one in two hundred lines.
pub const FIRST_COPIES: f32 = 1.0 / 200.0;

/// The bits of a byte before any noise was seen.
pub fn usual_bits(byte: u8) -> f32 {
    match byte {
        0 => ZERO_BITS,
        0xFF => ONES_BITS,
        _ => OTHER_BITS,
    }
}

/// How common a function is before anything was learned.
pub fn function_prior(functions: &Functions, code: u8) -> f32 {
    match code {
        3 => 0.30,
        4 => 0.15,
        1 | 2 | 6 | 16 => 0.08,
        5 | 15 => 0.04,
        23 => 0.02,
        _ if functions.name(code).is_some() => 0.006,
        // User-defined codes (application protocol, 5).
        65..=72 | 100..=110 => 0.003,
        _ => 0.0005,
    }
}

pub fn unit_prior(unit: u8) -> f32 {
    match unit {
        0 => 0.01,
        // Masters are seldom set up for more than the first addresses, but they are.
        1..=30 => 0.7 / 30.0,
        31..=247 => 0.28 / 217.0,
        _ => 0.01 / 8.0,
    }
}
