//! Values as text for people.

use std::fmt::Write;

use modlens_protocol::decimal::thousands;
use modlens_protocol::visible::visible;
use serde_json::Value as Json;

/// A number with so many decimals, halves away from 0, thousands by commas.
pub fn fixed(value: f64, decimals: u32) -> String {
    written(value, decimals, true)
}

fn written(value: f64, decimals: u32, group: bool) -> String {
    let scale = 10_f64.powi(decimals as i32);
    let scaled = (value.abs() * scale + 0.5).floor();
    let (whole, rest) = ((scaled / scale).floor(), scaled % scale);
    let sign = if value < 0.0 && scaled > 0.0 { "-" } else { "" };
    // A document from elsewhere may have numbers of more than 64 bits.
    let digits = if group && whole < u64::MAX as f64 { thousands(whole as u64) } else { format!("{whole:.0}") };
    let mut text = format!("{sign}{digits}");
    if decimals > 0 {
        let _ = write!(text, ".{rest:0width$.0}", width = decimals as usize);
    }
    text
}

/// A share in percent; 0 % and 100 % are shown for none and all only.
pub fn percent(share: f64) -> String {
    if share == 0.0 {
        return "0 %".to_owned();
    }
    if (share - 1.0).abs() < f64::EPSILON {
        return "100 %".to_owned();
    }
    let (least, most) = if share > 0.0 && share < 1.0 { (0.1, 99.9) } else { (0.0, f64::INFINITY) };
    format!("{} %", fixed((share * 100.0).clamp(least, most), 1))
}

/// Microseconds as milliseconds, with about three digits.
pub fn milliseconds(us: f64) -> String {
    let value = us / 1000.0;
    fixed(value, [1.0, 10.0, 100.0].iter().filter(|&&limit| value < limit).count() as u32)
}

/// A time as people write it, to the millisecond; the zone is stated once, at the top of the page.
pub fn moment(text: &str) -> String {
    const SECONDS: &str = "dddd-dd-ddTdd:dd:dd";
    let (whole, rest) = text.split_at_checked(SECONDS.len()).unwrap_or((text, "?"));
    let fraction = rest.strip_suffix('Z').unwrap_or(rest);
    let digits = if fraction.is_empty() { Some("") } else { fraction.strip_prefix('.').filter(|digits| !digits.is_empty()) };
    let is_like = |(pattern, letter): (u8, u8)| if pattern == b'd' { letter.is_ascii_digit() } else { letter == pattern };
    match digits.filter(|digits| digits.bytes().all(|digit| digit.is_ascii_digit())) {
        Some(digits) if SECONDS.bytes().zip(whole.bytes()).all(is_like) => {
            let thousandths = digits.get(..3).unwrap_or(digits);
            format!("{} {}.{thousandths:0<3}", &whole[..10], &whole[11..])
        }
        _ => visible(text),
    }
}

/// A name of the tables as words.
pub fn words(text: &str) -> String {
    visible(text).replace('_', " ")
}

/// A value as text: numbers without needless zeros, six decimals at most.
pub fn plain(value: &Json) -> String {
    match value {
        Json::Null => String::new(),
        Json::Bool(true) => "True".to_owned(),
        Json::Bool(false) => "False".to_owned(),
        Json::String(text) => visible(text),
        Json::Number(number) => match number.as_f64() {
            Some(float) if number.is_f64() && float.fract() != 0.0 => {
                written(float, 6, false).trim_end_matches('0').trim_end_matches('.').to_owned()
            }
            Some(float) if number.is_f64() => format!("{float:.0}"),
            _ => number.to_string(),
        },
        Json::Array(_) | Json::Object(_) => visible(&value.to_string()),
    }
}

/// A number; 0 where the value is something else.
pub fn number(value: &Json) -> f64 {
    value.as_f64().unwrap_or_default()
}

/// A text with a capital at its beginning.
pub fn capitalized(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn numbers_are_rounded_away_from_zero_and_grouped() {
        assert_eq!(fixed(1_234_567.25, 1), "1,234,567.3");
        assert_eq!(fixed(-0.5, 0), "-1");
        assert_eq!(fixed(-0.4, 0), "0");
        assert_eq!(fixed(0.999_6, 3), "1.000");
        assert_eq!(fixed(1e20, 0), "100000000000000000000");
        assert_eq!([1.0, 150.0, 4694.56, 52_345.0, 59_752_048.0].map(milliseconds), ["0.001", "0.150", "4.69", "52.3", "59,752"]);
    }

    #[test]
    fn none_and_all_are_not_rounded_to() {
        assert_eq!(
            [0.0, 0.000_01, 0.5, 0.999_99, 1.0, 1.5].map(percent),
            ["0 %", "0.1 %", "50.0 %", "99.9 %", "100 %", "150.0 %"]
        );
    }

    #[test]
    fn times_are_shown_to_the_millisecond() {
        assert_eq!(moment("2026-06-21T02:51:00.693962006Z"), "2026-06-21 02:51:00.693");
        assert_eq!(moment("2026-06-21T02:51:00.5"), "2026-06-21 02:51:00.500");
        assert_eq!(moment("2026-06-21T02:51:00Z"), "2026-06-21 02:51:00.000");
        for other in ["12.5 s", "", "2026-06-21T02:51:00.Z", "2026-06-21T02:51:00+01", "2026-06-21T02:5é:00"] {
            assert_eq!(moment(other), other);
        }
    }

    #[test]
    fn values_are_plain() {
        let values =
            [json!(12.0), json!(0.1), json!("a\u{202e}b"), json!(18_446_744_073_709_551_615_u64), json!(-2.5), json!(true)];
        assert_eq!(values.each_ref().map(plain), ["12", "0.1", "a\\u202eb", "18446744073709551615", "-2.5", "True"]);
        assert_eq!(capitalized("ärger am Bus"), "Ärger am Bus");
    }
}
