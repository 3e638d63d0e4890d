//! What an RTU line has shown, and what bytes are worth by it: known to the framer, which looks for valid frames, and to `damage`,
//! which looks for the others.

pub(crate) mod announced_length;
pub(crate) mod answerable;
pub(crate) mod crc_scan;
pub(crate) mod damage_kind;
pub(crate) mod frame_bytes;
pub(crate) mod learned_lengths;
pub(crate) mod log2;
pub(crate) mod poll_cycle;
pub(crate) mod prefilter;
pub(crate) mod prefix_index;
pub(crate) mod score;
pub(crate) mod score_bounds;
pub(crate) mod side;
pub(crate) mod traffic_model;
