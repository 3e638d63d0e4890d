//! Learns what registers are from the values that they had over time: which belong together, with type and order; what
//! each is for; its scale and quantity.

mod anchor;
mod calibration;
mod calibration_table;
mod conclude;
mod equations;
mod evidence;
mod float_hypothesis;
mod grid;
mod habits;
mod integer_hypothesis;
mod layout;
mod layout_point;
mod movement;
mod observed;
mod ranking;
mod relations;
mod role;
mod scale;
mod sequence;
mod singles;
pub mod text;

pub use anchor::Anchor;
pub use conclude::{conclude, Learned};
pub use equations::{movements, Equation, Movements, Span};
pub use evidence::{TypeHypothesis, MIN_MARGIN_BITS};
pub use grid::likely_pairs;
pub use habits::Habits;
pub use layout_point::LayoutPoint;
pub use observed::{Counts, ObservedBlock, ObservedTable, Samples, MOST_ROWS};
pub use ranking::{is_plausible_float, rank_types};
pub use role::Role;
pub use scale::Scale;
pub use sequence::Sequence;
