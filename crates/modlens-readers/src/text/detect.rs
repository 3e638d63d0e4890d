//! Detects the format of a file from its first bytes, by syntax and by checksums together. A file that fits no text format
//! counts as raw bytes.

use std::cell::RefCell;
use std::cmp::Reverse;
use std::sync::Arc;

use crate::text::clean::clean;
use crate::text::dialect::{Dialect, Dialects};
use crate::text::header_run::HeaderRun;
use crate::text::notation::{Notation, NotationFlags};
use crate::text::proved::hex_bytes;
use crate::text::reader::Marks;
use crate::text::{foreign_protocols, foreign_texts, frame_evidence, oddities, Reader};

/// A format that a file may have: its name, the confidence from 0 to 1, and the reason.
pub type FormatGuess = (String, f64, String);

/// A guess with less confidence than this is not confirmed by any checksum.
pub const UNPROVED: f64 = 0.2;

/// A more specific row is preferred to the one with the best score if its own score is at least this share of it.
const MIN_SHARE_OF_BEST: f64 = 0.9;

/// Rows that read at most this share of the bytes which checksums prove anywhere in the text are the wrong ones.
const MAX_SHARE_OF_PROVED: f64 = 0.7;

/// A text without a known dialect holds at most so many bytes of hex for each byte in a frame.
const MAX_HEX_PER_PROVED: usize = 100;

/// The same share where the best row is one that any program may write, and the more specific row reads fewer other bytes.
const MIN_SHARE_OF_GENERIC: f64 = 0.5;

/// The shortest frame of Modbus ASCII: unit, function code and LRC.
const MIN_ASCII_BYTES: usize = 3;

/// A text has at most one control character in so many bytes: a bell, an end-of-file mark, noise at a console's start.
const MAX_STRAY_PER: usize = 50;

/// How well a set of rows reads a text.
#[derive(Clone, Copy, Debug, Default)]
struct RowScore {
    records: u64,
    bytes: usize,
    /// Bytes in frames with a valid checksum or length, or with a valid layout where the program prints no checksums.
    proven_bytes: usize,
    /// Of these, bytes without a checksum of their own, which only the exchanges around them prove.
    unchecked_bytes: usize,
    /// Bytes in frames that the rows know to have been printed before.
    copied_bytes: usize,
    /// How many requests without checksum are followed by a response that fits, of how many.
    exchanges: (usize, usize),
    /// Lines that none of the rows could read.
    unparsed: u64,
}

impl RowScore {
    /// The share of the bytes that are proven.
    fn purity(self) -> f64 {
        self.proven_bytes as f64 / self.bytes.max(1) as f64
    }

    /// The bytes that checksums or lengths prove.
    fn checked_bytes(self) -> usize {
        self.proven_bytes - self.unchecked_bytes
    }

    /// The figure by which rows are compared: it favours rows that find many frames and few other bytes.
    fn worth(self) -> f64 {
        self.proven_bytes as f64 * self.purity()
    }
}

/// Guesses the format of a file from its first bytes and its name. The best guess comes first, and there is always one.
///
/// A text format may consist of several rows joined by `+`; the first of them that fits a line reads it. The dialects are asked for
/// only where the sample may be text: to read their table takes longer than anything else here.
pub fn detect<'a>(sample: &[u8], name: &str, dialects: impl Fn() -> &'a Dialects) -> Vec<FormatGuess> {
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
    // A file system that lost power leaves a log with a tail of zeros.
    let text = sample.iter().rposition(|&b| b != 0).map_or(&sample[..0], |last| &sample[..=last]);
    let control_chars = text.iter().filter(|b| **b < 0x20 && !matches!(b, b'\n' | b'\r' | b'\t' | 0x0B | 0x0C | 0x1B)).count();
    let has_strays = control_chars > 0 || text.len() < sample.len();
    if has_strays && control_chars * MAX_STRAY_PER <= text.len() {
        // A few stray bytes do not make a log binary, if checksums prove what its lines say.
        if let Some(guess) = text_guess(text, dialects()).filter(|(_, confidence, _)| *confidence > UNPROVED) {
            return vec![guess, ("raw".into(), 0.1, String::from("any bytes can be raw"))];
        }
    }
    let control_chars = control_chars + (sample.len() - text.len());
    if sample.is_empty() || control_chars > 0 {
        let reason = format!("{control_chars} of {} bytes are control characters: not text", sample.len());
        let confidence = if matches!(suffix.as_str(), "bin" | "raw" | "dat") { 1.0 } else { 0.9 };
        return vec![("raw".into(), confidence, reason)];
    }
    if foreign_texts::is_intel_hex(sample) {
        let reason = format!("no known dialect; it looks like {}", foreign_texts::INTEL_HEX);
        return vec![("raw".into(), UNPROVED / 2.0, reason)];
    }
    let mut guesses = Vec::new();
    if is_modbus_ascii(sample) {
        guesses.push(("raw".into(), 0.95, String::from("colon and hex digits: Modbus ASCII as it was on the line")));
    }
    guesses.extend(text_guess(sample, dialects()));
    let reason = if guesses.is_empty() { unproved_hex(sample) } else { None };
    guesses.push(("raw".into(), 0.1, reason.unwrap_or_else(|| String::from("any bytes can be raw"))));
    guesses
}

