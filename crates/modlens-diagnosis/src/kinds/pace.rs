//! Trouble with pace: too soon, in pieces, too much.

use crate::claim::{duration, Claim, View};
use crate::contrast::UnitCounts;
use crate::statistics::{fisher, Share};

/// A unit that fails after short silences and answers after longer ones.
pub(super) fn polled_too_fast(view: &View<'_>) -> Vec<Claim> {
    view.units().filter_map(|(unit, counts)| too_fast(view, unit, counts)).collect()
}

fn too_fast(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let splits = counts.by_gap.splits();
    let count = splits.len() as f64;
    let likeliest = splits.into_iter().map(|(limit, below, above)| (fisher(below, above) * count, limit, below, above));
    let (chance, limit, below, above) = likeliest.min_by(|one, other| one.0.total_cmp(&other.0))?;
    let chance = view.significant(chance)?;
    if below.rate() < 3.0 * above.rate() || explained_by_previous(counts, below, above) {
        return None;
    }
    let words = |share: Share| format!("{} of {} requests", share.failed, share.total);
    Some(
        Claim::new("polled_too_fast", &counts.failures, chance)
            .of_unit(unit)
            .with_share(below)
            .fact("limit", duration(limit))
            .fact("short", words(below))
            .fact("long", words(above)),
    )
}

/// Whether the unit asked before tells failures from successes better than the silence does.
fn explained_by_previous(counts: &UnitCounts, below: Share, above: Share) -> bool {
    let all = counts.failures.share();
    let best = counts.by_previous.values().map(|inside| fisher(*inside, all.without(*inside))).fold(1.0, f64::min);
    best < fisher(below, above)
}

/// Pauses inside of requests that make them fail.
pub(super) fn gaps_in_frames(view: &View<'_>) -> Vec<Claim> {
    let claims = view.units().filter_map(|(unit, counts)| {
        let [without, with] = counts.by_pause;
        let chance = view.significant(fisher(with, without))?;
        let words = |share: Share| format!("{} of {}", share.failed, share.total);
        (with.rate() > 2.0 * without.rate()).then(|| {
            Claim::new("gaps_in_frames", &counts.failures, chance)
                .of_unit(unit)
                .with_share(with)
                .fact("with", words(with))
                .fact("without", words(without))
        })
    });
    claims.collect()
}

/// From this share of the time on, a line is full.
const FULL: f64 = 0.7;

/// Frames and response times that fill the time.
pub(super) fn bus_saturated(view: &View<'_>) -> Vec<Claim> {
    let frames = &view.bus.frames;
    let (Some(char_ns), Some((first, last)), false) = (view.bus.facts.char_ns, frames.span, view.bus.facts.is_network) else {
        return Vec::new();
    };
    let busy = frames.bytes.iter().sum::<u64>() as f64 * char_ns as f64;
    let span = (last - first) as f64;
    if view.bus.requests_seen.total < 30 || busy < FULL * span {
        return Vec::new();
    }
    let share = Share { failed: (busy.min(span) / 1e6) as u64, total: (span / 1e6) as u64 };
    let heaviest =
        view.bus.requests.sorted().into_iter().max_by_key(|(key, counts)| (counts.sent() * u64::from(key.quantity), **key));
    let most = heaviest.map_or(String::new(), |(key, counts)| {
        format!("; most of it is unit {}, {} registers from {} on, {} times", key.unit, key.quantity, key.address, counts.sent())
    });
    let mut claim = Claim::new("bus_saturated", &view.bus.requests_seen, 0.0).with_share(share).fact("most", most);
    (claim.has_begun, claim.has_ended, claim.examples) = (false, false, Vec::new());
    vec![claim]
}
