//! Two masters with the same list: each of its requests comes in two cycles, one after the other, whose phases drift.

use modlens_engine::durations::Durations;

use crate::claim::View;
use crate::contrast::RequestCounts;
use crate::statistics::{fisher, Share};

/// Fewer of these times say nothing of a cycle.
const LEAST: u64 = 20;

/// Two lists meet that begin within one of these parts of a cycle, in sixteenths: they may be short or long.
const NEAR: [i64; 4] = [1, 2, 4, 6];

/// Times from a request to the same one, in two cycles.
pub(super) struct Interleaved {
    /// For each of the parts, how many times beside failures, and how many others, are as near as that to the meeting of two.
    near: [(Share, Share); NEAR.len()],
}

impl Interleaved {
    /// The chance that failures are so near the meetings by chance.
    pub fn chance(&self) -> f64 {
        let chances = self.near.iter().map(|(beside, others)| {
            // The time before a failure and the one after it make one cycle: the two say the same.
            fisher(Share { failed: beside.failed / 2, total: beside.total / 2 }, *others)
        });
        (chances.fold(1.0, f64::min) * NEAR.len() as f64).min(1.0)
    }

    /// Whether many failures are where two requests are far apart as often as elsewhere: they have another reason.
    pub fn is_refuted(&self) -> bool {
        let is_even = |(beside, others): &(Share, Share)| beside.rate() < f64::midpoint(1.0, others.rate());
        self.near.iter().all(|(beside, _)| beside.total >= LEAST) && self.near.iter().all(is_even) && self.chance() > 0.05
    }
}

/// The times of the requests that come in two cycles; `None` where most do not.
pub(super) fn interleaved(view: &View<'_>) -> Option<Interleaved> {
    let requests = &view.requests;
    let reads = requests.iter().filter(|(_, counts)| !counts.writes && counts.cycles.two.count >= LEAST);
    let reads: Vec<(Option<i64>, &RequestCounts)> = reads.map(|(_, counts)| (drifting(counts), *counts)).collect();
    let mut all = Interleaved { near: Default::default() };
    if reads.iter().filter(|(cycle, _)| cycle.is_some()).count() * 2 <= reads.len() {
        return None;
    }
    for (cycle, counts) in reads {
        let Some(cycle) = cycle else { continue };
        for ((beside, others), part) in all.near.iter_mut().zip(NEAR) {
            let near = |times: &Durations| {
                let [short, far, total] = [cycle / 16 * part, cycle - cycle / 16 * part, cycle].map(|limit| times.below(limit));
                Share { failed: short + total.saturating_sub(far), total }
            };
            *beside = beside.with(near(&counts.cycles.beside_failures));
            *others = others.with(near(&counts.period));
        }
    }
    Some(all)
}

/// The cycle of a request that is sent in two of them: from one to the one after the next it takes always as long, from one to
/// the next any part of that.
fn drifting(counts: &RequestCounts) -> Option<i64> {
    let cycle = counts.cycles.two.percentile(0.5)?;
    let spread = |times: &Durations, from, to| Some(times.percentile(to)? - times.percentile(from)?);
    let is_steady = spread(&counts.cycles.two, 0.2, 0.8)? * 10 < cycle;
    // A list that holds the request twice has two times: nothing lies between them, and neither varies.
    let drifts = spread(&counts.period, 0.1, 0.4)? * 20 > cycle && spread(&counts.period, 0.2, 0.8)? * 5 > cycle;
    // The time to the next one and that from there on make a cycle.
    let is_even =
        |share| Some((counts.period.percentile(share)? + counts.period.percentile(1.0 - share)? - cycle).abs() * 8 < cycle);
    (is_steady && drifts && is_even(0.35)? && is_even(0.2)?).then_some(cycle)
}
