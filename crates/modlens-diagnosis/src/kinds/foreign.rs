//! Another protocol: frames of one that is known, or runs that are no Modbus and begin alike.

use std::cmp::Reverse;

use super::unreadable::is_of_slower_line;
use crate::claim::{duration, Claim, View};
use crate::contrast::{NoiseCounts, NoiseKey, NoiseRuns};
use crate::protocols::PROTOCOLS;
use crate::statistics::{at_least, Share};

pub(super) fn is_text(view: &View<'_>) -> bool {
    let noise = &view.bus.noise;
    noise.printable() * 10 > noise.bytes() * 9
}

/// Whether nearly all runs begin alike and go on differently. Requests at a wrong rate are the same from the first byte to the
/// last, and answers begin otherwise than requests.
pub(super) fn is_foreign_alone(view: &View<'_>) -> bool {
    let noise = &view.bus.noise;
    if known(view).is_some() {
        return true;
    }
    if is_of_slower_line(view) {
        return false;
    }
    let runs = noise.runs.sorted();
    let varies = |counts: &NoiseCounts| counts.wholes.sorted().len() > 2;
    let most = runs.iter().max_by_key(|(_, counts)| counts.seen.failed);
    let is_one = most.is_some_and(|(_, counts)| counts.seen.failed * 5 >= noise.compared * 4 && varies(counts));
    // A preamble of two bytes, and then a kind of frame.
    let is_of =
        |head: &[u8]| runs.iter().filter(|(key, _)| key.starts_with(head)).map(|(_, counts)| counts.seen.failed).sum::<u64>();
    let is_preamble = most.and_then(|(key, _)| key.get(..2)).is_some_and(|head| is_of(head) * 5 >= noise.compared * 4);
    let usual = || runs.iter().filter(|(_, counts)| counts.seen.failed * 10 >= noise.compared);
    is_one || (is_preamble && usual().all(|(_, counts)| varies(counts)))
}

/// Runs that are no Modbus and come again.
pub(super) fn foreign_protocol(view: &View<'_>) -> Vec<Claim> {
    let known = known(view).map(|(name, counts)| {
        let share = Share { failed: counts.seen.failed, total: view.bus.noise.compared };
        let alike = format!("are frames of {name}");
        // One begins like another protocol, and has its checksum, by chance once in 65536 times.
        let chance = view.corrected(at_least(share, 1.0 / 65_536.0));
        Claim::new("foreign_protocol", &counts.seen, chance).with_share(share).fact("alike", alike).fact("period", period(counts))
    });
    if known.is_none() && is_of_slower_line(view) {
        return Vec::new();
    }
    let unknown = || foreign_runs(view).or_else(|| foreign_bursts(view)).or_else(|| foreign_heads(view));
    let found = known.or_else(|| unknown().map(|one| one.fact("alike", "begin alike")));
    found.map(|one| one.fact("text", if is_text(view) { ", and are text" } else { "" })).into_iter().collect()
}

/// The protocol that is known by more than its beginning and has most of the runs, if that is a good part of all.
pub(super) fn known<'a>(view: &View<'a>) -> Option<(&'static str, &'a NoiseCounts)> {
    let noise = &view.bus.noise;
    let (protocol, counts) = noise.protocols.iter().max_by_key(|(_, counts)| counts.seen.failed)?;
    let is_enough = counts.seen.failed >= LEAST_ALIKE && counts.seen.failed * 4 >= noise.compared;
    is_enough.then(|| (PROTOCOLS[*protocol].name, counts))
}

/// How often runs come, as a part of the sentence.
fn period(counts: &NoiseCounts) -> String {
    counts.period.percentile(0.5).map_or(String::new(), |period| format!(", one each {}", duration(period)))
}

/// Whether most runs of other bytes begin alike, and not as a frame to or from a unit of this line: where the requests of two
/// masters meet, what remains of them begins with a unit and its function.
pub(super) fn is_surely_foreign(view: &View<'_>) -> bool {
    let noise = &view.bus.noise;
    if known(view).is_some() {
        return true;
    }
    let is_most = most_frequent(noise).is_some_and(|(_, counts)| counts.seen.failed * 5 >= noise.compared * 2);
    is_most && foreign_runs(view).is_some()
}

/// Whether a run begins with two bytes that stand side by side in the requests of this line, or with the function and the byte count
/// of their answers: it is what remains of a frame.
fn begins_as_frame(view: &View<'_>, head: &[u8]) -> bool {
    let Some(head) = head.first_chunk::<2>() else { return false };
    view.requests.iter().any(|(key, _)| {
        let number = key.number().to_be_bytes();
        let count = u8::try_from(key.quantity.saturating_mul(2)).unwrap_or(u8::MAX);
        number[NUMBER_FROM..].windows(2).any(|pair| pair == head) || *head == [key.function, count]
    })
}

/// Where the number of a request has its unit.
const NUMBER_FROM: usize = 2;

/// The beginning that most runs have.
fn most_frequent(noise: &NoiseRuns) -> Option<(&NoiseKey, &NoiseCounts)> {
    noise.runs.sorted().into_iter().max_by_key(|(key, counts)| (counts.seen.failed, *key))
}

/// How likely so many of so many runs begin with the very same bytes, so many of them, if bytes are 00 or FF every third time.
fn by_chance(share: Share, bytes: usize) -> f64 {
    at_least(share, (1.0f64 / 3.0).powi(bytes as i32))
}

