//! What is not Modbus: inverted bits, another rate, another protocol.

use super::foreign::{is_foreign_alone, is_text, known};
use super::rates;
use super::unreadable::{bytes, is_of_slower_line, is_unreadable, only_requests_are_valid, LEAST_BYTES};
use crate::claim::{percent, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::UnitCounts;
use crate::observation::DamagedPart;
use crate::statistics::{at_least, fisher, least_rate, Share};
use crate::MAX_CHANCE;
use modlens_engine::line_search::{readings, Reading};
use modlens_protocol::framing::Verdict;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::line::Parity;

/// Share of the noise whose bytes are 00, FF or a run of equal bits at one end.
fn inverted_share(view: &View<'_>) -> f64 {
    let noise = &view.bus.noise;
    noise.of_driver() as f64 / noise.bytes().max(1) as f64
}

/// Bytes of registers are mostly 0 bits. With the wires swapped, those that a client receives are mostly 1 bits.
const MOSTLY_ONES: f64 = 0.6;

/// Whether the bytes that were received have mostly 1 bits.
fn mostly_ones(view: &View<'_>) -> bool {
    let bytes = || view.bus.noise.bursts.kept.iter().flatten();
    let (bits, ones) = (bytes().count() as u64 * 8, bytes().map(|byte| u64::from(byte.count_ones())).sum::<u64>());
    let share = Share { failed: ones, total: bits };
    bits >= 8 * LEAST_BYTES && least_rate(share) > MOSTLY_ONES
}

/// A burst of random bytes ends in 00 once in 256 times; of values of registers, much more often.
const ENDS_IN_ZERO: f64 = 0.3;

fn is_inverted(view: &View<'_>) -> bool {
    // In a client's log the bursts of the bus are cut anywhere, but nearly all bytes are of these kinds.
    if only_requests_are_valid(view) && mostly_ones(view) {
        return true;
    }
    if only_requests_are_valid(view) && view.bus.noise.bytes() >= LEAST_BYTES && inverted_share(view) > 0.95 {
        return true;
    }
    if is_of_slower_line(view) {
        return false;
    }
    let ends = view.bus.noise.ends_in_zero.share();
    ends.total >= 5 && view.significant(at_least(ends, ENDS_IN_ZERO)).is_some() && ends.rate() > 0.6
}

/// Readings of the bytes that fit where the one that they were recorded with does not. Without settings each parity is tried.
fn other_readings(view: &View<'_>) -> Vec<Reading> {
    let parities = view.bus.facts.line.map_or(vec![Parity::None, Parity::Even, Parity::Odd], |line| vec![line.parity]);
    let mut tried = parities.into_iter().map(|parity| readings(&view.bus.noise.bursts.kept, parity));
    tried.find(|found| !found.is_empty()).unwrap_or_default()
}

/// What a reading rests on, as the end of a sentence.
fn proved(reading: &Reading) -> String {
    format!("; tried on the recorded bytes: {} ({})", reading.what, reading.evidence)
}

/// The reading of swapped wires, if it fits.
fn swapped(view: &View<'_>) -> Option<Reading> {
    other_readings(view).into_iter().find(|reading| reading.is_swapped)
}

/// No valid frame, and bursts that end in 00, or that are valid frames with swapped wires.
pub(super) fn swapped_wires(view: &View<'_>) -> Vec<Claim> {
    if !is_unreadable(view) {
        return Vec::new();
    }
    let read = swapped(view);
    if read.is_none() && (known(view).is_some() || !is_inverted(view)) {
        return Vec::new();
    }
    let ends = &view.bus.noise.ends_in_zero;
    if only_requests_are_valid(view) {
        let share = Share { failed: view.bus.noise.of_driver(), total: view.bus.noise.bytes() };
        let chance = view.corrected(at_least(share, 0.5));
        let claim = Claim::new("swapped_wires", &view.bus.requests_seen, chance).with_share(share).fact("where", "at the master");
        return vec![
            claim.fact("what", format!("{} of {} bytes that it receives are 00, FF or their like", share.failed, share.total))
        ];
    }
    let zeros = format!("no frame is valid, {} of the bytes are 00, FF or their like", percent(inverted_share(view)));
    let claim = if let Some(read) = read {
        let (good, other) = bytes(view);
        let share = Share { failed: other, total: good + other };
        let claim = Claim::new("swapped_wires", ends, view.corrected(at_least(share, 0.5))).with_share(share);
        claim.fact("what", format!("{zeros}{}", proved(&read)))
    } else {
        let (chance, ended) = (view.corrected(at_least(ends.share(), ENDS_IN_ZERO)), ends.share());
        let what = format!("{zeros}, and {} of {} bursts end in 00", ended.failed, ended.total);
        Claim::new("swapped_wires", ends, chance).fact("what", what)
    };
    vec![claim.fact("where", "at the tap")]
}

/// No valid frame at all, or no valid answer of one unit and a wrong length throughout.
pub(super) fn wrong_line_settings(view: &View<'_>) -> Vec<Claim> {
    if is_unreadable(view) {
        let tried = other_readings(view);
        let is_other = is_inverted(view) || is_text(view) || is_foreign_alone(view);
        if tried.iter().any(|reading| reading.is_swapped) || (tried.is_empty() && is_other) {
            return Vec::new();
        }
        if tried.is_empty() && bears_heads(view) {
            return Vec::new();
        }
        let (good, other) = bytes(view);
        let share = Share { failed: other, total: good + other };
        let chance = view.corrected(at_least(share, 0.5));
        let claim = Claim::new("wrong_line_settings", &view.bus.noise.ends_in_zero, chance).with_share(share);
        let tried = tried.first().map_or(String::new(), proved);
        return vec![claim.fact("what", format!("bytes belong to no valid frame{tried}"))];
    }
    if let Some(claim) = rates::other_rate(view).or_else(|| errors_on_all(view)) {
        return vec![claim];
    }
    let other = |unit, counts| {
        at_another_rate(view, unit, counts)
            .or_else(|| errors_of_one(view, unit, counts))
            .or_else(|| all_zeros(view, unit, counts))
    };
    view.units().filter_map(|(unit, counts)| other(unit, counts)).collect()
}

/// From this share of the frames on, parity and framing errors are the settings: noise hits fewer of the frames that are valid.
const MOSTLY_ERRORS: f64 = 0.5;

/// Parity or framing errors on most frames, requests and answers alike: the settings of the tap.
fn errors_on_all(view: &View<'_>) -> Option<Claim> {
    let sides = [0, 1].map(|side: usize| view.units().map(|(_, counts)| counts.line_errors[side].failed).sum::<u64>());
    let errors: Tally = view.units().flat_map(|(_, counts)| &counts.line_errors).sum();
    let frames = view.bus.frames.frames.iter().sum::<u64>() - view.bus.frames.of(Verdict::Noise);
    let share = Share { failed: errors.failed.min(frames), total: frames };
    if sides.iter().any(|side| *side * 4 < errors.failed) || least_rate(share) < MOSTLY_ERRORS {
        return None;
    }
    let chance = view.beyond_accident(share)?;
    let what = "frames have parity or framing errors, and right checksums";
    Some(
        Claim::new("wrong_line_settings", &errors, chance)
            .with_share(share)
            .fact("subject", "the tap")
            .fact("than", "the line")
            .fact("what", what),
    )
}

/// Parity or framing errors on the answers of one unit, and hardly any elsewhere: the settings of that unit.
fn errors_of_one(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let answers = |counts: &UnitCounts| {
        let answered = counts.heard();
        Share { failed: counts.line_errors[1].failed.min(answered), total: answered }
    };
    let requests = view.units().map(|(_, counts)| counts.line_errors[0].failed).sum::<u64>();
    let asked = view.units().map(|(_, counts)| counts.failures.total).sum::<u64>();
    let others = view.others(unit, answers).with(Share { failed: requests.min(asked), total: asked });
    let (share, tally) = (answers(counts), &counts.line_errors[1]);
    if least_rate(share) < MOSTLY_ERRORS || others.rate() * 10.0 > share.rate() {
        return None;
    }
    let chance = view.significant(fisher(share, others))?;
    let what = "answers have parity or framing errors";
    Some(Claim::new("wrong_line_settings", tally, chance).of_unit(unit).with_share(share).fact("what", what))
}

/// Whether most bursts hold unit and function of a request side by side: an answer's head, which a receiver at another rate
/// does not get. Their other bytes were lost after the line, as where a client reads no more than the length expected.
fn bears_heads(view: &View<'_>) -> bool {
    let heads: Vec<[u8; 2]> = view.requests.iter().map(|(key, _)| [key.unit, key.function]).collect();
    let is_head = |pair: &[u8]| heads.iter().any(|[unit, function]| pair[0] == *unit && pair[1] & !EXCEPTION_BIT == *function);
    let kept = &view.bus.noise.bursts.kept;
    let held = kept.iter().filter(|burst| burst.windows(2).any(is_head)).count() as u64;
    // Of 256 random bytes, each place is a head by chance once in so many times.
    let by_accident = 256.0 * 2.0 * heads.len() as f64 / 65_536.0;
    let share = Share { failed: held, total: kept.len() as u64 };
    share.rate() > 0.3 && at_least(share, by_accident.min(0.2)) < MAX_CHANCE
}

/// A unit whose answers all have the length asked for and begin with two bytes of 00: with another rate or two devices, the length
/// would differ, and a driver that idles sends no bytes in step. A receiver that checks the parity puts 00 for each wrong byte.
fn all_zeros(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let ratios = counts.length_ratios;
    let zeros = counts.wrong_heads.sorted().into_iter().filter(|(head, _)| **head == 0).map(|(_, count)| *count).sum::<u64>();
    let answered = counts.answered();
    let is_as_long = counts.odd_lengths.failed * 10 <= ratios.count;
    if answered > 0 || ratios.count < 5 || !is_as_long || zeros * 10 < counts.garbled.failed * 9 {
        return None;
    }
    let chance = view.beyond_accident(counts.garbled.share())?;
    let what = "answers have the right length, and read as 00, as bytes with a wrong parity do";
    Some(Claim::new("wrong_line_settings", &counts.garbled, chance).of_unit(unit).fact("what", what))
}

/// A unit none of whose answers is valid, and all of whose answers are too short or too long by the same ratio.
fn at_another_rate(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let ratios = counts.length_ratios;
    let answered = counts.answered();
    let ratio = ratios.came as f64 / ratios.expected.max(1) as f64;
    if answered > 0 || ratios.count < 5 || (0.85..1.2).contains(&ratio) || counts.bad_requests.failed > 0 {
        return None;
    }
    // A receiver at another rate gets no head of an answer right.
    let heads: u64 = counts.damaged_parts.iter().map(|part| part.failed).sum::<u64>() - counts.damaged(DamagedPart::Whole);
    if heads > 2 && heads * 20 > counts.garbled.failed {
        return None;
    }
    let chance = view.beyond_accident(counts.garbled.share())?;
    let what = format!("answers are garbled, with {} of the bytes expected", percent(ratio));
    Some(Claim::new("wrong_line_settings", &counts.garbled, chance).of_unit(unit).fact("what", what))
}
