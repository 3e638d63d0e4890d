//! The recordings of a document, or its live lines: how each was read.

use serde_json::{json, Value as Json};

use crate::layout::{list, text};
use crate::texts::number;

const MAX_NOTES: usize = 20;

/// How a recording was read, by its last status.
pub fn source(status: &Json, statistics: &Json, overview: &Json) -> Json {
    let details = &status["details"];
    let buses: Vec<&Json> = list(&overview["buses"]).iter().filter(|bus| bus["source"] == status["name"]).collect();
    let clock = details["clock"].as_str().unwrap_or("none");
    let resolution = details["resolution_ns"].as_f64().filter(|&ns| ns > 0.0 && clock != "none");
    json!({
        "name": status["name"],
        "format": Some(text(&status["format"])).filter(|format| !format.is_empty()).unwrap_or("not read"),
        "reason": if status["forced"] == true { "named by --from" } else { text(&status["reason"]) },
        "confidence": status["confidence"],
        "clock": clock_in_words(clock),
        "resolution_us": resolution.map(|ns| ns / 1000.0),
        "line": line_settings(&buses),
        "bytes_in_frames": bytes_in_frames(&buses, statistics),
        "notes": notes(details),
    })
}

fn clock_in_words(clock: &str) -> &str {
    match clock {
        "none" => "no times",
        "relative" => "from the start of the recording",
        "time of day" => "without a date",
        "local" => "local, zone unknown",
        "utc" => "UTC",
        other => other,
    }
}

fn line_settings(buses: &[&Json]) -> Option<String> {
    let mut found: Vec<&str> = Vec::new();
    for settings in buses.iter().map(|bus| text(&bus["settings"])) {
        if !settings.is_empty() && !found.contains(&settings) {
            found.push(settings);
        }
    }
    (!found.is_empty()).then(|| found.join(", "))
}

/// The share of bytes that are not noise.
fn bytes_in_frames(buses: &[&Json], statistics: &Json) -> Option<f64> {
    let own = list(&statistics["buses"]).iter().filter(|bus| buses.iter().any(|one| one["bus"] == bus["bus"]));
    let (mut total, mut noise) = (0.0, 0.0);
    for counts in own.filter_map(|bus| bus["bytes"].as_object()) {
        total += counts.values().map(number).sum::<f64>();
        noise += counts.get("noise").map_or(0.0, number);
    }
    (total > 0.0).then(|| (total - noise) / total)
}

/// What was left out of a recording, and what was said of it.
fn notes(details: &Json) -> Vec<Json> {
    let note = |what: &str, count: Option<&Json>| json!({"what": what, "count": count});
    let trouble = details["trouble"].as_str().filter(|trouble| !trouble.is_empty()).map(|trouble| note(trouble, None));
    let dropped = details["dropped"].as_object().into_iter().flatten().map(|(reason, count)| note(reason, Some(count)));
    let unparsed = Some(&details["unparsed"]).filter(|&count| number(count) > 0.0);
    let unparsed = unparsed.map(|count| note("lines that could not be parsed", Some(count)));
    let examples = list(&details["unparsed_examples"]).iter();
    let examples = examples.map(|one| note(&format!("line {}: {}", one[0], text(&one[1])), None));
    let said = list(&details["said"]).iter().map(|said| note(text(said), None));
    trouble.into_iter().chain(dropped).chain(unparsed).chain(examples).chain(said).take(MAX_NOTES).collect()
}
