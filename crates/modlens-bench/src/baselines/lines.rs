//! Runs an algorithm over the lines of a case.

use crate::baselines::pairing::{pair_lines, RivalPairing};
use crate::model::Framing;
use crate::reported::ReportedFrame;
use crate::sim::case::Case;
use crate::sim::tap::TapRead;

/// Whether the case is RTU traffic.
pub(super) fn is_rtu(case: &Case) -> bool {
    case.framing == Framing::Rtu
}

/// Runs a finder over every line of a case and pairs what it finds.
///
/// `find` gets the bytes of a line and a slot for pairing; on two lines pairing comes afterwards, in order of time.
pub(super) fn by_line(case: &Case, find: impl Fn(&[u8], u8, &mut RivalPairing) -> Vec<ReportedFrame>) -> Vec<ReportedFrame> {
    if let [line] = &case.lines[..] {
        return find(&line.bytes, line.id, &mut RivalPairing::default());
    }
    let mut frames = Vec::new();
    for line in &case.lines {
        let mut order = order_of(&line.reads);
        let found = find(&line.bytes, line.id, &mut RivalPairing::default());
        frames.extend(found.into_iter().map(|mut frame| {
            frame.txn = None;
            (order(frame.end - 1), frame)
        }));
    }
    pair_lines(frames, |frame| case.bytes(frame.line)[frame.start as usize..frame.end as usize].to_vec())
}

/// A function that returns when the byte at an offset was read; the offsets of successive calls must not decrease.
fn order_of(reads: &[TapRead]) -> impl FnMut(u64) -> i64 + '_ {
    let (mut at, mut end) = (0, 0u64);
    move |offset| {
        while at < reads.len() && end + u64::from(reads[at].length) <= offset {
            end += u64::from(reads[at].length);
            at += 1;
        }
        reads.get(at).map_or(i64::MAX, |read| read.order)
    }
}
