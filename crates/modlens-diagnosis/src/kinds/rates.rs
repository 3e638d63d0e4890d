//! What no line can do at the settings that were given, and at which rate it can.

use crate::claim::{duration, Claim, View};
use crate::contrast::rates::{Paced, SenderRate};
use crate::statistics::Share;
use modlens_protocol::finding::Severity;

/// Returns the claim that the line runs at another rate than was given.
pub(super) fn other_rate(view: &View<'_>) -> Option<Claim> {
    by_bytes(view).or_else(|| overfull(view))
}

/// Rates of serial ports.
const RATES: [u32; 11] = [1200, 2400, 4800, 9600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600];
/// The bytes of a line need more time than the recording has if they exceed it by this factor, and by this time, which covers
/// clocks with a step of a second.
const OVERFULL: f64 = 1.1;
const LEAST_SURPLUS_NS: f64 = 2e9;

/// The time that all bytes need at the settings of the line, and that within which they came.
pub(super) fn needed_and_had(view: &View<'_>) -> Option<(f64, f64)> {
    let frames = &view.bus.frames;
    let (char_ns, (first, last)) = (view.bus.facts.char_ns?, frames.span.filter(|_| !view.bus.facts.is_network)?);
    Some((frames.bytes.iter().sum::<u64>() as f64 * char_ns as f64, (last - first) as f64))
}

/// Whether no line with these settings can carry the bytes in their time.
pub(super) fn is_overfull((needed, had): (f64, f64)) -> bool {
    had > 0.0 && needed > OVERFULL * had && needed - had > LEAST_SURPLUS_NS
}

/// More bytes than the line can carry at the settings that were given: a contradiction, whatever else is seen.
fn overfull(view: &View<'_>) -> Option<Claim> {
    let (needed, had) = needed_and_had(view).filter(|both| is_overfull(*both))?;
    let line = view.bus.facts.line?;
    let least = f64::from(line.baud) * needed / had;
    let fits = RATES.iter().find(|rate| f64::from(**rate) >= least);
    let bytes = view.bus.frames.bytes.iter().sum::<u64>();
    let what = format!(
        "bytes, which need {} at {line}, came within {}: the line is faster than {}{}",
        duration(needed as i64),
        duration(had as i64),
        line.baud,
        in_words(fits)
    );
    Some(of_the_tap(view, Share { failed: bytes, total: bytes }, what))
}

/// Returns the claim that the settings of the tap are not those of the line, from its beginning to its end.
fn of_the_tap(view: &View<'_>, share: Share, what: String) -> Claim {
    let mut claim = Claim::new("wrong_line_settings", &view.bus.requests_seen, 0.0).with_share(share);
    (claim.has_begun, claim.has_ended, claim.harm) = (false, false, view.bus.requests_seen.total);
    (claim.episodes, claim.examples) = (Vec::new(), Vec::new());
    claim.fact("subject", "the tap").fact("than", "the line").fact("what", what)
}

/// Fewer frames tell nothing of the rate of a line.
const LEAST_FRAMES: u64 = 20;

/// Senders that pause between their bytes do so in different ways: their bytes come at one rate within this tolerance.
const SAME_RATE: f64 = 0.05;

/// A rate of serial ports that bytes came at is as near as this to one of the list.
const NEAR_RATE: f64 = 0.12;

/// Returns the claim that the bytes inside frames came faster than the settings allow, or all of them more slowly.
fn by_bytes(view: &View<'_>) -> Option<Claim> {
    let (line, char_ns) = (view.bus.facts.line?, view.bus.facts.char_ns? as f64);
    let rate = |paced: Paced| f64::from(line.baud) * paced.bytes as f64 * char_ns / paced.lasted.max(1) as f64;
    let sum = |of: fn(&SenderRate) -> Paced| {
        view.bus.frames.rates.senders().fold(Paced::default(), |mut sum, sender| {
            sum.merge(of(sender));
            sum
        })
    };
    let timed: u64 = view.bus.frames.rates.senders().map(|sender| sender.timed).sum();
    let faster = sum(|sender| sender.faster);
    if timed >= LEAST_FRAMES && faster.frames * 2 > timed {
        let what = format!(
            "frames came faster than {line} allows: the line is faster than {}{}",
            line.baud,
            in_words(nearest(rate(faster)).as_ref())
        );
        return Some(of_the_tap(view, Share { failed: faster.frames, total: timed }, what));
    }
    // One sender may be slow; all of them are at the same rate only where it is that of the line.
    let slower = sum(|sender| sender.slower);
    let by_bytes: u64 = view.bus.frames.rates.senders().map(|sender| sender.by_bytes).sum();
    let fits = nearest(rate(slower)).filter(|fits| *fits < line.baud)?;
    let is_at_rate = |sender: &SenderRate| {
        let is_all = sender.slower.frames * 10 >= sender.by_bytes * 9;
        is_all && (rate(sender.slower) / f64::from(fits) - 1.0).abs() < SAME_RATE
    };
    let mut senders = view.bus.frames.rates.senders().filter(|sender| sender.by_bytes > 0);
    if by_bytes < LEAST_FRAMES || slower.frames * 10 < by_bytes * 9 || !senders.all(is_at_rate) {
        return None;
    }
    let what = format!(
        "frames came more slowly than at {line}, from all senders alike: the line is slower than {}{}",
        line.baud,
        in_words(Some(&fits))
    );
    let mut claim = of_the_tap(view, Share { failed: slower.frames, total: by_bytes }, what).at_most(Severity::Warning);
    // It makes no request fail.
    claim.harm = 0;
    Some(claim)
}

/// Returns the rate of serial ports nearest to this one, if it is near.
fn nearest(rate: f64) -> Option<u32> {
    RATES.into_iter().find(|one| (rate / f64::from(*one) - 1.0).abs() < NEAR_RATE)
}

fn in_words(fits: Option<&u32>) -> String {
    fits.map_or(String::new(), |rate| format!("; {rate} fits"))
}
