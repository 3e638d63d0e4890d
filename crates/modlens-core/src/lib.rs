//! Modbus without I/O and without Python: bytes and times in, frames, transactions and findings out.
//!
//! In the order of the way through: `chunk` (what comes in; `marks`: line errors in a driver's words; `pace`: how often a
//! live line is read), `input` (bytes not framed yet), `framer` (where frames begin and end), `functions` and `pdu` (what
//! bytes mean), `direction` and `pairing` (who asked and who answered), `check` and `finding` (what is wrong), `session`
//! (all of it behind one `feed`), `records` and `columns` (rows and how they are read), `write` (text and Arrow), `view`
//! (lines for people), `predicate` (filters), `stats`, `text` (recordings in text, `hex` their digits).

pub mod check;
pub mod checksum;
pub mod chunk;
pub mod columns;
pub mod direction;
pub mod finding;
pub mod framer;
pub mod functions;
pub mod hex;
pub mod input;
pub mod latest;
pub mod learn;
pub mod line;
pub mod logic;
pub mod marks;
pub mod pace;
pub mod pairing;
pub mod pcap;
pub mod pdu;
pub mod points;
pub mod predicate;
pub mod profile;
pub mod records;
pub mod session;
pub mod stats;
pub mod text;
pub mod view;
pub mod write;

/// Nanoseconds: since 1970 or since any beginning, as the bus's clock says.
pub type Ns = i64;