/// Whether this is a session file of sigrok: a zip archive whose first member is named `version` or `metadata`.
fn is_sigrok(sample: &[u8]) -> bool {
    let name = |length: usize| sample.get(30..30 + length);
    sample.starts_with(b"PK\x03\x04") && (name(7) == Some(b"version") || name(8) == Some(b"metadata"))
}

/// Chooses the rows that read a text best: the most specific row among the best, and after it each further row that finds
/// frames in lines which those before cannot read.
fn text_guess(sample: &[u8], dialects: &Dialects) -> Option<FormatGuess> {
    // The sample may end inside a line.
    let text = sample.iter().rposition(|&b| b == b'\n').map_or(sample, |end| &sample[..=end]);
    let marks = &RefCell::default();
    let mut scored: Vec<(Arc<Dialect>, RowScore)> = dialects
        .rows()
        .filter(|row| !row.is_proved && row.may_match(text))
        .map(|row| (Arc::clone(row), score(std::slice::from_ref(row), text, marks)))
        .filter(|(_, score)| score.records > 0)
        .collect();
    // What checksums prove anywhere in the text takes longer than all else, and is not asked for where a dialect reads it all.
    let proved = || {
        let row = dialects.proved_row()?;
        let found = score(std::slice::from_ref(row), text, marks);
        is_enough(found, text).then(|| (Arc::clone(row), found))
    };
    let best = scored.iter().map(|(_, score)| score.worth()).fold(0.0, f64::max);
    if best == 0.0 {
        let is_certain = |row: &Dialect, score: &RowScore| row.has_unique_syntax && score.unparsed < score.records;
        let is_all_certain = scored.iter().any(|(row, score)| is_certain(row, score) && score.unparsed == 0);
        if let Some((row, score)) = (!is_all_certain).then(proved).flatten() {
            return Some(guess(&[row], score));
        }
        if let Some((row, score)) = scored.iter().find(|(row, score)| is_certain(row, score)) {
            return Some((row.name.clone(), 0.9, format!("{} records in its syntax", score.records)));
        }
        return unproved(&scored, text);
    }
    // Choose the most specific of the rows that score nearly as well as the best. A row that any program may write scores well
    // by reading what a more specific row knows to be a copy.
    let (best_row, best_score) = scored.iter().max_by(|a, b| a.1.worth().total_cmp(&b.1.worth()))?;
    let (best_is_generic, best_purity) = (best_row.generic, best_score.purity());
    let is_good = |(row, score): &(Arc<Dialect>, RowScore)| {
        let is_purer = best_is_generic && !row.generic && score.purity() >= best_purity;
        let share = if is_purer { MIN_SHARE_OF_GENERIC } else { MIN_SHARE_OF_BEST };
        // What a master receives on a faulty line is no frame; a program's own syntax is known by its lines all the same.
        let is_complete = !row.generic
            && score.unparsed <= best_score.unparsed
            && score.bytes >= best_score.bytes
            && score.proven_bytes >= best_score.proven_bytes;
        score.worth() >= share * best || is_complete
    };
    let chosen = (0..scored.len()).filter(|&i| is_good(&scored[i])).max_by_key(|&i| {
        let (row, score) = &scored[i];
        let fixed_chars = if row.generic { 0 } else { row.fixed_chars() };
        (!row.generic, !row.no_checksum, Reverse(score.unparsed), fixed_chars, Reverse(i))
    })?;
    let (first, mut total) = scored.remove(chosen);
    let mut rows = vec![first];
    // Lines that it cannot read may be of another dialect.
    scored.sort_by(|a, b| (a.0.generic, b.1.proven_bytes).cmp(&(b.0.generic, a.1.proven_bytes)));
    for (row, own_score) in scored {
        if own_score.proven_bytes == 0 || total.unparsed == 0 {
            continue;
        }
        let extended = score(&[&rows[..], &[Arc::clone(&row)]].concat(), text, marks);
        // What a program's own row proves may have been printed in another one before; the damaged answers beside it were not.
        let reads_more = !row.generic && extended.bytes > total.bytes && extended.unparsed < total.unparsed;
        if reads_more || (extended.proven_bytes > total.proven_bytes && extended.purity() >= 0.5 * total.purity()) {
            rows.push(row);
            total = extended;
        }
    }
    // What no row reads is read where checksums prove it. Rows that lack most of this were the wrong ones.
    if let Some((row, alone)) = (total.unparsed > 0).then(proved).flatten() {
        let extended = score(&[&rows[..], &[Arc::clone(&row)]].concat(), text, marks);
        let read_bytes = extended.proven_bytes + extended.copied_bytes;
        if read_bytes as f64 <= MAX_SHARE_OF_PROVED * alone.checked_bytes() as f64 {
            (rows, total) = (vec![row], alone);
        } else if extended.proven_bytes > total.proven_bytes {
            rows.push(row);
            total = extended;
        }
    }
    Some(guess(&rows, total))
}

