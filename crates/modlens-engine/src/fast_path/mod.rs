//! The fast path.

pub mod expected_exchange;
pub(crate) mod frame_check;
pub(crate) mod rtu_exchange;
pub(crate) mod rtu_frame;
