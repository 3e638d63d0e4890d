//! Times as ISO 8601 text.

use crate::decimal::decimal_texts;
use crate::Ns;

const DAY_SECONDS: i64 = 86_400;
const NS_PER_SECOND: i64 = 1_000_000_000;

/// A time as tables show it; `push_time` says how.
///
/// ```
/// assert_eq!(modlens_protocol::timestamp::time_text(1_697_041_234_000_000_000), "2023-10-11T16:20:34.000000Z");
/// ```
pub fn time_text(ns: Ns) -> String {
    let mut text = Vec::new();
    push_time(ns, &mut text);
    String::from_utf8_lossy(&text).into_owned()
}

/// Appends ns since 1970 as `2026-11-21T10:00:00.123456Z`, with nine decimals only if the time is not a whole number of
/// microseconds.
pub fn push_time(ns: Ns, out: &mut Vec<u8>) {
    TimeFormatter::default().push(ns, out);
}

/// Bytes of a date with a time of day and the decimal point after it. The years that 64 bits of ns reach have four digits.
pub const SECOND_BYTES: usize = 20;

/// Formats consecutive times. The text of date and time is kept while the second stays the same.
#[derive(Debug, Default)]
pub struct TimeFormatter {
    /// The second to which the text belongs, in ns.
    second: Option<Ns>,
    /// Date and time, including the decimal point, with room for a copy of fixed size.
    text: [u8; 32],
}

impl TimeFormatter {
    /// Appends a time in the format of `push_time`.
    #[inline]
    pub fn push(&mut self, ns: Ns, out: &mut Vec<u8>) {
        let (text, fraction, length) = self.parts(ns);
        let end = out.len() + SECOND_BYTES;
        out.extend_from_slice(text);
        out.truncate(end);
        out.extend_from_slice(&fraction);
        out.truncate(end + length);
    }

    /// The same as two blocks of text: the first `SECOND_BYTES` of the one, then of the other as many as follow it.
    #[inline]
    pub fn parts(&mut self, ns: Ns) -> (&[u8; 32], [u8; 16], usize) {
        let rest = match self.second {
            Some(second) if (0..NS_PER_SECOND).contains(&ns.wrapping_sub(second)) => ns - second,
            _ => self.change_second(ns),
        };
        let (fraction, length) = fraction_text(rest as u32);
        (&self.text, fraction, length)
    }

    /// Formats date and time of a new second, and says how many ns are left.
    #[cold]
    fn change_second(&mut self, ns: Ns) -> Ns {
        let (second, rest) = (ns.div_euclid(NS_PER_SECOND), ns.rem_euclid(NS_PER_SECOND));
        // Before the first whole second that 64 bits reach, the text is made each time.
        self.second = second.checked_mul(NS_PER_SECOND);
        let (year, month, day) = date_of_day(second.div_euclid(DAY_SECONDS));
        let of_day = second.rem_euclid(DAY_SECONDS);
        let mut out = Vec::new();
        push_digits(year, 4, &mut out);
        for (value, between) in [(month, b'-'), (day, b'-'), (of_day / 3600, b'T'), (of_day / 60 % 60, b':'), (of_day % 60, b':')]
        {
            out.push(between);
            push_digits(value, 2, &mut out);
        }
        out.push(b'.');
        self.text[..SECOND_BYTES].copy_from_slice(&out);
        rest
    }
}

/// The text of a fraction of a second with the letter of the time zone, and its length: milliseconds, microseconds, and nanoseconds
/// if there are any, in three digits each.
#[inline]
fn fraction_text(ns: u32) -> ([u8; 16], usize) {
    let texts = decimal_texts();
    // A number below 1000 stands with its zeros in the text of 1xxx.
    let three_digits = |value: u32| {
        let [_, a, b, c, ..] = texts[1000 + value as usize];
        u128::from(u32::from_le_bytes([a, b, c, 0]))
    };
    let micros = ns / 1000;
    let six = three_digits(micros / 1000) | three_digits(micros % 1000) << 24;
    let zone = u128::from(b'Z');
    if micros * 1000 == ns {
        ((six | zone << 48).to_le_bytes(), 7)
    } else {
        ((six | three_digits(ns % 1000) << 48 | zone << 72).to_le_bytes(), 10)
    }
}

/// Appends a number with `width` digits.
fn push_digits(value: i64, width: u32, out: &mut Vec<u8>) {
    for place in (0..width).rev() {
        out.push(b'0' + (value / 10i64.pow(place) % 10) as u8);
    }
}

/// Year, month and day (Gregorian calendar) of a day number since 1970.
///
/// Counts from 1 March of year 0, so that a leap day is the last day of its year. 400 years (an era) have 146 097 days.
fn date_of_day(days: i64) -> (i64, i64, i64) {
    let days = days + 719_468;
    let era = days.div_euclid(146_097);
    let of_era = days.rem_euclid(146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let march_month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * march_month + 2) / 5 + 1;
    let month = if march_month < 10 { march_month + 3 } else { march_month - 9 };
    (year_of_era + era * 400 + i64::from(month <= 2), month, day)
}

/// The day number since 1970 of a date in the Gregorian calendar.
pub fn day_number(year: i64, month: i64, day: i64) -> i64 {
    let year = year - i64::from(month <= 2);
    let era = year.div_euclid(400);
    let of_era = year.rem_euclid(400);
    let of_year = (153 * (month + if month > 2 { -3 } else { 9 }) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_dates_are_formatted() {
        let text = |ns| {
            let mut out = Vec::new();
            push_time(ns, &mut out);
            String::from_utf8(out).unwrap()
        };
        assert_eq!(text(0), "1970-01-01T00:00:00.000000Z");
        assert_eq!(text(1_697_041_234_123_456_000), "2023-10-11T16:20:34.123456Z");
        assert_eq!(text(951_782_400_000_000_001), "2000-02-29T00:00:00.000000001Z");
        assert_eq!(text(-1_000), "1969-12-31T23:59:59.999999Z");
        assert_eq!(text(i64::MIN), "1677-09-21T00:12:43.145224192Z");
        assert_eq!(text(i64::MAX), "2262-04-11T23:47:16.854775807Z");
    }

    #[test]
    fn text_does_not_depend_on_the_time_before() {
        let mut stamp = TimeFormatter::default();
        for ns in [
            0,
            999_999_999,
            1_000_000_000,
            -1,
            -1_000_000_000,
            1_697_041_234_123_456_000,
            1_697_041_234_000_000_007,
            i64::MIN,
            i64::MIN + 1,
            i64::MAX,
            0,
        ] {
            let (mut one, mut other) = (Vec::new(), Vec::new());
            stamp.push(ns, &mut one);
            push_time(ns, &mut other);
            assert_eq!(one, other);
        }
    }

    #[test]
    fn dates_convert_to_days_and_back() {
        for days in (-800_000..800_000).step_by(17) {
            let (year, month, day) = date_of_day(days);
            assert_eq!(day_number(year, month, day), days);
        }
    }
}
