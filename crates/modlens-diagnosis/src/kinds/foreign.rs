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
    let found = known.or_else(|| foreign_runs(view).or_else(|| foreign_bursts(view)).map(|one| one.fact("alike", "begin alike")));
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

/// Whether a run begins with a unit that is asked on this line and its function: it is what remains of a frame.
fn begins_as_frame(view: &View<'_>, head: &[u8]) -> bool {
    view.requests.iter().any(|(key, _)| head.starts_with(&[key.unit, key.function]))
}

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
