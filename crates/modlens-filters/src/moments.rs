//! Times in filters: a date with or without a time of day, and a time of day alone.

use modlens_protocol::timestamp::day_number;
use serde_json::{json, Value as Json};

/// Nanoseconds of a day.
pub const DAY_NS: i64 = 86_400_000_000_000;
const SECOND_NS: i64 = 1_000_000_000;
const MINUTE_NS: i64 = 60 * SECOND_NS;

/// From when on an offset from UTC holds, and the offset; both in nanoseconds.
pub type Changes = Vec<(i64, i64)>;

/// Gives the changes of the UTC offset of this computer, for times such as `'12:00 local'`.
pub type LocalChanges<'a> = &'a dyn Fn() -> Changes;

/// A time of day: nanoseconds since midnight, and its zone.
#[derive(Debug, PartialEq, Eq)]
pub struct TimeOfDay {
    pub ns: i64,
    pub zone: Zone,
}

/// The zone of a time of day.
#[derive(Debug, PartialEq, Eq)]
pub enum Zone {
    /// A fixed offset from UTC, in nanoseconds.
    Fixed(i64),
    /// The zone of this computer.
    Local,
}

/// What is left of a text while it is read.
struct Rest<'a>(&'a str);

impl Rest<'_> {
    fn takes(&mut self, sign: &str) -> bool {
        let found = self.0.strip_prefix(sign);
        self.0 = found.unwrap_or(self.0);
        found.is_some()
    }

    /// A number of `least` to `most` digits, as many as there are.
    fn number(&mut self, least: usize, most: usize) -> Option<i64> {
        let length = self.0.bytes().take(most).take_while(u8::is_ascii_digit).count();
        let found = self.0.get(..length).filter(|_| length >= least)?.parse().ok();
        self.0 = &self.0[length..];
        found
    }

    /// What follows a second, in nanoseconds.
    fn fraction(&mut self) -> Option<i64> {
        if !self.takes(".") && !self.takes(",") {
            return Some(0);
        }
        let before = self.0.len();
        let digits = self.number(1, 9)?;
        Some(digits * 10_i64.pow(9 - (before - self.0.len()) as u32))
    }

    /// Hours, minutes and seconds, in nanoseconds.
    fn clock(&mut self, least_digits: usize) -> Option<i64> {
        let hours = self.number(least_digits, 2)?;
        let minutes = if self.takes(":") { self.number(2, 2)? } else { return None };
        let (seconds, fraction) = if self.takes(":") { (self.number(2, 2)?, self.fraction()?) } else { (0, 0) };
        let is_valid = hours < 24 && minutes < 60 && seconds < 60;
        is_valid.then_some(((hours * 60 + minutes) * 60 + seconds) * SECOND_NS + fraction)
    }

    /// `Z`, or an offset such as `+02:00`. Nothing is UTC.
    fn offset(&mut self) -> Option<i64> {
        if self.0.is_empty() || self.takes("Z") {
            return Some(0);
        }
        let sign = if self.takes("+") {
            1
        } else if self.takes("-") {
            -1
        } else {
            return None;
        };
        let hours = self.number(2, 2)?;
        self.takes(":");
        let minutes = self.number(2, 2)?;
        (hours < 24 && minutes < 60).then_some(sign * (hours * 60 + minutes) * MINUTE_NS)
    }
}

