//! Bytes and times in, rows out: framing, pairing, findings, statistics. No I/O, no clock, no failure on bytes.

pub mod damage;
pub mod fast_path;
pub mod findings;
pub mod framer;
pub mod input;
pub mod pairing;
pub mod records;
pub mod session;
pub mod stats;
pub mod weights;
