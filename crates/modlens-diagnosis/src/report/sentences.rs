//! Claims put into words: the sentence of the table with its places filled.

use modlens_engine::records::DiagnosisRow;
use modlens_protocol::decimal::thousands;
use modlens_protocol::finding::Severity;
use modlens_protocol::source::Clock;

use super::episodes;
use crate::attribution::Rest;
use crate::claim::{duration, Claim};
use crate::contrast::tally::Place;
use crate::contrast::BusContrast;
use crate::table::diagnosis;

/// The row of a claim.
pub(super) fn row(bus: &str, contrast: &BusContrast, claim: &Claim, rest: Rest) -> DiagnosisRow {
    let known = diagnosis(claim.code).expect("each kind has a row in the table, which a test walks");
    let time = |place: Option<Place>| place.and_then(|place| place.time).filter(|_| contrast.facts.clock == Clock::Utc);
    let is_sight = claim.sight.is_some();
    let (advice, proof) = claim.sight.map_or((&*known.advice, &*known.proof), |symptom| known.at_sight(symptom));
    DiagnosisRow {
        code: &known.code,
        severity: least(known.severity, claim.at_most),
        bus: bus.to_owned(),
        unit: claim.unit,
        function: claim.function,
        address: claim.address,
        client: claim.client.clone(),
        failed: claim.share.failed,
        total: claim.share.total,
        since: time(claim.first),
        until: time(claim.last).filter(|_| claim.has_ended),
        certainty: claim.certainty.text(),
        chance: Some(three_digits(claim.chance)).filter(|_| !is_sight),
        odds: claim.odds.map(|(odds, _)| three_digits(odds)),
        share: claim.explains.map(|explains| (explains.total() as f64 / rest.odd.total().max(1) as f64).min(1.0)),
        episodes: super::episodes::intervals(contrast, claim),
        sentence: filled(if is_sight { "{sight}" } else { &known.sentence }, contrast, claim),
        advice: filled(advice, contrast, claim),
        proof: filled(proof, contrast, claim),
        examples: claim.examples.clone(),
    }
}

/// A figure of three digits: those after them differ between machines, whose logarithms do.
fn three_digits(figure: f64) -> f64 {
    format!("{figure:.2e}").parse().expect("a number in its own words")
}

/// The place of a severity, the worst one last.
pub(super) fn rank(severity: Severity) -> u8 {
    match severity {
        Severity::Info => 0,
        Severity::Warning => 1,
        Severity::Error => 2,
    }
}

fn least(one: Severity, other: Severity) -> Severity {
    if rank(one) <= rank(other) {
        one
    } else {
        other
    }
}

/// The text with its places filled. A place is a name in braces.
fn filled(text: &str, contrast: &BusContrast, claim: &Claim) -> String {
    let mut out = String::with_capacity(text.len() * 2);
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once('{') {
        let Some((name, behind)) = behind.split_once('}') else { break };
        out.push_str(before);
        out.push_str(&place(name, contrast, claim));
        rest = behind;
    }
    out.push_str(rest);
    if let Some(first) = out.chars().next() {
        out.replace_range(..first.len_utf8(), &first.to_uppercase().to_string());
    }
    out
}

/// The text for a place: a fact of the claim, or what all claims have.
fn place(name: &str, contrast: &BusContrast, claim: &Claim) -> String {
    if let Some((_, value)) = claim.facts.iter().find(|(fact, _)| *fact == name) {
        return value.clone();
    }
    match name {
        "subject" => subject(claim),
        "unit" => claim.unit.map_or(String::from("the unit"), |unit| format!("unit {unit}")),
        "failed" => thousands(claim.share.failed),
        "total" => thousands(claim.share.total),
        "when" => episodes::several(contrast, claim).unwrap_or_else(|| when(contrast, claim)),
        "than" => String::from("the recording"),
        _ => String::new(),
    }
}

fn subject(claim: &Claim) -> String {
    match (claim.unit, &claim.client) {
        (Some(unit), _) => format!("unit {unit}"),
        (None, Some(client)) => format!("client {client}"),
        (None, None) => String::from("the line"),
    }
}

/// Since when, and until when; nothing where it holds from beginning to end.
fn when(contrast: &BusContrast, claim: &Claim) -> String {
    let text = |place: Option<Place>| place.and_then(|place| moment(contrast, place));
    let since = text(claim.first).filter(|_| claim.has_begun).map(|time| format!(" since {time}"));
    let until = text(claim.last).filter(|_| claim.has_ended).map(|time| format!(" until {time}"));
    match (since, until) {
        (Some(since), Some(until)) => format!("{},{until}", since.replace(" since ", " from ")).replace(", until", " to"),
        (since, until) => since.or(until).unwrap_or_default(),
    }
}

fn moment(contrast: &BusContrast, place: Place) -> Option<String> {
    if let Some(time) = place.time.filter(|_| contrast.facts.clock == Clock::Utc) {
        let mut text = Vec::new();
        modlens_protocol::timestamp::push_time(time, &mut text);
        // To the second: 2026-11-21 10:00:00 UTC.
        return Some(format!("{} UTC", String::from_utf8_lossy(&text[..19]).replace('T', " ")));
    }
    place.elapsed.map(|elapsed| format!("{} after the beginning", duration(elapsed)))
}
