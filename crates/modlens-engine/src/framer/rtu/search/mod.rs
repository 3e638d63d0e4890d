//! The search for the best path through the bytes: frames and the unframed bytes between them, scored in bits.
//!
//! Hypotheses stand at ends of frames only. Unframed bytes between two frames cost the same whatever they are taken for, so
//! nothing has to be kept for single bytes: the lattice has a node per frame hypothesis, not per byte. A frame is committed
//! once no rival hypothesis within the commit margin is left without it (`commit`).

mod commit;
mod extend;
mod hypothesis;
mod lattice;
mod nested;
mod placement;
mod rejected;
#[cfg(test)]
mod remembered;
mod run_odds;
mod scan;
mod state;

pub use commit::{is_held_back, Decision};
pub use run_odds::SURE_SILENCE_SHARE;
pub use state::Search;
