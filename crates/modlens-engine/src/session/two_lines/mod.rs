//! The order of frames on the two lines of a bus.

pub(super) mod alignment;
mod turn;
pub(super) mod unmerged;
