//! Times as ISO-8601 text.

use crate::decimal::{push_int, push_short};
use crate::Ns;

const DAY: i64 = 86_400;

/// Appends ns since 1970 as `2026-11-21T10:00:00.123456Z`: microseconds, or nanoseconds where there are any.
pub fn push_time(ns: Ns, out: &mut Vec<u8>) {
    Stamp::default().push(ns, out);
}

/// Times as text, one after the other: the text of a second is made once.
#[derive(Debug, Default)]
pub struct Stamp {
    second: Option<i64>,
    /// Date and time up to the point.
    text: Vec<u8>,
}

impl Stamp {
    /// Appends a time as `push_time` does.
    #[inline]
    pub fn push(&mut self, ns: Ns, out: &mut Vec<u8>) {
        let second = ns.div_euclid(1_000_000_000);
        if self.second != Some(second) {
            self.turn(second);
        }
        push_short(&self.text, out);
        let rest = ns.rem_euclid(1_000_000_000) as u32;
        // Three digits each; a number of nanoseconds that is whole microseconds ends there.
        triple(rest / 1_000_000, out);
        triple(rest / 1000 % 1000, out);
        if !rest.is_multiple_of(1000) {
            triple(rest % 1000, out);
        }
        out.push(b'Z');
    }

    #[cold]
    fn turn(&mut self, second: i64) {
        self.second = Some(second);
        let out = &mut self.text;
        out.clear();
        let (year, month, day) = civil(second.div_euclid(DAY));
        let of_day = second.rem_euclid(DAY);
        if (0..10_000).contains(&year) {
            digits(year, 4, out);
        } else {
            push_int(year, out);
        }
        for (value, between) in [(month, b'-'), (day, b'-'), (of_day / 3600, b'T'), (of_day / 60 % 60, b':'), (of_day % 60, b':')]
        {
            out.push(between);
            digits(value, 2, out);
        }
        out.push(b'.');
    }
}

/// Three digits.
#[inline]
pub(super) fn triple(value: u32, out: &mut Vec<u8>) {
    out.extend_from_slice(&[b'0' + (value / 100) as u8, b'0' + (value / 10 % 10) as u8, b'0' + (value % 10) as u8]);
}

fn digits(value: i64, width: u32, out: &mut Vec<u8>) {
    for place in (0..width).rev() {
        out.push(b'0' + (value / 10i64.pow(place) % 10) as u8);
    }
}

/// Year, month and day of a day number since 1970 in the Gregorian calendar.
///
/// Counts from 1 March of year 0, so that the leap day is the last of its year; 400 years have 146 097 days.
fn civil(days: i64) -> (i64, i64, i64) {
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

/// Day number since 1970 of a date.
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
    fn known_dates() {
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
    fn a_stamp_tells_the_same_whatever_it_told_before() {
        let mut stamp = Stamp::default();
        for ns in [0, 999_999_999, 1_000_000_000, -1, -1_000_000_000, 1_697_041_234_123_456_000, 1_697_041_234_000_000_007, 0] {
            let (mut one, mut other) = (Vec::new(), Vec::new());
            stamp.push(ns, &mut one);
            push_time(ns, &mut other);
            assert_eq!(one, other);
        }
    }

    #[test]
    fn days_there_and_back() {
        for days in (-800_000..800_000).step_by(17) {
            let (year, month, day) = civil(days);
            assert_eq!(day_number(year, month, day), days);
        }
    }
}
