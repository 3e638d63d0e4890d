//! Trouble with pace: too soon, in blocks, too much.

use super::foreign::foreign_protocol;
use crate::claim::{duration, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::RequestCounts;
use crate::contrast::{Pauses, UnitCounts};
use crate::observation::RequestKey;
use crate::statistics::{fisher, Share};
use modlens_protocol::finding::Severity;

/// A unit that fails after short silences and answers after longer ones.
pub(super) fn polled_too_fast(view: &View<'_>) -> Vec<Claim> {
    view.units().filter_map(|(unit, counts)| too_fast(view, unit, counts)).collect()
}

fn too_fast(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    // What a write switches spoils the answer after it, however soon that was asked for (line_noise).
    if counts.garbled.failed * 2 > counts.failures.failed && !super::switched::noise_of_writes_once(view).is_empty() {
        return None;
    }
    // The silence is short because something else speaks, whose frames meet those of the unit (foreign_protocol).
    if counts.silent.failed * 2 < counts.failures.failed && !view.once("foreign_protocol", foreign_protocol).is_empty() {
        return None;
    }
    if super::answers::fails_after_late_answers(view, unit, counts) {
        return None;
    }
    let always = Split::likeliest(counts.by_gap.splits()).filter(|split| !explained_by_previous(unit, counts, split, true));
    let after_others = Split::likeliest(counts.by_gap_after_others.splits());
    let after_others = after_others.filter(|split| !explained_by_previous(unit, counts, split, false));
    let (split, previous) = match (always, after_others) {
        (Some(always), Some(other)) if other.chance < always.chance => (other, " and a request to another unit"),
        (None, Some(other)) => (other, " and a request to another unit"),
        (always, _) => (always?, ""),
    };
    let chance = view.significant(split.chance)?;
    let words = |share: Share| format!("{} of {} requests", share.failed, share.total);
    (split.below.rate() >= 3.0 * split.above.rate()).then(|| {
        Claim::new("polled_too_fast", &counts.failures, chance)
            .of_unit(unit)
            .with_share(split.below)
            .fact("limit", duration(split.limit))
            .fact("previous", previous)
            .fact("short", words(split.below))
            .fact("long", words(split.above))
    })
}

/// Failures below and above a limit of the silence before the request.
struct Split {
    limit: i64,
    below: Share,
    above: Share,
    chance: f64,
}

impl Split {
    /// The limit that distinguishes failures from successes best; its chance is corrected for the number of limits.
    fn likeliest(splits: Vec<(i64, Share, Share)>) -> Option<Self> {
        let count = splits.len() as f64;
        let all =
            splits.into_iter().map(|(limit, below, above)| Self { limit, below, above, chance: fisher(below, above) * count });
        all.min_by(|one, other| one.chance.total_cmp(&other.chance))
    }
}

/// Whether the unit asked before distinguishes failures from successes better than the silence does.
fn explained_by_previous(unit: u8, counts: &UnitCounts, split: &Split, with_own: bool) -> bool {
    let previous = || counts.by_previous.iter().filter(|((other, _), _)| with_own || *other != unit).map(|(_, share)| *share);
    let all: Share = previous().sum();
    previous().map(|inside| fisher(inside, all.without(inside))).fold(1.0, f64::min) < split.chance
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
                .fact("what", format!("requests fail with a pause inside {}, without one {}", words(with), words(without)))
        })
    });
    let failing: Vec<Claim> = claims.collect();
    if failing.is_empty() {
        return in_pieces(view);
    }
    failing
}

/// A sender whose frames come in blocks while those of others do not, though nobody fails for it. What the adapter of the tap
/// holds back, it holds back of all frames alike, so the others tell what is its part.
fn in_pieces(view: &View<'_>) -> Vec<Claim> {
    let side = |side: usize| view.bus.units.iter().map(move |(unit, counts)| (*unit, &counts.pauses[side]));
    let from_master: Vec<&Pauses> = side(0).map(|(_, pauses)| pauses).collect();
    let from_units: Vec<(u8, &Pauses)> = side(1).collect();
    let answers: Vec<&Pauses> = from_units.iter().map(|(_, pauses)| *pauses).collect();
    if let Some(claim) = pieces(view, &from_master, &answers, "the master") {
        return vec![claim];
    }
    let of_units = from_units.iter().filter_map(|(unit, own)| {
        let others = from_units.iter().filter(|(other, _)| other != unit).map(|(_, pauses)| *pauses);
        let others: Vec<&Pauses> = others.chain(from_master.iter().copied()).collect();
        pieces(view, &[own], &others, &format!("unit {unit}")).map(|claim| claim.of_unit(*unit))
    });
    of_units.collect()
}