/// The guess for rows with their score.
fn guess(rows: &[Arc<Dialect>], score: RowScore) -> FormatGuess {
    let names: Vec<&str> = rows.iter().map(|row| row.name.as_str()).collect();
    let is_unchecked = rows[0].no_checksum || score.unchecked_bytes > score.checked_bytes();
    let proof = match score.exchanges {
        _ if !is_unchecked => "are in frames confirmed by checksum or length".to_owned(),
        (0, _) => "have the layout of frames".to_owned(),
        (fitting, all) => format!(
            "have the layout of frames without checksums: {fitting} of {all} request{} answered by the unit, the function and \
             the length that fit",
            if all == 1 { " is" } else { "s are" }
        ),
    };
    let confidence = if is_unchecked { 0.5 + 0.3 * score.purity() } else { 0.5 + 0.5 * score.purity() };
    let reason =
        format!("{} record{}, {:.0} % of their bytes {proof}", score.records, plural(score.records), 100.0 * score.purity());
    (names.join("+"), confidence, reason)
}

/// Whether frames found among other text are more than chance: a checksum fits at one place in 65,536.
fn is_enough(score: RowScore, text: &[u8]) -> bool {
    let hex: usize = text.split(|&b| b == b'\n').map(hex_bytes).sum();
    score.proven_bytes > 0 && score.proven_bytes * MAX_HEX_PER_PROVED >= hex
}

/// The ending of a noun after this number.
fn plural(number: u64) -> &'static str {
    if number == 1 {
        ""
    } else {
        "s"
    }
}

/// The guess for a text in which no checksum is valid: the row that finds most bytes, and the other protocol that the
/// bytes look like, if any.
fn unproved(scored: &[(Arc<Dialect>, RowScore)], text: &[u8]) -> Option<FormatGuess> {
    // Bytes that are text may be a frame in letters.
    let odd = oddities::named(text);
    let of_bytes =
        || foreign_protocols::name(&bursts(text)).filter(|kind| odd.is_none() || !kind.contains(foreign_protocols::PLAIN_TEXT));
    let foreign = foreign_texts::of_can(text).or_else(of_bytes);
    let why = foreign.or(odd).map_or_else(String::new, |kind| format!("; {kind}"));
    match scored.iter().max_by_key(|(row, score)| (score.bytes, !row.generic, row.is_plain_hex)) {
        Some((row, score)) => {
            let left =
                hex_left(text).map_or_else(String::new, |(lines, bytes, _)| format!("; {lines} {bytes} bytes of hex or more"));
            let reason = format!("no valid checksum in {} byte string{}{why}{left}", score.records, plural(score.records));
            Some((row.name.clone(), UNPROVED / 2.0, reason))
        }
        None if why.is_empty() => None,
        None => {
            let left = unproved_hex(text).map_or_else(String::new, |left| format!("; {left}"));
            Some(("raw".into(), UNPROVED / 2.0, format!("no known dialect{why}{left}")))
        }
    }
}

