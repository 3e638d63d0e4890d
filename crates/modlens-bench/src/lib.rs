//! The bench: a bus simulator, a scorer, and the rival methods that modlens is compared with. It is not shipped.
//!
//! `sim` makes recordings of buses with every known fault, together with the truth about them. An `Algorithm` finds frames
//! in a recording, and `score` compares them with the truth. `accuracy` runs all combinations and prints tables. Only
//! `adapter` and `speed` use the core of modlens.
//!
//! ```
//! use modlens_bench::{baselines::Length, reported::Algorithm, score::score, sim::{case::Traffic, scenario::Scenario, tap::TapMode}};
//! let scenario = Scenario::named("noise").unwrap();
//! let case = Traffic::new(scenario, 1, 300).tap(TapMode::Ftdi16);
//! let frames = Length.run(&case);
//! assert!(score(&case, &frames).frames_with_direction().f1() > 0.9);
//! ```

pub mod accuracy;
pub mod adapter;
pub mod baselines;
pub mod beyond;
pub mod checksum;
pub mod differences;
pub mod family;
pub mod model;
pub mod options;
pub mod reported;
pub mod rng;
pub mod score;
pub mod sim;
pub mod speed;
pub mod tables;
