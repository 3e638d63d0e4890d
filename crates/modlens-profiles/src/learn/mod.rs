//! What values alone suggest about the type and the order of a register.

mod floats;
mod judge;
mod movement;
pub mod text;
mod whole;

pub use judge::{judge, sensible_float, Claim, AHEAD};