/// What hex a text holds that nothing proves, in words; `None` if there is none.
fn unproved_hex(text: &[u8]) -> Option<String> {
    let (lines, bytes, first) = hex_left(text)?;
    Some(format!("{lines} {bytes} bytes of hex that no checksum proves, the first is line {first}"))
}

/// How many lines hold hex, in words, how many bytes, but for short runs, and which is the first.
fn hex_left(text: &[u8]) -> Option<(String, usize, usize)> {
    let bytes = |line: &[u8]| hex_bytes(clean(line, false, false, &mut Vec::new()));
    let found: Vec<(usize, usize)> = text.split(|&b| b == b'\n').map(bytes).zip(1..).filter(|(bytes, _)| *bytes > 0).collect();
    let lines = if found.len() == 1 { String::from("1 line holds") } else { format!("{} lines hold", found.len()) };
    let (_, first) = *found.first()?;
    Some((lines, found.iter().map(|(bytes, _)| bytes).sum(), first))
}

/// The first run of at least four hex bytes of each line, without regard to any dialect.
fn bursts(text: &[u8]) -> Vec<Vec<u8>> {
    let run = |line: &[u8]| {
        let starts = (0..line.len()).filter(|&at| at == 0 || matches!(line[at - 1], b' ' | b'\t' | b':' | b'|'));
        starts.take(100).find_map(|at| {
            let (mut bytes, mut flags) = (Vec::new(), NotationFlags::default());
            Notation::Hex.read(&line[at..], None, &mut bytes, &mut flags);
            (bytes.len() >= 4).then_some(bytes)
        })
    };
    text.split(|&b| b == b'\n').take(500).filter_map(run).collect()
}

/// Reads the text with these rows and counts how many of the bytes are proven to be frames. Rows with header lines of which
/// the text has none score zero, and so do rows of dumps where most offsets do not go on from the line before: what stands
/// there is something else, such as a time in seconds.
fn score(rows: &[Arc<Dialect>], text: &[u8], marks: &RefCell<Vec<Marks>>) -> RowScore {
    let mut reader = Reader::to_count(rows.to_vec());
    reader.prepare(text, &mut marks.borrow_mut());
    reader.push(text);
    let mut score = RowScore::default();
    let mut burst: Vec<u8> = Vec::new();
    let (mut jumps, mut headers) = (0, HeaderRun::default());
    while let Some((record, bytes)) = reader.next(true) {
        jumps += u64::from(record.follows_loss);
        if record.starts_record || record.follows_loss || burst.len() > 1 << 14 {
            score.proven_bytes += frame_evidence::proven_bytes(&burst);
            burst.clear();
        }
        score.bytes += bytes.len();
        headers.add(bytes);
        if record.lacks_checksum {
            let bytes = if frame_evidence::has_frame_layout(bytes) { bytes.len() } else { 0 };
            score.proven_bytes += bytes;
            score.unchecked_bytes += bytes;
        } else {
            burst.extend_from_slice(bytes);
        }
    }
    score.proven_bytes = headers.proven_bytes().max(score.proven_bytes + frame_evidence::proven_bytes(&burst));
    if !reader.has_announced_bytes() || 2 * jumps > reader.records() {
        return RowScore::default();
    }
    let copied_bytes = reader.skipped().iter().map(|(_, bytes, _)| frame_evidence::proven_bytes(bytes)).sum();
    let (records, unparsed) = (reader.records(), reader.unread_lines().count);
    RowScore { records, unparsed, copied_bytes, exchanges: reader.exchanges(), ..score }
}

/// Whether at least half of the lines are a colon and an even number of hex digits, as in a Modbus ASCII frame.
fn is_modbus_ascii(sample: &[u8]) -> bool {
    let lines = || sample.split(|&b| b == b'\n' || b == b'\r').filter(|line| !line.is_empty());
    let frames = lines().filter(|line| {
        line[0] == b':' && line.len() > 2 * MIN_ASCII_BYTES && line.len() % 2 == 1 && line[1..].iter().all(u8::is_ascii_hexdigit)
    });
    2 * frames.count() >= lines().count().max(1)
}
