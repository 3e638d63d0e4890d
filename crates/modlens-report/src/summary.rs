//! What a report shows at its top: the name of the plant or bus, the period, the sources.

use std::path::Path;

use modlens_protocol::timestamp::{day_number, time_text};
use modlens_protocol::visible::visible;
use serde_json::{json, Value as Json};

use crate::layout::{list, text};
use crate::texts::{fixed, number, percent};

const MINUTE_S: f64 = 60.0;
const HOUR_S: f64 = 3600.0;
const DAY_S: f64 = 86400.0;

/// Buses that are named; of more, the number is shown.
const MOST_NAMES: usize = 2;

/// Names of files that say nothing about the bus: the folder does.
const GENERIC: [&str; 8] = ["capture", "dump", "log", "modbus", "recording", "session", "tap", "trace"];

/// `name`, `period` and `sources`, each as text for people.
pub fn summary(sources: &[Json], statistics: &Json, overview: &Json, title: Option<&str>) -> Json {
    let given = title.filter(|title| !title.is_empty()).map(ToOwned::to_owned);
    json!({
        "name": visible(&given.unwrap_or_else(|| name(sources, list(&overview["buses"])))),
        "period": period(statistics, overview),
        "sources": basis(sources, statistics, list(&overview["buses"])),
    })
}

/// The names that the recordings give their buses, else what the files' names have in common.
fn name(sources: &[Json], buses: &[Json]) -> String {
    let named = buses.iter().filter(|bus| bus["bus"] != bus["source"]).map(|bus| text(&bus["bus"]));
    let named = distinct(named);
    if !named.is_empty() {
        return if named.len() <= MOST_NAMES { named.join(", ") } else { format!("{} buses", fixed(named.len() as f64, 0)) };
    }
    let paths: Vec<&Path> = sources.iter().map(|one| Path::new(text(&one["name"]))).collect();
    let of_files = common(paths.iter().map(|path| stem(path)));
    let of_folders = || common(paths.iter().map(|path| path.parent().map_or("", name_of)));
    if GENERIC.contains(&of_files.to_lowercase().as_str()) {
        Some(of_folders()).filter(|name| !name.is_empty()).unwrap_or(of_files)
    } else {
        Some(of_files).filter(|name| !name.is_empty()).unwrap_or_else(|| "Modbus".to_owned())
    }
}

fn distinct<'a>(texts: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut found = Vec::new();
    for text in texts {
        if !found.contains(&text) {
            found.push(text);
        }
    }
    found
}

/// What names begin with in common, without a number at its end where they differ.
fn common<'a>(mut names: impl Iterator<Item = &'a str>) -> String {
    let Some(first) = names.next() else { return String::new() };
    let shared = |one: &'a str, other: &str| -> &'a str {
        let different = one.char_indices().zip(other.chars()).find(|((_, letter), with)| letter != with);
        let end = different.map_or(one.len().min(other.len()), |((at, _), _)| at);
        &one[..end]
    };
    let names: Vec<&str> = names.collect();
    if names.iter().all(|name| *name == first) {
        return first.to_owned();
    }
    let found = names.into_iter().fold(first, shared);
    let short = found.trim_end_matches(|letter: char| letter.is_ascii_digit() || "-_. ".contains(letter));
    if short.is_empty() {
        found.to_owned()
    } else {
        short.to_owned()
    }
}

fn name_of(path: &Path) -> &str {
    path.file_name().and_then(|name| name.to_str()).unwrap_or_default()
}

/// The name of a file up to its first dot.
fn stem(path: &Path) -> &str {
    let name = name_of(path);
    let hidden = name.len() - name.trim_start_matches('.').len();
    let end = name[hidden..].find('.').filter(|_| !name.ends_with('.')).map_or(name.len(), |at| hidden + at);
    Some(&name[..end]).filter(|stem| !stem.is_empty()).unwrap_or(name)
}

