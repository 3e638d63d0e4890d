//! The document of a recording: what the doctor says, statistics, time series, examples, and what a person wants to know first.

use modlens_protocol::annotate::{annotate, has_checksum, pdu_of, spaced_hex, Body, Piece, Wrapping};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::{Finding, Severity};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::hex::decode_pairs;
use modlens_protocol::status::Status;
use serde_json::{json, Map, Value as Json};

use crate::layout::{list, text};
use crate::sources::source;
use crate::summary::summary;
use crate::texts::number;

/// What `format` is in every document.
const FORMAT: &str = "modlens report";

/// It grows when a reader of the former version could not read the document.
const VERSION: u32 = 1;

/// Blocks of a frame that are shown; a response of 125 registers would be a page by itself.
const MAX_PIECES: usize = 24;

/// What a document is made of.
pub struct Parts<'a> {
    /// Doctor, statistics and overview, as the core counts them.
    pub core: Json,
    /// What was reported of the recordings, or of the ports of a tap: `name`, `format` (empty for one that was skipped),
    /// `confidence`, `reason`, `forced`, and `details` of the reader. The last one of each name counts.
    pub statuses: &'a [Json],
    /// The table of functions that decodes the examples.
    pub functions: &'a Functions,
    /// The name of the plant or bus; else one is made of the names of buses or files.
    pub title: Option<&'a str>,
}

/// The document (docs/stats.schema.json describes it).
pub fn document(parts: Parts<'_>) -> Json {
    let Parts { mut core, statuses, functions, title } = parts;
    let statistics = core["statistics"].take();
    let mut overview = core["overview"].take();
    if let Some(buses) = overview["buses"].as_array_mut() {
        buses.retain(|bus| !bus.is_null());
    }
    let sources: Vec<Json> = last_of_each(statuses).map(|status| source(status, &statistics, &overview)).collect();
    let summary = summary(&sources, &statistics, &overview, title);
    let names = names(&statistics, &overview, functions);
    for example in overview["examples"].as_array_mut().into_iter().flatten() {
        example["frames"] = frames(example, functions);
    }
    let mut document = json!({
        "format": FORMAT,
        "version": VERSION,
        "program": concat!("modlens ", env!("CARGO_PKG_VERSION")),
        "summary": summary,
        "sources": sources,
        "doctor": null,
        "findings": findings(&statistics),
        "statistics": null,
        "overview": null,
        "functions": names,
    });
    // These are large: the macro would copy them.
    document["doctor"] = core["doctor"].take();
    document["statistics"] = statistics;
    document["overview"] = overview;
    document
}

/// The last that was reported of each source, in the order of their first ones: at its end, what was not read is known.
fn last_of_each(statuses: &[Json]) -> impl Iterator<Item = &Json> {
    let mut found: Vec<&Json> = Vec::new();
    for status in statuses {
        match found.iter_mut().find(|one| one["name"] == status["name"]) {
            Some(former) => *former = status,
            None => found.push(status),
        }
    }
    found.into_iter()
}

/// The names of the functions that occurred, by code.
fn names(statistics: &Json, overview: &Json, functions: &Functions) -> Map<String, Json> {
    let units = list(&statistics["buses"]).iter().flat_map(|bus| list(&bus["units"]));
    let rows = units.chain(list(&overview["examples"]));
    let mut codes: Vec<u8> = rows.filter_map(|row| u8::try_from(row["function"].as_u64()?).ok()).collect();
    codes.sort_unstable();
    codes.dedup();
    codes.into_iter().map(|code| (code.to_string(), functions.name(code).unwrap_or("unknown").into())).collect()
}

/// The findings that occurred, errors first, then the most frequent.
fn findings(statistics: &Json) -> Vec<Json> {
    let counts = statistics["findings"].as_object().into_iter().flatten();
    let mut found: Vec<(Finding, &Json)> = counts.filter_map(|(code, count)| Some((Finding::from_code(code)?, count))).collect();
    let rank = |finding: Finding| match finding.doc().severity {
        Severity::Error => 0,
        Severity::Warning => 1,
        Severity::Info => 2,
    };
    found.sort_by(|(one, count), (other, others)| rank(*one).cmp(&rank(*other)).then(number(others).total_cmp(&number(count))));
    let row = |(finding, count): (Finding, &Json)| {
        let doc = finding.doc();
        json!({"code": doc.code, "severity": doc.severity.text(), "count": count, "title": doc.title, "advice": doc.advice})
    };
    found.into_iter().map(row).collect()
}

/// The frames of an example with their blocks: bytes and what they mean.
fn frames(example: &Json, functions: &Functions) -> Json {
    let Some(mode) = [Mode::Rtu, Mode::Ascii, Mode::Tcp].into_iter().find(|mode| example["mode"] == mode.text()) else {
        return json!([]);
    };
    let found = |key: &str, damaged: Status| {
        let mut bytes = Vec::new();
        decode_pairs(text(&example[key]).as_bytes(), &mut bytes);
        let has_checksum = has_checksum(&bytes, mode, example["status"] != damaged.text());
        (bytes, has_checksum)
    };
    let (request, response) = (found("request_hex", Status::BadRequest), found("response_hex", Status::BadResponse));
    let answered = pdu_of(&request.0, mode, request.1);
    let frame = |title: &str, direction: Direction, (frame, has_checksum): &(Vec<u8>, bool)| {
        let body = Body { functions, direction, request: answered.as_deref() };
        let pieces = annotate(frame, Wrapping::Frame { mode, has_checksum: *has_checksum }, body);
        (!frame.is_empty()).then(|| json!({"title": title, "pieces": shortened(&pieces)}))
    };
    let both = [frame("request", Direction::Request, &request), frame("response", Direction::Response, &response)];
    both.into_iter().flatten().collect()
}

/// Offset, bytes, field, value, meaning, whether all is well; the middle of many is left out.
fn shortened(pieces: &[Piece]) -> Vec<Json> {
    let row =
        |one: &Piece| json!([one.offset, spaced_hex(&one.bytes), one.name, one.value, one.meaning.text, one.meaning.is_valid]);
    if pieces.len() <= MAX_PIECES {
        return pieces.iter().map(row).collect();
    }
    let (first, rest) = pieces.split_at(MAX_PIECES / 2);
    let (middle, last) = rest.split_at(rest.len() - MAX_PIECES / 2);
    let between = json!([middle[0].offset, "", format!("{} more fields", middle.len()), "", "", true]);
    first.iter().map(row).chain([between]).chain(last.iter().map(row)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Request and response of the application protocol's section 6.3, with the checksum and without it.
    #[test]
    fn sound_frames_of_a_recording_without_checksums_are_whole() {
        let pairs = [("1103006B0003", "110306022B00000064"), ("1103006B00037687", "110306022B00000064C8BA")];
        for (request, response) in pairs {
            let example = json!({"mode": "rtu", "status": "ok", "request_hex": request, "response_hex": response});
            let frames = frames(&example, Functions::embedded());
            let pieces = || list(&frames).iter().flat_map(|frame| list(&frame["pieces"]));
            assert!(pieces().all(|piece| piece[5] == true), "{frames}");
            assert!(pieces().any(|piece| piece[4] == "400110: u16 100, s16 100, 0x0064"), "{frames}");
        }
        let damaged = json!({"mode": "rtu", "status": "bad_request", "request_hex": "1103006B00037688"});
        assert_eq!(frames(&damaged, Functions::embedded())[0]["pieces"][4][2], "checksum");
    }
}
