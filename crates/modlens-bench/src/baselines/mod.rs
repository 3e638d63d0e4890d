//! The rivals: the methods by which other tools find frames, each at its best.
//!
//! - [`Gap`] cuts at silences, with the best of seven thresholds, which an oracle chooses for every case.
//! - [`Length`] predicts the length from the header, as request and as response, and accepts a frame with a valid CRC.
//! - [`Scan`] accepts the first length that gives a valid CRC.
//! - [`Colon`] cuts ASCII frames from a colon to CR LF.

mod colon;
mod gap;
mod greedy;
mod layout;
mod lines;
mod pairing;

pub use colon::Colon;
pub use gap::Gap;
pub use greedy::{Length, Scan};

use crate::reported::Algorithm;

/// All rivals, in the order of the tables.
pub fn all() -> Vec<Box<dyn Algorithm>> {
    vec![Box::new(Gap), Box::new(Length), Box::new(Scan), Box::new(Colon)]
}
