//! Who does what on a bus, and whether it is usual: rows of the engine in, alerts and differences out; no I/O, no clock.
//!
//! ```text
//! Batch -> Rules (conditions with a count and a window)  -> alerts
//!       -> Usage (who asks for what, how often, with which values and response times)
//!                -> JSON: a baseline
//!                -> compare with a baseline -> differences
//! ```
//!
//! A rule is a row of `analyzer/security.toml`. Its condition is a filter over transactions, compiled by
//! `analyzer/filters.py`, so users write rules in the words of `--where`.
//!
//! A baseline and a second recording are the same thing: the usage of one of them as JSON. `compare` therefore serves both
//! "differs from what is usual" and "differs from yesterday".
//!
//! **Memory is bounded**: at most [`MAX_BUSES`] buses, [`usage::MAX_REQUESTS`] distinct requests on each, and
//! [`rules::MAX_SUBJECTS`] open subjects for each rule. What does not fit is counted.

pub mod chance;
pub mod compare;
pub mod distribution;
pub mod join;
pub mod live;
pub mod rules;
pub mod usage;
pub mod usual;

/// Buses that are kept apart.
pub const MAX_BUSES: usize = 256;
