//! Times as ISO 8601 text.

use crate::decimal::{push_int, push_short};
use crate::Ns;

const DAY_SECONDS: i64 = 86_400;

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

/// Formats consecutive times. The text of date and time is kept while the second stays the same.
#[derive(Debug, Default)]
pub struct TimeFormatter {
    second: Option<i64>,
    /// Date and time, including the decimal point.
    text: Vec<u8>,
}

impl TimeFormatter {
    /// Appends a time in the format of `push_time`.
    #[inline]
    pub fn push(&mut self, ns: Ns, out: &mut Vec<u8>) {
        let second = ns.div_euclid(1_000_000_000);
        if self.second != Some(second) {
            self.change_second(second);
        }
        push_short(&self.text, out);
        let rest = ns.rem_euclid(1_000_000_000) as u32;
        // The fraction in groups of three digits: milliseconds, microseconds, and nanoseconds if there are any.
        push_three_digits(rest / 1_000_000, out);
        push_three_digits(rest / 1000 % 1000, out);
        if !rest.is_multiple_of(1000) {
            push_three_digits(rest % 1000, out);
        }
        out.push(b'Z');
    }

    /// Formats date and time of a new second.
    #[cold]
    fn change_second(&mut self, second: i64) {
        self.second = Some(second);
        let out = &mut self.text;
        out.clear();
        let (year, month, day) = date_of_day(second.div_euclid(DAY_SECONDS));
        let of_day = second.rem_euclid(DAY_SECONDS);
        if (0..10_000).contains(&year) {
            push_digits(year, 4, out);
        } else {
            push_int(year, out);
        }
        for (value, between) in [(month, b'-'), (day, b'-'), (of_day / 3600, b'T'), (of_day / 60 % 60, b':'), (of_day % 60, b':')]
        {
            out.push(between);
            push_digits(value, 2, out);
        }
        out.push(b'.');
    }
}

/// Appends a number below 1000 with three digits.
#[inline]
pub(super) fn push_three_digits(value: u32, out: &mut Vec<u8>) {
    out.extend_from_slice(&[b'0' + (value / 100) as u8, b'0' + (value / 10 % 10) as u8, b'0' + (value % 10) as u8]);
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
    }

    #[test]
    fn text_does_not_depend_on_the_time_before() {
        let mut stamp = TimeFormatter::default();
        for ns in [0, 999_999_999, 1_000_000_000, -1, -1_000_000_000, 1_697_041_234_123_456_000, 1_697_041_234_000_000_007, 0] {
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
