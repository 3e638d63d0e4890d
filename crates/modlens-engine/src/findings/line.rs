//! Findings on a line as a whole.

use super::{words, Found};
use modlens_protocol::finding::Finding;

/// One side alone was heard of a line: requests, or else responses; `heard` of `all` good frames.
pub(crate) fn one_side_only(is_request: bool, heard: u64, all: u64) -> Found {
    vec![(Finding::OneSideOnly, words::one_side_only(is_request, heard, all))]
}
