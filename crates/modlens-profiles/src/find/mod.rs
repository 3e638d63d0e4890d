//! Finds the register that holds a value: every reading of every register is held against what is known of the value, which
//! is what a display showed at some time, how it moved, or its history from another source.
//!
//! Each condition gives a probability that a right reading meets it. With a prior for the reading (its type, the layout
//! that `learn` finds, a scale that devices use) the posterior odds follow, against all other candidates together and
//! against the case that the value was never on the line.

mod apart;
mod candidate;
mod candidates;
mod history;
mod moves;
mod query;
mod series;
mod shown;

pub use apart::{best_time_to_look, Look};
pub use candidate::Candidate;
pub use candidates::{find, Found, LayoutHint};
pub use query::{Change, History, Move, Query, Shown};
pub use series::{BlockSeries, Column, Reading, Variant};

#[cfg(test)]
mod tests;
