//! A frame hypothesis: what the lattice consists of.

use crate::rtu_model::answerable::Answerable;
use crate::rtu_model::side::RESPONSE;

/// The root's index in the lattice.
pub const ROOT: usize = 0;

/// A frame hypothesis at the end of a path. Its parent is the frame before it on that path.
pub struct Hypothesis {
    /// Stream offset of its first byte.
    pub start: u64,
    /// Stream offset after its last byte.
    pub end: u64,
    /// Who sent it: `REQUEST` or `RESPONSE`.
    pub direction: usize,
    /// Score in bits of the path up to the end of this frame.
    pub path_score: f32,
    /// Score in bits of this frame.
    pub frame_score: f32,
    /// Index of the frame before it. Parents are before their children in the lattice.
    pub parent: usize,
    /// Index of the first frame after the root on the way to this one: what is committed if this path wins.
    pub first_on_path: usize,
    /// Stream offset at which the next damaged frame may end that begins right after this one.
    pub next_damaged_end_at: u64,
    /// It answers the request that is outstanding before it.
    pub answers_outstanding: bool,
    /// Its CRC is valid.
    pub is_crc_valid: bool,
    /// The requests that a frame after it may answer.
    pub answerable: Answerable,
}

impl Hypothesis {
    /// The root before the first byte.
    pub fn root() -> Self {
        Self {
            start: 0,
            end: 0,
            direction: RESPONSE,
            path_score: 0.0,
            frame_score: 0.0,
            parent: ROOT,
            first_on_path: ROOT,
            next_damaged_end_at: 0,
            answers_outstanding: false,
            is_crc_valid: true,
            answerable: Answerable::default(),
        }
    }
}
