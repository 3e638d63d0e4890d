//! The bench: a bus simulator, a scorer, and the rivals that modlens is measured against. Not shipped.
//!
//! `sim` makes recordings of buses with every known trouble, and the truth about them; an `Algorithm` finds frames in
//! them; `score` compares the two. `accuracy` runs all of it and prints tables. Nothing here knows how modlens works,
//! except `adapter`.
//!



pub mod checksum;
pub mod model;
pub mod reported;
pub mod rng;
pub mod sim;
