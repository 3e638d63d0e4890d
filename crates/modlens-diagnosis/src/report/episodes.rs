//! Episodes of a diagnosis: in words, as ISO 8601 intervals, as JSON.

use modlens_protocol::source::Clock;
use modlens_protocol::timestamp::time_text;
use serde_json::{json, Value as Json};

use crate::claim::{duration, Claim};
use crate::contrast::gaps::Episode;
use crate::contrast::tally::Place;
use crate::contrast::BusContrast;

/// So many episodes are named in a sentence.
const MOST_NAMED: usize = 3;

/// Several episodes in words, the longest ones named; `None` where there is only one.
pub(super) fn several(contrast: &BusContrast, claim: &Claim) -> Option<String> {
    let count = claim.episodes.len();
    if count < 2 {
        return None;
    }
    let mut named: Vec<&Episode> = claim.episodes.iter().collect();
    named.sort_by_key(|one| std::cmp::Reverse((length(one), one.failed)));
    named.truncate(MOST_NAMED);
    // Connections have no numbers.
    named.sort_by_key(|one| (one.first.number, one.first.time));
    let most = if count > MOST_NAMED { ", longest" } else { "" };
    let mut day = String::new();
    let words: Vec<String> = named.iter().map(|one| words(contrast, one, &mut day)).collect();
    let zone = if contrast.facts.clock == Clock::Utc { " UTC" } else { "" };
    Some(format!(" in {count} episodes{most} ({}{zone})", words.join("; ")))
}

/// How long an episode was.
fn length(one: &Episode) -> Option<i64> {
    let by = |time: fn(&Place) -> Option<i64>| Some(time(&one.last)? - time(&one.first)?);
    by(|place| place.elapsed).or_else(|| by(|place| place.time))
}

/// An episode in words; the date is named where it is another one than `day`.
fn words(contrast: &BusContrast, one: &Episode, day: &mut String) -> String {
    let length = length(one).filter(|length| *length > 0).map_or(String::new(), |length| format!(", {}", in_seconds(length)));
    match (one.first.time, one.last.time, one.first.elapsed, one.last.elapsed) {
        (Some(from), Some(to), _, _) if contrast.facts.clock == Clock::Utc => {
            let (from, to) = (moment(from, day), moment(to, day));
            if from.ends_with(&to) {
                from
            } else {
                format!("{from} to {to}{length}")
            }
        }
        (_, _, Some(from), Some(to)) => format!("{} to {} after the beginning{length}", duration(from), duration(to)),
        _ => format!("transactions {} to {}", one.first.number, one.last.number),
    }
}

/// How long an episode was, to the second where it has any.
fn in_seconds(length: i64) -> String {
    match length {
        1_000_000_000..10_000_000_000 => format!("{:.0} s", length as f64 / 1e9),
        _ => duration(length),
    }
}

/// A time of day, after its date where that is another one than before.
fn moment(time: i64, day: &mut String) -> String {
    let text = time_text(time);
    let (date, time) = (&text[..10], &text[11..19]);
    if day == date {
        return time.to_owned();
    }
    date.clone_into(day);
    format!("{date} {time}")
}

/// The episodes as ISO 8601 intervals, where the clock is set to UTC.
pub(super) fn intervals(contrast: &BusContrast, claim: &Claim) -> String {
    let of = |one: &Episode| Some(format!("{}/{}", time_text(one.first.time?), time_text(one.last.time?)));
    let is_known = contrast.facts.clock == Clock::Utc;
    let all: Vec<String> = claim.episodes.iter().filter(|_| is_known).filter_map(of).collect();
    all.join(" ")
}

/// The episodes as JSON.
pub(super) fn json(contrast: &BusContrast, claim: &Claim) -> Vec<Json> {
    let text = |place: &Place| place.time.filter(|_| contrast.facts.clock == Clock::Utc).map(time_text);
    let of = |one: &Episode| {
        json!({
            "since": text(&one.first), "until": text(&one.last), "seconds": length(one).map(|length| length as f64 / 1e9),
            "first": one.first.number, "last": one.last.number, "failed": one.failed, "total": one.total,
        })
    };
    claim.episodes.iter().map(of).collect()
}