/// From when to when, how long, and the time zone: the one place of the page that names it.
fn period(statistics: &Json, overview: &Json) -> String {
    let spans: Vec<(f64, f64)> = list(&overview["buses"]).iter().filter_map(|bus| span(bus, statistics, overview)).collect();
    let Some((begin, end)) = spans.iter().copied().reduce(|one, other| (one.0.min(other.0), one.1.max(other.1))) else {
        let whole = list(&statistics["buses"]).iter().map(|bus| number(&bus["duration_us"])).sum::<f64>() / 1e6;
        return if whole > 0.0 { format!("{}, without a date.", duration(whole)) } else { "Without times.".to_owned() };
    };
    let (first, last) = (moment(begin, end - begin), moment(end, end - begin));
    let last = if first.get(..10) == last.get(..10) { last.get(11..).unwrap_or(&last) } else { &last };
    format!("{first} to {last} ({}). All times are UTC.", duration(end - begin))
}

/// The first and last second of a bus that has a clock.
///
/// The first bucket with a frame is known to its width. An example says when its recording began.
fn span(bus: &Json, statistics: &Json, overview: &Json) -> Option<(f64, f64)> {
    if bus["axis"] != "utc" {
        return None;
    }
    let line = &bus["line"];
    let first = list(&line["frames"]).iter().position(|count| number(count) > 0.0).unwrap_or_default();
    let step = number(&line["step"]) / 1e6;
    let start = (number(&line["start"]) + first as f64 * number(&line["step"])) / 1e6;
    let mut examples = list(&overview["examples"]).iter().rev().filter(|row| row["bus"] == bus["bus"]);
    let begun = examples.find_map(|row| Some(seconds(row["time"].as_str()?)? - row["elapsed_us"].as_f64()? / 1e6));
    let start = begun.filter(|exact| (exact - start).abs() <= step).unwrap_or(start);
    Some((start, start + duration_us(&bus["bus"], statistics) / 1e6))
}

fn duration_us(bus: &Json, statistics: &Json) -> f64 {
    let found = list(&statistics["buses"]).iter().rev().find(|one| one["bus"] == *bus);
    found.map_or(0.0, |one| number(&one["duration_us"]))
}

/// The seconds since 1970 of a time as the core writes it.
fn seconds(time: &str) -> Option<f64> {
    let at = |from: usize, to: usize| time.get(from..to)?.parse::<i64>().ok();
    let whole = day_number(at(0, 4)?, at(5, 7)?, at(8, 10)?) as f64 * DAY_S
        + (at(11, 13)? * 3600 + at(14, 16)? * 60 + at(17, 19)?) as f64;
    let fraction = time.get(19..)?.trim_end_matches('Z');
    Some(whole + if fraction.is_empty() { 0.0 } else { format!("0{fraction}").parse::<f64>().ok()? })
}

/// Date and time of day: to the minute, or finer where the recording is short.
fn moment(seconds: f64, length: f64) -> String {
    let (step_ms, letters) = match length {
        long if long >= HOUR_S => (60_000.0, 16),
        short if short >= MINUTE_S => (1000.0, 19),
        _ => (1.0, 23),
    };
    let ms = (seconds * 1000.0 / step_ms).round_ties_even() * step_ms;
    if ms.abs() > i64::MAX as f64 / 1e6 {
        return format!("{seconds:.0} s after 1970");
    }
    time_text(ms as i64 * 1_000_000)[..letters].replace('T', " ")
}

/// A duration in its largest unit, and the next one where it says something.
fn duration(seconds: f64) -> String {
    if seconds < 1.0 {
        return format!("{:.0} ms", seconds * 1000.0);
    }
    if seconds < MINUTE_S {
        return format!("{seconds:.1} s");
    }
    let two = |value: f64, base: u64, unit: &str, smaller: &str| {
        let value = value.round_ties_even() as u64;
        match value % base {
            0 => format!("{} {unit}", value / base),
            rest => format!("{} {unit} {rest} {smaller}", value / base),
        }
    };
    if seconds < HOUR_S {
        two(seconds, 60, "min", "s")
    } else if seconds < 2.0 * DAY_S {
        two(seconds / MINUTE_S, 60, "h", "min")
    } else {
        two(seconds / HOUR_S, 24, "days", "h")
    }
}

