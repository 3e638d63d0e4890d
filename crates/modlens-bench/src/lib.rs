//! The bench: a bus simulator, a scorer, and the rivals that modlens is measured against. Not shipped.
//!
//! `sim` makes recordings of buses with every known trouble, and the truth about them; an `Algorithm` finds frames in
//! them; `score` compares the two. `accuracy` runs all of it and prints tables. Nothing here knows how modlens works,
//! except `adapter`.
//!
//! ```
//! use modlens_bench::{baselines::Length, reported::Algorithm, score::score, sim::{case::Traffic, scenario::Scenario, tap::TapMode}};
//! let scenario = Scenario::named("noise").unwrap();
//! let case = Traffic::new(scenario, 1, 300).tap(TapMode::Ftdi16);
//! let frames = Length.run(&case);
//! assert!(score(&case, &frames).fd().f1() > 0.9);
//! ```

pub mod accuracy;
pub mod adapter;
pub mod baselines;
pub mod checksum;
pub mod differences;
pub mod model;
pub mod options;
pub mod reported;
pub mod rng;
pub mod score;
pub mod sim;
pub mod speed;
pub mod tables;
