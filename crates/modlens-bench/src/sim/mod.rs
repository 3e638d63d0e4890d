//! The bus simulator: scenarios of what goes wrong, taps that blur the times, and the truth about both.
//!
//! Traffic and damage depend on scenario and seed only; the same bytes are delivered under every tap mode.

pub mod bulk;
pub mod case;
pub mod damage;
pub mod noise;
pub mod output;
pub mod scenario;
pub mod tap;
pub mod truth;

mod bus;
mod master;
mod reads;
mod registers;
mod requests;
mod responses;
mod slave;
mod uart;
mod wire;