/// Silences inside frames are at most t1.5 (serial line, 2.5.1.1): 0.75 ms from 19200 baud on; shorter ones are the clock's.
const LEAST_OCTAVE: u32 = 20;

/// The timer of a recorder makes pauses of any length up to its step in the frames of all senders. Those of a sender are longer by
/// so many factors of two than those that are usual elsewhere.
const LONGER_THAN_A_TIMER: u32 = 2;

/// Pauses in this share of the frames with pauses are usual.
const USUAL: f64 = 0.05;

/// The pauses of one sender against those of all others, at the length that distinguishes them best.
fn pieces(view: &View<'_>, senders: &[&Pauses], others: &[&Pauses], sender: &str) -> Option<Claim> {
    let octaves: std::collections::BTreeSet<u32> = senders.iter().flat_map(|pauses| pauses.octaves()).collect();
    let of_others: std::collections::BTreeSet<u32> = others.iter().flat_map(|pauses| pauses.octaves()).collect();
    let is_usual = |octave: &u32| {
        let (longer, all) =
            others.iter().fold((0, 0), |(longer, all), pauses| (longer + pauses.from(*octave).failed, all + pauses.frames));
        longer as f64 > USUAL * all as f64
    };
    let timer = of_others.into_iter().filter(|octave| *octave >= LEAST_OCTAVE).filter(is_usual).max();
    let least = timer.map_or(LEAST_OCTAVE, |octave| octave + LONGER_THAN_A_TIMER);
    let octaves: Vec<u32> = octaves.into_iter().filter(|octave| *octave >= least).collect();
    let sum = |all: &[&Pauses], octave: u32| -> Tally {
        let longer: Vec<Tally> = all.iter().map(|pauses| pauses.from(octave)).collect();
        longer.iter().sum()
    };
    let contrasts = octaves.iter().map(|octave| {
        let (own, others) = (sum(senders, *octave), sum(others, *octave));
        (fisher(own.share(), others.share()) * octaves.len() as f64, *octave, own, others.share())
    });
    let (chance, octave, own, others) = contrasts.min_by(|one, other| one.0.total_cmp(&other.0))?;
    let chance = view.significant(chance)?;
    let frames: u64 = senders.iter().map(|pauses| pauses.frames).sum();
    if own.failed * 100 < frames || own.share().rate() < 3.0 * others.rate() || others.total == 0 {
        return None;
    }
    let words = |share: Share| format!("{} of {}", share.failed, share.total);
    let what = format!(
        "pauses of more than {} in frames of {sender}: {}, of others {}",
        duration(1i64 << octave),
        words(own.share()),
        words(others)
    );
    Some(Claim::new("gaps_in_frames", &own, chance).at_most(Severity::Info).fact("what", what))
}

/// From this share of the time on, a line is full.
const FULL: f64 = 0.7;

/// Frames and response times that fill the time.
pub(super) fn bus_saturated(view: &View<'_>) -> Vec<Claim> {
    let Some((busy, span)) = super::rates::needed_and_had(view) else { return Vec::new() };
    // A line that carries more than it can has other settings: wrong_line_settings.
    if view.bus.requests_seen.total < 30 || busy < FULL * span || super::rates::other_rate(view).is_some() {
        return Vec::new();
    }
    let share = Share { failed: (busy.min(span) / 1e6) as u64, total: (span / 1e6) as u64 };
    let weight = |key: &RequestKey, counts: &RequestCounts| counts.sent() * u64::from(key.quantity);
    let requests = &view.requests;
    let all: u64 = requests.iter().map(|(key, counts)| weight(key, counts)).sum();
    let heaviest = requests.iter().max_by_key(|(key, counts)| (weight(key, counts), **key));
    // One of several that are alike is no reason.
    let heaviest = heaviest.filter(|(key, counts)| weight(key, counts) * 2 > all);
    let most = heaviest.map_or(String::new(), |(key, counts)| {
        format!("; most of it is unit {}, {} registers from {} on, {} times", key.unit, key.quantity, key.address, counts.sent())
    });
    let mut claim = Claim::new("bus_saturated", &view.bus.requests_seen, 0.0).with_share(share).fact("most", most);
    (claim.has_begun, claim.has_ended, claim.examples) = (false, false, Vec::new());
    claim.episodes.clear();
    // Its numbers are of time, not of requests that failed.
    claim.harm = 0;
    vec![claim]
}
