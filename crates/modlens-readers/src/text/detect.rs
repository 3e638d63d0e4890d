//! Which format are these bytes? Syntax and checksum together; raw bytes are what no text format fits.

use std::cmp::Reverse;
use std::sync::Arc;

use crate::text::clock::ClockSettings;
use crate::text::dialect::{Dialect, Dialects};
use crate::text::notation::{Marks, Notation};
use crate::text::{evidence, suspicion, Reader};

/// A guess: format name, confidence from 0 to 1, reason.
pub type Guess = (String, f64, String);

/// Below this the bytes of a text prove nothing.
pub const UNPROVED: f64 = 0.2;

/// A row that says more than another may explain so much less.
const NEARLY: f64 = 0.9;

/// How well rows read a text.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    records: u64,
    bytes: usize,
    /// In frames with a right checksum, or without checksum but of a right layout.
    good: usize,
    unparsed: u64,
}

impl Score {
    fn purity(self) -> f64 {
        self.good as f64 / self.bytes.max(1) as f64
    }

    fn worth(self) -> f64 {
        self.good as f64 * self.purity()
    }
}

/// Guesses from the first bytes of a file and its name, best first; never empty.
///
/// A format of text may be several rows joined by `+`: the first that fits a line reads it.
pub fn detect(sample: &[u8], name: &str, dialects: &Dialects) -> Vec<Guess> {
    if let Some(kind) = crate::pcap::signature(sample) {
        return vec![(kind.into(), 1.0, String::from("by its first bytes"))];
    }
    if is_sigrok(sample) {
        return vec![("sigrok".into(), 1.0, String::from("a zip of samples"))];
    }
    if crate::logic::is_table(sample) {
        return vec![("saleae-digital".into(), 1.0, String::from("times, and levels of channels"))];
    }
    let suffix = name.rsplit('.').next().unwrap_or("").to_ascii_lowercase();
    let control = sample.iter().filter(|b| **b < 0x20 && !matches!(b, b'\n' | b'\r' | b'\t' | 0x0B | 0x0C | 0x1B)).count();
    if sample.is_empty() || control > 0 {
        let reason = format!("{control} of {} bytes are control characters: no text", sample.len());
        let confidence = if matches!(suffix.as_str(), "bin" | "raw" | "dat") { 1.0 } else { 0.9 };
        return vec![("raw".into(), confidence, reason)];
    }
    let mut guesses = Vec::new();
    if modbus_ascii(sample) {
        guesses.push(("raw".into(), 0.95, String::from("colon and hex digits: Modbus ASCII as it was on the line")));
    }
    guesses.extend(text_guess(sample, dialects));
    guesses.push(("raw".into(), 0.1, String::from("any bytes can be raw")));
    guesses
}

/// Whether this is a session of sigrok: a zip whose first file says its version, or what was sampled.
fn is_sigrok(sample: &[u8]) -> bool {
    let name = |length: usize| sample.get(30..30 + length);
    sample.starts_with(b"PK\x03\x04") && (name(7) == Some(b"version") || name(8) == Some(b"metadata"))
}

