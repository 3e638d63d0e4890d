//! The time between two frames.

use modlens_protocol::Ns;

/// From the end of one frame to the start of another, where both are known.
pub(crate) fn interval(end: Option<Ns>, start: Option<Ns>) -> Option<Ns> {
    Some(start? - end?)
}
