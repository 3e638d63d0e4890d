//! What Modbus is, independent of any recording: the table of functions, PDUs, checksums and line settings, and the
//! vocabulary for what a frame or a transaction turned out to be.
//!
//! - `functions` parses the table of functions (`dissectors/functions.toml`): the field layout of each request and
//!   response, its limits, and the fields that a response repeats. `pdu` decodes and encodes PDUs by these layouts.
//! - `annotate` puts the bytes of a frame beside their meaning, for people.
//! - `direction` infers from a PDU, the layouts and the outstanding request who sent it. `recognize` reports RTU, ASCII and
//!   TCP apart by checksums and headers, without framing.
//! - `checksum` has CRC-16 and LRC, `mbap` the header of Modbus/TCP, `line` the settings of a serial line with the times
//!   that follow from them.
//! - `oddity` names what is odd about bytes that are no frame.
//! - `framing`, `status`, `finding`, `register_type` and `source` are the enumerations that rows consist of.
//! - `decimal`, `hex` and `timestamp` append values as text; all readers and writers share them. `amount` reads durations and
//!   sizes as people write them, `visible` makes text safe to be shown. `mix` hashes numbers, to choose some of them.

pub mod amount;
pub mod annotate;
pub mod checksum;
pub mod decimal;
pub mod direction;
pub mod finding;
pub mod framing;
pub mod functions;
pub mod hex;
pub mod in_words;
pub mod line;
pub mod mbap;
pub mod mix;
pub mod oddity;
pub mod pdu;
pub mod recognize;
pub mod register_type;
pub mod renamed;
pub mod source;
pub mod status;
pub mod timestamp;
pub mod visible;

/// A time or a duration in nanoseconds. Times count from 1970 or from any other moment, depending on the clock of the
/// bus (`source::Clock`).
pub type Ns = i64;
