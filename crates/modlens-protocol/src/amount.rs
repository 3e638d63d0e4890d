//! Durations and sizes as people write them on a command line: `500ms`, `1h30m`, `64MB`.

use crate::Ns;

/// The longest duration that can be meant, ten years.
pub const MAX_DURATION_NS: Ns = 10 * 365 * 24 * 3600 * 1_000_000_000;

/// The units of time in nanoseconds.
const TIMES: [(&str, f64); 7] =
    [("us", 1e3), ("ms", 1e6), ("s", 1e9), ("min", 60e9), ("m", 60e9), ("h", 3600e9), ("d", 86_400e9)];
/// The units of size in bytes.
const SIZES: [(&str, f64); 6] =
    [("kb", 1e3), ("mb", 1e6), ("gb", 1e9), ("kib", 1024.0), ("mib", 1_048_576.0), ("gib", 1_073_741_824.0)];

/// A duration. Parts may follow one another, the larger units first; a number without a unit is in seconds where it stands
/// alone, for in `1h30` it could be anything. `None` for anything else, and for nothing and more than ten years.
///
/// ```
/// use modlens_protocol::amount::duration;
/// assert_eq!(duration("500ms"), Some(500_000_000));
/// assert_eq!(duration("1h30m"), Some(5_400_000_000_000));
/// assert_eq!(duration("1h30"), None);
/// ```
pub fn duration(text: &str) -> Option<Ns> {
    let text = text.trim().to_ascii_lowercase();
    let mut parts = Vec::new();
    let mut rest = text.as_str();
    while !rest.is_empty() {
        let (number, unit, behind) = part(rest)?;
        parts.push((number, unit));
        rest = behind;
    }
    let (mut sum, mut before) = (0.0, f64::INFINITY);
    for (number, unit) in &parts {
        let unit = if unit.is_empty() && parts.len() == 1 { "s" } else { unit };
        let scale = TIMES.iter().find(|one| one.0 == unit)?.1;
        if scale >= before {
            return None;
        }
        (sum, before) = (sum + number * scale, scale);
    }
    (sum > 0.0 && sum < MAX_DURATION_NS as f64).then(|| sum.round_ties_even() as Ns)
}

/// A size in bytes: a number with a unit.
///
/// ```
/// use modlens_protocol::amount::size;
/// assert_eq!((size("64MB"), size("1.5 KiB"), size("64")), (Some(64_000_000), Some(1536), None));
/// ```
pub fn size(text: &str) -> Option<u64> {
    let text = text.trim().to_ascii_lowercase();
    let (number, unit, behind) = part(&text)?;
    let scale = SIZES.iter().find(|one| one.0 == unit)?.1;
    (behind.is_empty() && number > 0.0).then(|| (number * scale).round_ties_even() as u64)
}

/// A number of things, above 0.
///
/// ```
/// use modlens_protocol::amount::count;
/// assert_eq!((count("168"), count("0"), count("2GB")), (Some(168), None, None));
/// ```
pub fn count(text: &str) -> Option<u64> {
    text.trim().parse().ok().filter(|count| *count > 0)
}

/// The first number with its unit, and what follows them.
fn part(text: &str) -> Option<(f64, &str, &str)> {
    let end = |text: &str, is_inside: fn(char) -> bool| text.find(|one| !is_inside(one)).unwrap_or(text.len());
    let digits = end(text, |one| one.is_ascii_digit());
    let fraction = text[digits..].strip_prefix('.').map_or(0, |behind| 1 + end(behind, |one| one.is_ascii_digit()));
    let (number, behind) = text.split_at(digits + fraction);
    let behind = behind.trim_start();
    let (unit, behind) = behind.split_at(end(behind, |one| one.is_ascii_lowercase()));
    // `5.` and `.5` are numbers; `.` is none.
    Some((number.parse().ok()?, unit, behind.trim_start()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up() {
        let seconds = [
            ("90s", 90.0),
            ("1h 30min", 5400.0),
            ("1.5h", 5400.0),
            ("2d", 172_800.0),
            ("0.3", 0.3),
            ("250us", 0.000_25),
            (" 1H30M ", 5400.0),
            (".5s", 0.5),
            ("5.", 5.0),
        ];
        for (text, expected) in seconds {
            assert_eq!(duration(text), Some((expected * 1e9) as Ns), "{text}");
        }
    }

    #[test]
    fn what_means_nothing_is_refused() {
        for text in ["", "soon", "30m1h", "1h1h", "1m1min", "-5s", "5 parsecs", "0", "1e3s", "99999d", "s", ".", "1.2.3"] {
            assert_eq!(duration(text), None, "{text}");
        }
        for text in ["", "MB", "0MB", "64", "-1MB", "64MBs", "1MB 2KB", "1 TB"] {
            assert_eq!(size(text), None, "{text}");
        }
    }
}