/// How many recordings, of how many hours, with which line settings, and how well they read.
fn basis(sources: &[Json], statistics: &Json, buses: &[Json]) -> String {
    let is_live = !sources.is_empty() && sources.iter().all(|one| one["format"] == "live");
    let noun = if is_live { "live line" } else { "recording" };
    let mut parts = vec![format!("{} {noun}{}", fixed(sources.len() as f64, 0), if sources.len() == 1 { "" } else { "s" })];
    let seconds = heard_us(statistics, buses) / 1e6;
    if seconds >= 2.0 * HOUR_S {
        parts.push(format!("{} hours", fixed((seconds / HOUR_S).round_ties_even(), 0)));
    } else if seconds > 0.0 {
        parts.push(duration(seconds));
    }
    let lines = distinct(sources.iter().map(|one| text(&one["line"])).filter(|line| !line.is_empty()));
    if (1..=MOST_NAMES).contains(&lines.len()) {
        parts.push(lines.join(", "));
    }
    let least = sources.iter().filter_map(|one| one["bytes_in_frames"].as_f64()).reduce(f64::min);
    parts.extend(least.map(|share| format!("{} of the bytes are in frames", percent(share))));
    parts.join(", ")
}

/// The time that all sources were heard; buses of the same one at once.
fn heard_us(statistics: &Json, buses: &[Json]) -> f64 {
    let mut heard: Vec<(&str, f64)> = Vec::new();
    for bus in buses {
        let (source, us) = (text(&bus["source"]), duration_us(&bus["bus"], statistics));
        match heard.iter_mut().find(|(name, _)| *name == source) {
            Some((_, longest)) => *longest = longest.max(us),
            None => heard.push((source, us)),
        }
    }
    heard.iter().map(|(_, us)| us).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_two_units_at_most() {
        let found = [0.187, 8.8, 725.0, 86_340.0, 604_800.0].map(duration);
        assert_eq!(found, ["187 ms", "8.8 s", "12 min 5 s", "23 h 59 min", "7 days"]);
    }

    #[test]
    fn the_name_is_what_files_have_in_common() {
        let named = |names: &[&str]| {
            let sources: Vec<Json> = names.iter().map(|name| json!({"name": name})).collect();
            name(&sources, &[])
        };
        assert_eq!(named(&["day/monday-1.jsonl", "monday-2.jsonl.gz"]), "monday");
        assert_eq!(named(&["boiler house/recording.jsonl"]), "boiler house");
        assert_eq!(named(&["recording.jsonl"]), "recording");
        assert_eq!(named(&["2026.log"]), "2026", "a number alone stays");
        assert_eq!(named(&[".hidden.log"]), ".hidden");
        assert_eq!(named(&["a.log", "b.log"]), "Modbus");
        assert_eq!(named(&[]), "Modbus");
        let buses = [json!({"bus": "pumps", "source": "x.log"}), json!({"bus": "x.log", "source": "x.log"})];
        assert_eq!(name(&[], &buses), "pumps");
    }

    #[test]
    fn times_are_as_fine_as_the_recording_is_short() {
        let at = seconds("2026-06-21T02:51:00.693962Z").expect("a time");
        assert!((at - 1_782_010_260.693_962).abs() < 1e-6);
        assert_eq!(moment(at, 5.0), "2026-06-21 02:51:00.694");
        assert_eq!(moment(at, 100.0), "2026-06-21 02:51:01");
        assert_eq!(moment(at, 4000.0), "2026-06-21 02:51");
        assert_eq!(moment(1e12, 1.0), "1000000000000 s after 1970");
        assert_eq!(seconds("12.5 s"), None);
    }
}
