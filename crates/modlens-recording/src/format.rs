//! Which format a recording has.
//!
//! The readers score the formats. Here it is decided when a score is good enough, and when a format that the user named
//! must be wrong: binary data is not text, and text of a known format is not the bytes of a line.

use modlens_readers::text::detect::{detect, FormatGuess};
use modlens_readers::text::Dialects;

/// Bytes at the beginning of a recording by which its format is detected.
pub const SAMPLE_BYTES: usize = 64 * 1024;

/// The formats that are not text.
pub const BINARY: [&str; 5] = ["raw", "pcap", "pcapng", "sigrok", "saleae-digital"];

/// Confidence (0 to 1) from which on a detected format refuses another one that the user named.
const MIN_CERTAIN: f64 = 0.9;

/// Below this confidence (0 to 1) no format is taken as detected.
const MIN_CONFIDENCE: f64 = 0.2;

/// A text has at most one control character in so many bytes.
const MAX_STRAY_PER: usize = 50;

/// The format of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Its name; names of dialects may be joined by `+`.
    pub format: String,
    /// How sure that is (0 to 1).
    pub confidence: f64,
    /// Why, in words.
    pub reason: String,
    /// Whether the user named it.
    pub forced: bool,
}

/// Why a recording is not read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The user named a format that does not exist; the name of the closest one, if any is close.
    NoSuchFormat(String),
    /// The recording does not fit; why, and what to do, without the name of the recording.
    Unfit(String),
}

/// Chooses the format of a recording that begins with `sample`; `forced` is the format that the user named. The dialects
/// are asked for only where they are needed: to read their table takes longer than all else.
pub fn decide<'a>(
    sample: &[u8],
    name: &str,
    forced: Option<&str>,
    dialects: impl Fn() -> &'a Dialects,
) -> Result<Detection, Refusal> {
    if let Some(forced) = forced {
        check_exists(forced, &dialects)?;
    }
    let guesses = detect(sample, name, &dialects);
    let (best, confidence, reason) = guesses[0].clone();
    match forced {
        Some(forced) => check_forced(sample, forced, &guesses),
        None if confidence < MIN_CONFIDENCE => Err(Refusal::Unfit(refusal(sample, &best, &reason))),
        None => Ok(Detection { format: best, confidence, reason, forced: false }),
    }
}

/// Whether a format is binary.
///
/// ```
/// use modlens_recording::format::is_binary;
/// assert!(is_binary("raw") && !is_binary("pymodbus+hex"));
/// ```
pub fn is_binary(format: &str) -> bool {
    BINARY.contains(&format)
}

/// Whether these bytes can be text: hardly any control characters, and UTF-8 or mostly ASCII. A bell, an end-of-file mark
/// or the zeros after a log that lost power do not make it binary.
///
/// ```
/// use modlens_recording::format::is_text;
/// assert!(is_text(b"12:00 Rx: 01 03") && !is_text(&[1, 3, 0, 0x6B, 0, 3, 0x74, 0x17]));
/// ```
pub fn is_text(sample: &[u8]) -> bool {
    let text = sample.iter().rposition(|&byte| byte != 0).map_or(&sample[..0], |last| &sample[..=last]);
    let high = text.iter().filter(|byte| !byte.is_ascii()).count();
    let is_control = |byte: u8| byte == 0x7F || (byte < 0x20 && !matches!(byte, b'\t' | b'\n' | 0x0B | 0x0C | b'\r' | 0x1B));
    let controls = text.iter().filter(|&&byte| is_control(byte)).count();
    if (!sample.is_empty() && text.is_empty()) || controls * MAX_STRAY_PER > text.len() {
        return false;
    }
    high * 3 <= text.len() || is_utf8(text)
}

/// Whether these bytes are UTF-8; the last character may be cut off.
pub fn is_utf8(text: &[u8]) -> bool {
    std::str::from_utf8(text).map_or_else(|error| error.error_len().is_none(), |_| true)
}

fn check_exists<'a>(forced: &str, dialects: impl Fn() -> &'a Dialects) -> Result<(), Refusal> {
    let is_known = |part: &str| is_binary(part) || dialects().get(part).is_some();
    forced.split('+').find(|part| !is_known(part)).map_or(Ok(()), |part| Err(Refusal::NoSuchFormat(part.to_owned())))
}

/// What is wrong with a format that was named; otherwise the detection.
fn check_forced(sample: &[u8], forced: &str, guesses: &[FormatGuess]) -> Result<Detection, Refusal> {
    let (best, confidence, reason) = &guesses[0];
    let own = guesses.iter().find(|(format, _, _)| format == forced).map_or(0.0, |(_, score, _)| *score);
    if !is_binary(forced) && !is_text(sample) {
        return Err(Refusal::Unfit(format!("binary data, not {forced} text; leave --from out, or use --from raw")));
    }
    if is_binary(forced) && best != forced && *confidence >= MIN_CERTAIN && is_text(sample) {
        return Err(Refusal::Unfit(format!(
            "text ({best}: {reason}), not the bytes of a line; leave --from out, or use --from {best}"
        )));
    }
    Ok(Detection { format: forced.to_owned(), confidence: own, reason: String::from("as named by --from"), forced: true })
}

/// The text for a recording of which no format was detected: why, and what to do.
fn refusal(sample: &[u8], best: &str, reason: &str) -> String {
    if best != "raw" {
        // What the bytes or the words show is what a reader wants to know; which format it looks like comes after it.
        let (unproved, shown) = reason.split_once("; ").unwrap_or((reason, ""));
        let why = if shown.is_empty() {
            format!("no Modbus found: looks like {best}, but {unproved}")
        } else {
            format!("no valid frame was read: {shown}")
        };
        return format!("{why}; use --from {best} to decode it anyway");
    }
    let kind = match is_text(sample) {
        true if reason.contains("hex") || reason.contains(';') => {
            format!("text in an unknown format: {}", reason.strip_prefix("no known dialect; ").unwrap_or(reason))
        }
        true => String::from("text in an unknown format"),
        false => format!("unknown format ({reason})"),
    };
    format!("{kind}; see `modlens formats`, or choose one with --from")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Why a text without a frame is not read.
    fn refused(text: &str) -> String {
        match decide(text.as_bytes(), "x.log", None, Dialects::embedded) {
            Err(Refusal::Unfit(why)) => why,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_refusal_of_a_text_has_the_reason_that_the_readers_found() {
        let reported = refused("[W] Modbus error function code: 0x84 exception: 2\n");
        assert!(reported.contains("a line reports exception 2 (illegal data address)"), "{reported}");
        let unproved = refused("what is it? 11 22 33 44 55 66 77 88\n");
        assert!(unproved.contains("in line 1 the bytes 11 22 33 44 55 66 77 88 are no frame"), "{unproved}");
        assert_eq!(
            refused("nothing to be seen\n"),
            "text in an unknown format; see `modlens formats`, or choose one with --from"
        );
    }
}
