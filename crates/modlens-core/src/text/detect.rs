//! Which format are these bytes? Syntax first; raw bytes are what no text format fits.

use crate::text::{Format, Reader};

/// A guess: format name, confidence from 0 to 1, reason.
pub type Guess = (&'static str, f64, String);

/// Guesses from the first bytes of a file and its name, best first; never empty.
pub fn detect(sample: &[u8], name: &str) -> Vec<Guess> {
    if let Some(kind) = crate::pcap::signature(sample) {
        return vec![(kind, 1.0, String::from("by its first bytes"))];
    }
    if is_sigrok(sample) {
        return vec![("sigrok", 1.0, String::from("a zip of samples"))];
    }
    let mut guesses = Vec::new();
    let suffix = name.rsplit('.').next().unwrap_or("").to_ascii_lowercase();
    let control = sample.iter().filter(|b| **b < 0x20 && !matches!(b, b'\n' | b'\r' | b'\t' | 0x1B)).count();
    let text = !sample.is_empty() && control == 0;
    if text {
        for (format, name, _) in Format::ALL {
            if let Some((share, lines)) = share_of_lines(*format, sample) {
                guesses.push((*name, share, format!("{:.0} % of {lines} lines are {name}", share * 100.0)));
            }
        }
    }
    // Hex lines are the loosest syntax: any other text format that fits as well is meant.
    guesses.sort_by(|a, b| b.1.total_cmp(&a.1).then((a.0 == "hex").cmp(&(b.0 == "hex"))));
    if text && modbus_ascii(sample) {
        guesses.insert(0, ("raw", 0.95, String::from("colon and hex digits: Modbus ASCII as it was on the line")));
    } else if !text {
        let reason = format!("{control} of {} bytes are control characters: no text", sample.len());
        let confidence = if matches!(suffix.as_str(), "bin" | "raw" | "dat") { 1.0 } else { 0.9 };
        guesses.insert(0, ("raw", confidence, reason));
    } else {
        guesses.push(("raw", 0.1, String::from("any bytes can be raw")));
    }
    guesses
}

/// Whether this is a session of sigrok: a zip whose first file says its version, or what was sampled.
fn is_sigrok(sample: &[u8]) -> bool {
    let name = |length: usize| sample.get(30..30 + length);
    sample.starts_with(b"PK\x03\x04") && (name(7) == Some(b"version") || name(8) == Some(b"metadata"))
}

/// The share of the lines with content that the format understands, and their number.
fn share_of_lines(format: Format, sample: &[u8]) -> Option<(f64, u64)> {
    let mut reader = Reader::new(format);
    // The sample may end inside a line.
    let whole = sample.iter().rposition(|&b| b == b'\n').map_or(sample, |end| &sample[..=end]);
    reader.push(whole);
    while reader.next(true).is_some() {}
    let lines = reader.records + reader.unparsed;
    (reader.records > 0).then(|| (reader.records as f64 / lines as f64, lines))
}

/// Whether half of the lines are a colon and bytes in hex.
fn modbus_ascii(sample: &[u8]) -> bool {
    let lines = || sample.split(|&b| b == b'\n' || b == b'\r').filter(|line| !line.is_empty());
    let frames = lines()
        .filter(|line| line[0] == b':' && line.len() >= 9 && line.len() % 2 == 1 && line[1..].iter().all(u8::is_ascii_hexdigit));
    2 * frames.count() >= lines().count().max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_detected_as_themselves() {
        for (_, name, sample) in Format::ALL {
            assert_eq!(detect(sample.as_bytes(), "x.log")[0].0, *name, "{sample}");
            assert_eq!(detect(format!("{sample}\n").repeat(50).as_bytes(), "x.log")[0].0, *name);
        }
        assert_eq!(detect(&[0x11, 3, 0, 0x6B, 0, 3, 0x76, 0x87], "x")[0].0, "raw");
        assert_eq!(detect(b":1103006B00037E\r\n", "x")[0].0, "raw");
        assert_eq!(detect(b"", "x")[0].0, "raw");
        assert_eq!(detect(b"010300000001840a 0103020007f986\n", "x")[0].0, "hex");
    }
}
