//! Blocks of addresses: what others cover of one.
#![allow(clippy::trivially_copy_pass_by_ref)] // Keys stay in their map.

use crate::observation::RequestKey;

/// The first address after a block.
pub(super) fn end(key: &RequestKey) -> u32 {
    u32::from(key.address) + u32::from(key.quantity)
}

/// How many addresses of a block others cover.
pub(super) fn covered(key: &RequestKey, others: &[&RequestKey]) -> u32 {
    u32::from(key.quantity) - uncovered(key, others).iter().map(|(from, to)| to - from).sum::<u32>()
}

/// The addresses of a block that no other covers, in ranges; the end of each is the first address after it.
pub(super) fn uncovered(key: &RequestKey, others: &[&RequestKey]) -> Vec<(u32, u32)> {
    let (first, last) = (u32::from(key.address), end(key));
    let mut ranges: Vec<(u32, u32)> =
        others.iter().map(|other| (u32::from(other.address).max(first), end(other).min(last))).collect();
    ranges.sort_unstable();
    let (mut left, mut at) = (Vec::new(), first);
    for (from, to) in ranges.into_iter().filter(|(from, to)| from < to).chain([(last, last)]) {
        if from > at {
            left.push((at, from));
        }
        at = at.max(to);
    }
    left
}

/// A range of addresses in words; its end is the first address after it.
pub(super) fn range_in_words((from, to): (u32, u32)) -> String {
    match to - from {
        1 => from.to_string(),
        2 => format!("{from} and {}", to - 1),
        _ => format!("{from} to {}", to - 1),
    }
}
