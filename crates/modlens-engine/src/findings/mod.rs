//! Findings: what is odd about a frame, a transaction or a connection.
//!
//! A finding is declared with its title, reason and advice in `modlens_protocol::finding`. Here it is discovered, in one of
//! these files, and its detail (what was seen this time) is worded in `words`:
//!
//! | file | what is odd | when it is called |
//! |--|--|--|
//! | `frame` | the content of one frame, its reception, its damage | when the frame is emitted |
//! | `timing` | silences before and inside a frame, the clock | when the frame is emitted |
//! | `order` | a request or response in relation to those before it | when the frame is paired |
//! | `transaction` | a response compared with its request, or none at all | when the transaction is closed |
//! | `profile` | values and functions that contradict the unit's profile | when the transaction is closed |
//! | `connection` | what a capture lacks or repeats | when the packet is read |
//! | `line` | what all frames of a line have in common | at the end of the recording |
//! | `contradictions` | what no line can do with the given settings | counted per frame, emitted at the end of the recording |

pub(crate) mod connection;
pub(crate) mod contradictions;
pub(crate) mod frame;
pub(crate) mod line;
pub(crate) mod order;
pub(crate) mod profile;
pub(crate) mod timing;
pub(crate) mod transaction;
pub(crate) mod words;

use modlens_protocol::finding::Finding;

/// That of a frame with a right checksum which may be noise all the same.
pub(crate) const UNCONFIRMED: Finding = Finding::Unconfirmed;

/// That of an unambiguous exchange whose request was refused.
pub(crate) const REFUSED: Finding = Finding::Exception;

/// The finding on an incomplete frame; one that the recording cuts does not have it.
pub(crate) const INCOMPLETE: Finding = Finding::Incomplete;

/// Findings with their details.
pub type Found = Vec<(Finding, String)>;
