//! What Modbus is, without any recording: the table of functions, PDUs, checksums, line settings, and the words for what a
//! frame or a transaction turned out to be.

pub mod checksum;
pub mod decimal;
pub mod direction;
pub mod finding;
pub mod framing;
pub mod functions;
pub mod hex;
pub mod line;
pub mod mbap;
pub mod pdu;
pub mod recognize;
pub mod register_type;
pub mod source;
pub mod status;
pub mod timestamp;

/// Nanoseconds: since 1970 or since any beginning, as the bus's clock says.
pub type Ns = i64;
