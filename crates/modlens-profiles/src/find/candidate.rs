//! A reading that may be the value.

use crate::find::series::Reading;

/// A reading that fits.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Where it is and how it is read.
    pub reading: Reading,
    /// The factor.
    pub scale: f64,
    /// What is added after scaling.
    pub offset: f64,
    /// The probability that this is the value.
    pub chance: f64,
    /// Log2 odds against all other candidates and against none of them.
    pub odds_bits: f64,
    /// The share of the explained variance and the lag in nanoseconds, if there is a history.
    pub fit: Option<(f64, i64)>,
    /// The log2 weight, not normalised.
    pub(super) bits: f64,
}