/// Whether all bytes are 00 or FF.
fn is_plain(bytes: &[u8]) -> bool {
    bytes.iter().all(|byte| matches!(byte, 0 | 0xFF))
}

/// Runs that begin alike.
fn foreign_runs(view: &View<'_>) -> Option<Claim> {
    let noise = &view.bus.noise;
    let (key, counts) = most_frequent(noise).filter(|(_, counts)| counts.seen.failed >= LEAST_ALIKE)?;
    let share = Share { failed: counts.seen.failed, total: noise.compared };
    let chance = view.significant(by_chance(share, key.len()))?;
    if is_plain(key) || begins_as_frame(view, key) || counts.seen.failed * 4 < noise.compared {
        return None;
    }
    Some(Claim::new("foreign_protocol", &counts.seen, chance).with_share(share).fact("period", period(counts)))
}

/// Whole bursts that begin alike, a preamble of FE included, which looks like strays of its own; those right after a request are
/// its damaged answers.
fn foreign_bursts(view: &View<'_>) -> Option<Claim> {
    let bursts = &view.bus.noise.bursts;
    let compared = bursts.kept.iter().zip(&bursts.answers).filter(|(burst, is_answer)| burst.len() > HEAD && !**is_answer);
    let mut heads: Vec<&[u8]> = compared.map(|(burst, _)| &burst[..HEAD]).collect();
    heads.sort_unstable();
    let most = heads.chunk_by(|one, other| one == other).max_by_key(|alike| (alike.len(), Reverse(alike[0])))?;
    let share = Share { failed: most.len() as u64, total: heads.len() as u64 };
    let chance = view.significant(by_chance(share, HEAD))?;
    if is_plain(most[0]) || begins_as_frame(view, most[0]) || share.failed < LEAST_ALIKE || share.failed * 2 < share.total {
        return None;
    }
    Some(Claim::new("foreign_protocol", &view.bus.noise.strays, chance).with_share(share).fact("period", ""))
}

/// Runs of which two bytes are alike, and which come by a clock of their own, beside requests that are answered. What is left of
/// damaged frames may begin alike, too: it begins with bytes of frames of this line, and comes when its requests do.
fn foreign_heads(view: &View<'_>) -> Option<Claim> {
    let noise = &view.bus.noise;
    let heads = noise.heads.sorted();
    let (head, counts) = heads.into_iter().max_by_key(|(head, counts)| (counts.seen.failed, **head))?;
    let share = Share { failed: counts.seen.failed, total: noise.compared };
    let chance = view.significant(by_chance(share, head.len()))?;
    let is_lone = share.failed >= LEAST_BY_CLOCK && share.failed * 2 >= share.total && !is_plain(head);
    let asked = view.bus.requests_seen.share();
    let is_beside = asked.total >= share.failed && asked.failed * 2 < asked.total;
    if !is_lone || !is_beside || begins_as_frame(view, head) || holds_unit(view, *head) || !has_own_period(view, counts) {
        return None;
    }
    Some(Claim::new("foreign_protocol", &counts.seen, chance).with_share(share).fact("period", period(counts)))
}

/// Fewer runs have no period.
const LEAST_BY_CLOCK: u64 = 8;

/// Whether one of two bytes is a unit of this line: one byte more or less makes such a beginning of a damaged frame.
fn holds_unit(view: &View<'_>, head: [u8; 2]) -> bool {
    view.bus.units.keys().any(|unit| head.contains(unit))
}

/// Whether runs come at regular times, some of which may be missing, and none of the requests comes in step with them.
fn has_own_period(view: &View<'_>, counts: &NoiseCounts) -> bool {
    let fifths = [0.2, 0.5, 0.8].map(|share| counts.period.percentile(share));
    let [Some(least), Some(own), Some(most)] = fifths else { return false };
    let missing = (most + own / 2) / own.max(1);
    let is_steady = (own - least) * STEADY_PART <= own && (most - missing * own).abs() * STEADY_PART <= own;
    // A master asks once in so many runs, or so many times from one to the next.
    let is_near = |one: i64, other: i64| (one - other).abs() <= (own / LEAST_APART).max(own - least);
    let in_step = |other: i64| (1..=MOST_IN_STEP).any(|times| is_near(times * other, own) || is_near(other, times * own));
    let mut periods = view.requests.iter().filter_map(|(_, counts)| counts.period.percentile(0.5));
    is_steady && missing <= MOST_IN_STEP && !periods.any(in_step)
}

/// Times that differ by less than one part of so many are the same; periods of two that are apart differ by more than the other.
const STEADY_PART: i64 = 10;
const LEAST_APART: i64 = 50;
const MOST_IN_STEP: i64 = 3;

/// Whether the strays are a preamble of another protocol: bursts begin alike, and with such a byte.
pub(super) fn have_preamble(view: &View<'_>) -> bool {
    let begins_so = |burst: &&Vec<u8>| burst.len() > HEAD && burst[0] >= 0xFE && burst[1] >= 0xFE && burst[2] < 0xFE;
    let kept = &view.bus.noise.bursts.kept;
    kept.iter().filter(begins_so).count() * 2 > kept.len() && foreign_bursts(view).is_some()
}

/// Fewer runs that begin alike say nothing.
const LEAST_ALIKE: u64 = 4;
/// Bytes by which bursts are compared.
const HEAD: usize = 3;
