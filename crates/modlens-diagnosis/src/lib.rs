//! The doctor: what is wrong on a line, and why. Rows of the engine in, diagnoses out; no I/O, no clock.
//!
//! ```text
//! Batch -> Observation -> Contrast (counters: what failed against what did not) -> kinds -> Claim -> Report
//! ```
//!
//! A list of damaged frames does not tell a cause. Nearly all troubles are conditional: only this unit, only after that one,
//! only the first byte, only when the pause was short. So the contrast counts failed and good transactions side by side, by
//! everything that might make the difference, and each kind of trouble (`kinds`) is a function of these counters.
//! `dissectors/diagnoses.toml` says in words what a kind needs and how it is said.
//!
//! **Memory is bounded.** A bus has counters for at most 248 units (TCP: 256), each with histograms of fixed size; for the
//! 1,024 requests with 48 of their answers each, 256 clients, 256 runs of noise with the least hashes of those seen; and 4
//! examples for each claim. All buses together have at most 4,096 units and 16,384 requests; a scan of a network does not fill
//! the memory.
//! A choice by hash depends on neither order nor chance.
//!
//! **Counters merge.** Parts of a recording, observed apart and merged in order, give what one pass gives. What needs the
//! rows before (the transaction before, the time since a write) looks back over [`contrast::WINDOW`] rows at most: each part
//! keeps its first rows and counts them when it is known what came before.
//!
//! **What went well is counted in bulk.** Nearly all exchanges of most recordings are plain, good and without a finding
//! (`clean`); of such a one hardly more is noted than that it was, by its request, and that stays pending until somebody asks.
//! Where its values, or what came before it, may matter, and after every failure, it is counted by itself, with what is pending
//! of its unit and its request counted first, and the order is as if each had been counted so (`contrast/one_by_one.rs`
//! compares). Where nobody wants rows, the engine emits compact exchanges (`Batch::exchanges`).
//!
//! **Silence where there is not enough.** A claim comes with the chance that its contrast is an accident, corrected for the
//! number of contrasts that were looked at (`statistics`); above [`MAX_CHANCE`] nothing is said.

mod attribution;
pub mod bus_day;
pub mod claim;
mod clean;
pub mod contrast;
pub mod days;
pub mod events;
pub mod kinds;
pub mod observation;
mod odd;
mod place;
mod protocols;
pub mod report;
pub mod sight;
pub mod statistics;
pub mod table;

/// A contrast that accident would bring forth more often than this is not told.
pub const MAX_CHANCE: f64 = 1e-3;