fn text_guess(sample: &[u8], dialects: &Dialects) -> Option<Guess> {
    // The sample may end inside a line.
    let text = sample.iter().rposition(|&b| b == b'\n').map_or(sample, |end| &sample[..=end]);
    let mut scored: Vec<(Arc<Dialect>, Score)> = dialects
        .rows()
        .filter(|row| row.possible(text))
        .map(|row| (Arc::clone(row), score(std::slice::from_ref(row), text)))
        .filter(|(_, score)| score.records > 0)
        .collect();
    let best = scored.iter().map(|(_, score)| score.worth()).fold(0.0, f64::max);
    if best == 0.0 {
        if let Some((row, score)) = scored.iter().find(|(row, score)| row.certain && score.unparsed == 0) {
            return Some((row.name.clone(), 0.9, format!("{} records in its syntax", score.records)));
        }
        return unproved(&scored, text);
    }
    // The most specific of those that explain nearly as much as the best.
    let chosen = (0..scored.len()).filter(|&i| scored[i].1.worth() >= NEARLY * best).max_by_key(|&i| {
        let (row, score) = &scored[i];
        let fixed = if row.generic { 0 } else { row.fixed() };
        (!row.generic, !row.no_checksum, Reverse(score.unparsed), fixed, Reverse(i))
    })?;
    let (first, mut reached) = scored.remove(chosen);
    let mut rows = vec![first];
    // What it leaves over may be another dialect.
    scored.sort_by(|a, b| (a.0.generic, b.1.good).cmp(&(b.0.generic, a.1.good)));
    for (row, alone) in scored {
        if alone.good == 0 || reached.unparsed == 0 {
            continue;
        }
        let with = score(&[&rows[..], &[Arc::clone(&row)]].concat(), text);
        if with.good > reached.good && with.purity() >= 0.5 * reached.purity() {
            rows.push(row);
            reached = with;
        }
    }
    let names: Vec<&str> = rows.iter().map(|row| row.name.as_str()).collect();
    let proof =
        if rows[0].no_checksum { "have the layout of frames" } else { "are in frames that their checksum or length proves" };
    let confidence = if rows[0].no_checksum { 0.5 + 0.3 * reached.purity() } else { 0.5 + 0.5 * reached.purity() };
    let reason = format!("{} records, {:.0} % of their bytes {proof}", reached.records, 100.0 * reached.purity());
    Some((names.join("+"), confidence, reason))
}

/// Lines with bytes, none of which closes a checksum.
fn unproved(scored: &[(Arc<Dialect>, Score)], text: &[u8]) -> Option<Guess> {
    let why = suspicion::name(&bursts(text)).map_or_else(String::new, |kind| format!("; {kind}"));
    match scored.iter().max_by_key(|(row, score)| (score.bytes, !row.generic)) {
        Some((row, score)) => {
            let reason = format!("no checksum closes in {} byte strings{why}", score.records);
            Some((row.name.clone(), UNPROVED / 2.0, reason))
        }
        None if why.is_empty() => None,
        None => Some(("raw".into(), UNPROVED / 2.0, format!("no dialect that is known{why}"))),
    }
}

/// Runs of bytes in the lines of a text, whatever writes it.
fn bursts(text: &[u8]) -> Vec<Vec<u8>> {
    let run = |line: &[u8]| {
        let starts = (0..line.len()).filter(|&at| at == 0 || matches!(line[at - 1], b' ' | b'\t' | b':' | b'|'));
        starts.take(100).find_map(|at| {
            let (mut bytes, mut marks) = (Vec::new(), Marks::default());
            Notation::Hex.read(&line[at..], None, &mut bytes, &mut marks);
            (bytes.len() >= 4).then_some(bytes)
        })
    };
    text.split(|&b| b == b'\n').take(500).filter_map(run).collect()
}

fn score(rows: &[Arc<Dialect>], text: &[u8]) -> Score {
    let mut reader = Reader::new(rows.to_vec(), None, Arc::<ClockSettings>::default());
    reader.look_ahead(text);
    reader.push(text);
    let mut score = Score::default();
    let mut burst: Vec<u8> = Vec::new();
    while let Some((record, bytes)) = reader.next(true) {
        if record.record || record.hole || burst.len() > 1 << 14 {
            score.good += evidence::proven_bytes(&burst);
            burst.clear();
        }
        score.bytes += bytes.len();
        if record.no_checksum {
            score.good += if evidence::has_frame_layout(bytes) { bytes.len() } else { 0 };
        } else {
            burst.extend_from_slice(bytes);
        }
    }
    score.good += evidence::proven_bytes(&burst);
    if !reader.announced() {
        return Score::default();
    }
    Score { records: reader.records(), unparsed: reader.unparsed, ..score }
}

/// Whether half of the lines are a colon and bytes in hex.
fn modbus_ascii(sample: &[u8]) -> bool {
    let lines = || sample.split(|&b| b == b'\n' || b == b'\r').filter(|line| !line.is_empty());
    let frames = lines()
        .filter(|line| line[0] == b':' && line.len() >= 9 && line.len() % 2 == 1 && line[1..].iter().all(u8::is_ascii_hexdigit));
    2 * frames.count() >= lines().count().max(1)
}