/// Nanoseconds since 1970 UTC of a date, or a date and a time; UTC if it says no zone.
pub fn moment(text: &str) -> Option<i64> {
    let mut rest = Rest(text.trim());
    let year = rest.number(4, 4)?;
    let month = if rest.takes("-") { rest.number(2, 2)? } else { return None };
    let day = if rest.takes("-") { rest.number(2, 2)? } else { return None };
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let days = [31, if is_leap { 29 } else { 28 }, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let longest = usize::try_from(month - 1).ok().and_then(|month| days.get(month))?;
    if year == 0 || !(1..=*longest).contains(&day) {
        return None;
    }
    let is_date_alone = !rest.0.starts_with(['T', ' ']) || !rest.0[1..].starts_with(|letter: char| letter.is_ascii_digit());
    let clock = if is_date_alone {
        0
    } else {
        rest.0 = &rest.0[1..];
        rest.clock(2)?
    };
    rest.0 = rest.0.trim_start();
    let offset = rest.offset()?;
    // Beyond 64 bits is before or after every recording.
    let whole = i128::from(day_number(year, month, day)) * i128::from(DAY_NS) + i128::from(clock - offset);
    let limited = whole.clamp(i128::from(i64::MIN), i128::from(i64::MAX));
    rest.0.is_empty().then_some(limited as i64)
}

/// A time without a date.
pub fn time_of_day(text: &str) -> Option<TimeOfDay> {
    let mut rest = Rest(text.trim());
    let ns = rest.clock(1)?;
    rest.0 = rest.0.trim_start();
    let zone = match rest.0 {
        "utc" => Zone::Fixed(0),
        "local" => Zone::Local,
        _ => {
            let offset = rest.offset()?;
            if !rest.0.is_empty() {
                return None;
            }
            Zone::Fixed(offset)
        }
    };
    Some(TimeOfDay { ns, zone })
}

/// The condition for `time >= '12:00:05'`, which holds on every day.
///
/// `changes` are halved until one is left, so that a zone with summer time costs a few comparisons. `is_turned` says that
/// the text is on the left.
pub fn at_time_of_day(operator: &str, column: &Json, wanted_ns: i64, changes: &[(i64, i64)], is_turned: bool) -> Json {
    if let [] | [_] = changes {
        let shifted = json!(["arith", "+", column, ["num", changes.first().map_or(0, |change| change.1)]]);
        let (clock, wanted) = (json!(["arith", "%", shifted, ["num", DAY_NS]]), json!(["num", wanted_ns]));
        return if is_turned { json!(["cmp", operator, wanted, clock]) } else { json!(["cmp", operator, clock, wanted]) };
    }
    let (early, late) = changes.split_at(changes.len() / 2);
    let part = |changes| at_time_of_day(operator, column, wanted_ns, changes, is_turned);
    let change = json!(["time", late[0].0]);
    json!(["or", ["and", ["cmp", "<", column, change], part(early)], ["and", ["cmp", ">=", column, change], part(late)]])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_of_known_dates() {
        for (text, seconds) in [
            ("2023-10-11T14:00:00Z", 1_697_032_800),
            ("2023-10-11 14:00", 1_697_032_800),
            ("2023-10-11T16:00:00+02:00", 1_697_032_800),
            ("2023-10-11", 1_696_982_400),
            ("2024-02-29", 1_709_164_800),
        ] {
            assert_eq!(moment(text), Some(seconds * SECOND_NS), "{text}");
        }
        assert_eq!(moment("2023-10-11T14:00:00.000000001Z"), Some(1_697_032_800_000_000_001));
        for text in ["2023-02-30", "2023-13-01", "2023-10-11T24:00", "noon", "2023-10-11T14", "2023-10-11x", "12:00", ""] {
            assert_eq!(moment(text), None, "{text}");
        }
        assert_eq!(moment("9999-01-01"), Some(i64::MAX));
    }

    #[test]
    fn times_of_day_have_a_zone() {
        let utc = |ns| Some(TimeOfDay { ns, zone: Zone::Fixed(0) });
        assert_eq!(time_of_day("12:00:05.25"), utc(43_205_250_000_000));
        assert_eq!(time_of_day("7:30 utc"), utc(27_000_000_000_000));
        let berlin = Some(TimeOfDay { ns: 27_000_000_000_000, zone: Zone::Fixed(2 * 60 * MINUTE_NS) });
        assert_eq!(time_of_day("7:30 +02:00"), berlin);
        assert_eq!(time_of_day("7:30local"), Some(TimeOfDay { ns: 27_000_000_000_000, zone: Zone::Local }));
        for text in ["24:00", "noon", "12", "12:00:60", "12:00 mars", "2023-10-11"] {
            assert_eq!(time_of_day(text), None, "{text}");
        }
    }
}
