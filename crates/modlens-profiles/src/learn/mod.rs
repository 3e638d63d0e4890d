//! Infers the type and the order of registers from the values that they had over time.

mod evidence;
mod float_hypothesis;
mod integer_hypothesis;
mod movement;
mod ranking;
pub mod text;

pub use evidence::{TypeHypothesis, MIN_MARGIN_BITS};
pub use ranking::{is_plausible_float, rank_types};
