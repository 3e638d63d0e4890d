//! What values alone suggest about the type and the order of a register.

mod floats;
mod judge;
mod movement;
pub mod text;
mod whole;

pub use judge::{rank_types, sensible_float, TypeHypothesis, AHEAD};
