//! Frames and transactions as pairing, the checks and the statistics pass them on, and what pairing reports about a frame.

pub(crate) mod result;
pub(crate) mod transaction;
