//! The bus simulator: scenarios of faults, taps that change the times of the bytes, and the truth about every frame.
//!
//! Traffic and damage depend only on scenario and seed, so the same bytes are delivered in every tap mode.

pub mod bulk;
pub mod case;
pub mod damage;
pub mod noise;
pub mod output;
pub mod repeated;
pub mod scenario;
pub mod tap;
pub mod truth;

mod bus;
mod generate;
mod look_alike;
mod look_alikes;
mod master;
mod noise_signals;
mod reads;
mod registers;
pub(crate) mod requests;
mod responses;
mod slave;
mod uart;
mod undecided;
mod wire;
