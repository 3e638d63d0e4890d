//! What came before a transaction.

use modlens_protocol::Ns;

use super::followed::Followed;
use super::tally::Place;
use crate::observation::RequestKey;

/// What came before a transaction on its bus.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Before {
    /// An answer may still come to a request whose master has given up.
    pub may_meet_late: bool,
    /// Unit of the transaction before, and whether that was not answered.
    pub previous: Option<(u8, bool)>,
    /// Whether one of the last few failed in any way.
    pub failed: bool,
    /// Whether a write was among the four transactions before.
    pub written: bool,
    /// The answer to the request before came after this request: its unit, its place, how long the master waited before it
    /// went on, and how long it would have had to.
    pub overtaken: Option<(u8, Place, Ns, Ns)>,
    /// The answer to the request before: what was asked, in which transaction, and how long after it this request came.
    pub followed: Option<(RequestKey, u64, Followed)>,
    /// Hash of the request before, if it is another one and came right before, and whether it failed.
    pub request: Option<(u64, bool)>,
    /// The request before is the same, came right before, and went well.
    pub is_repeated: bool,
    /// The request before.
    pub asked: Option<RequestKey>,
    /// The recording shows no answer to the request before.
    pub is_open: bool,
    /// From the start of the request before, to which no answer was seen, to that of this one.
    pub hasty: Option<Ns>,
    /// The answer to it stops before its end, and lacks so many bytes.
    pub cut: Option<(RequestKey, u32)>,
    /// Its transaction identifier.
    pub id: Option<u16>,
}
