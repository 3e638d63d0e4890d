//! Parses dates, times of day and zone offsets in the forms that loggers write.

use modlens_protocol::timestamp::day_number;
use modlens_protocol::Ns;

const SECOND: Ns = 1_000_000_000;
pub(super) const POWERS_OF_TEN: [i64; 10] =
    [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000, 1_000_000_000];
const MONTHS: [&[u8]; 12] = [b"jan", b"feb", b"mar", b"apr", b"may", b"jun", b"jul", b"aug", b"sep", b"oct", b"nov", b"dec"];

/// Whether the day or the month comes first in dates like `01/02/2019`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum DateOrder {
    /// No date has shown it yet; the day is assumed to come first.
    #[default]
    Undecided,
    DayFirst,
    MonthFirst,
}

/// Parses decimal digits as a number; `None` for one beyond 64 bits.
pub(super) fn number(text: &[u8]) -> Option<i64> {
    if text.is_empty() {
        return None;
    }
    let digit = |b: &u8| b.is_ascii_digit().then(|| i64::from(b - b'0'));
    text.iter().try_fold(0i64, |value, b| value.checked_mul(10)?.checked_add(digit(b)?))
}

/// Parses the two decimal digits at `at`.
pub(super) fn two_digits(line: &[u8], at: usize) -> Option<i64> {
    let (&tens, &ones) = (line.get(at)?, line.get(at + 1)?);
    (tens.is_ascii_digit() && ones.is_ascii_digit()).then(|| i64::from(tens - b'0') * 10 + i64::from(ones - b'0'))
}

/// Parses a date and the separator after it: days since 1970-01-01, and the rest of the line. A date that has a number
/// above 12 settles `order` for those that do not.
pub(super) fn date<'a>(line: &'a [u8], order: &mut DateOrder) -> Option<(i64, &'a [u8])> {
    let (days, length) = parse_year_first(line).or_else(|| parse_year_last(line, order))?;
    let ([b' ' | b'T' | b'@' | b'_', rest @ ..] | [b',', b' ', rest @ ..]) = &line[length..] else { return None };
    Some((days, rest))
}

/// Parses `2026-11-21` or `2026/11/21`: days since 1970-01-01 and the length of the text.
fn parse_year_first(line: &[u8]) -> Option<(i64, usize)> {
    let separator = *line.get(4).filter(|b| matches!(b, b'-' | b'/' | b'.'))?;
    let year = number(&line[..4])?;
    if line.get(7) != Some(&separator) {
        return None;
    }
    Some((days(year, two_digits(line, 5)?, two_digits(line, 8)?)?, 10))
}

/// Parses `21.11.2026`, `21/11/2026` or `11/21/2026`: days since 1970-01-01 and the length of the text.
fn parse_year_last(line: &[u8], order: &mut DateOrder) -> Option<(i64, usize)> {
    let separator = *line.get(2).filter(|b| matches!(b, b'.' | b'/' | b'-'))?;
    if line.get(5) != Some(&separator) {
        return None;
    }
    let (first, second, year) = (two_digits(line, 0)?, two_digits(line, 3)?, number(line.get(6..10)?)?);
    match (first, second) {
        (13.., _) => *order = DateOrder::DayFirst,
        (_, 13..) => *order = DateOrder::MonthFirst,
        _ => {}
    }
    let month_first = *order == DateOrder::MonthFirst && separator != b'.';
    let (day, month) = if month_first { (second, first) } else { (first, second) };
    Some((days(year, month, day)?, 10))
}

/// Days since 1970-01-01; `None` for numbers that are no date of the years 1970 to 2200.
fn days(year: i64, month: i64, day: i64) -> Option<i64> {
    ((1970..=2200).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day)).then(|| day_number(year, month, day))
}

/// Parses a date with a month name that `text` ends with, as it is before a time of day: `05 Mar 2021 ` or
/// `Mar  5 2021 `. Returns days since 1970-01-01.
pub(super) fn date_in_words(text: &[u8]) -> Option<i64> {
    if !text.ends_with(b" ") || text.len() < 11 {
        return None;
    }
    let mut words = text.rsplit(|&b| b == b' ').filter(|word| !word.is_empty());
    let year = words.next().filter(|word| word.len() == 4).and_then(number)?;
    let (second, first) = (words.next()?, words.next()?);
    let first = first.strip_prefix(b"[").unwrap_or(first);
    let (month, day) = match month(second) {
        Some(month) => (month, number(first)?),
        None => (month(first)?, number(second.strip_suffix(b",").unwrap_or(second))?),
    };
    days(year, month, day)
}

/// The number of a month (1 to 12) from the first three letters of its English name.
fn month(word: &[u8]) -> Option<i64> {
    let start = word.get(..3).filter(|_| word.len() == 3)?;
    MONTHS.iter().position(|month| start.eq_ignore_ascii_case(month)).map(|at| at as i64 + 1)
}

/// Parses a time of day such as `16:20:34`: nanoseconds since midnight, and the rest of the line.
pub(super) fn time_of_day(line: &[u8]) -> Option<(Ns, &[u8])> {
    if line.get(1) == Some(&b':') && line.get(4) == Some(&b':') && line[0].is_ascii_digit() {
        // The hour may have one digit.
        let (minute, second) = (two_digits(line, 2)?, two_digits(line, 5)?);
        let hour = i64::from(line[0] - b'0');
        return (minute < 60 && second < 61).then(|| ((hour * 3600 + minute * 60 + second) * SECOND, &line[7..]));
    }
    if line.get(2) != Some(&b':') || line.get(5) != Some(&b':') {
        return None;
    }
    let (hour, minute, second) = (two_digits(line, 0)?, two_digits(line, 3)?, two_digits(line, 6)?);
    if hour > 23 || minute > 59 || second > 60 {
        return None;
    }
    Some(((hour * 3600 + minute * 60 + second) * SECOND, &line[8..]))
}

/// The length of a date, a time of day or a number with a fraction in the line at this place, with the fraction of a second after it; 0 if there is none,
/// or if it is inside a list of bytes, as in `07:03:00:10`.
pub(super) fn stamp_length(line: &[u8], at: usize) -> usize {
    let text = &line[at..];
    if text.first().is_none_or(|b| !b.is_ascii_digit()) {
        return 0;
    }
    let joins = |mark: Option<&u8>| matches!(mark, Some(b':' | b'-' | b'.'));
    let follows_list = at > 1 && joins(line.get(at - 1)) && line[at - 2].is_ascii_hexdigit();
    if follows_list {
        return 0;
    }
    let seconds = number_length(text);
    if seconds > 0 {
        return seconds;
    }
    // Most words are neither.
    if !matches!(text.get(2..5), Some([b':', ..] | [_, _, b'-' | b'/'] | [b'.' | b'-' | b'/', _, _])) {
        return 0;
    }
    let goes_on = |end: usize| joins(text.get(end)) && text.get(end + 1).is_some_and(u8::is_ascii_hexdigit);
    let ends = |end: usize| !text.get(end).is_some_and(u8::is_ascii_alphanumeric) || text[end] == b'T' || text[end] == b'Z';
    if time_of_day(text).is_some() {
        let fraction = |text: &[u8]| text.iter().take_while(|b| b.is_ascii_digit()).count();
        let decimals = if matches!(text.get(8), Some(b'.' | b',' | b':')) { fraction(&text[9..]) } else { 0 };
        let length = if decimals > 2 || (decimals > 0 && text[8] != b':') { 9 + decimals } else { 8 };
        return if goes_on(length) || !ends(length) { 0 } else { length };
    }
    let length = text.len() - date(text, &mut DateOrder::default()).map_or(text.len(), |(_, rest)| rest.len());
    let length = text[..length].trim_ascii_end().len();
    if length >= DATE_CHARS && !goes_on(length) && ends(length) {
        length
    } else {
        0
    }
}

/// The length of a number with a fraction at the start of the text, such as a time in seconds; 0 for two bytes with a point
/// between them.
fn number_length(text: &[u8]) -> usize {
    let digits = |text: &[u8]| text.iter().take_while(|b| b.is_ascii_digit()).count();
    let whole = digits(text);
    if text.get(whole) != Some(&b'.') {
        return 0;
    }
    let decimals = digits(&text[whole + 1..]);
    let length = whole + 1 + decimals;
    let is_end = text.get(length).is_none_or(|b| !b.is_ascii_alphanumeric() && *b != b'.');
    if is_end && decimals > 0 && (whole, decimals) != (2, 2) {
        length
    } else {
        0
    }
}

/// A date has at least so many characters: a day, a month and a year of four digits.
const DATE_CHARS: usize = 8;

/// Parses the fraction of a second that may follow a time of day (`.123`, `,123` or `:123`): nanoseconds, the number of
/// decimals, and the rest of the line. Without a fraction both numbers are 0.
///
/// `may_be_micros` says that nine decimals may be microseconds printed with leading zeros, as socat 1.7 does. It is
/// cleared by the first fraction that cannot be.
pub(super) fn fraction<'a>(rest: &'a [u8], may_be_micros: &mut bool) -> Option<(Ns, u32, &'a [u8])> {
    let Some(separator @ (b'.' | b',' | b':')) = rest.first() else { return Some((0, 0, rest)) };
    let length = rest[1..].iter().take_while(|b| b.is_ascii_digit()).count();
    // Three digits after a colon are milliseconds; two would be a byte.
    if length == 0 || (*separator == b':' && length < 3) {
        return (length != 2 || *separator != b':').then_some((0, 0, rest));
    }
    let digits = &rest[1..=length.min(9)];
    let rest = &rest[1 + length..];
    *may_be_micros &= length != 9 || digits.starts_with(b"000");
    if *may_be_micros && length == 9 {
        return Some((number(digits)? * 1000, 6, rest));
    }
    Some((number(digits)? * POWERS_OF_TEN[9 - digits.len()], digits.len() as u32, rest))
}

/// Parses `Z`, ` UTC`, `+01:00` or `+0100`: the offset to UTC in ns (`None` if there is none), and the rest of the line.
pub(super) fn zone(line: &[u8]) -> (Option<Ns>, &[u8]) {
    match line {
        [b'Z', rest @ ..] | [b' ', b'U', b'T', b'C', rest @ ..] => (Some(0), rest),
        [sign @ (b'+' | b'-'), ..] => {
            let colon = usize::from(line.get(3) == Some(&b':'));
            match (two_digits(line, 1), two_digits(line, 3 + colon)) {
                (Some(hours), Some(minutes)) => {
                    let offset = (hours * 3600 + minutes * 60) * SECOND;
                    (Some(if *sign == b'+' { offset } else { -offset }), &line[5 + colon..])
                }
                _ => (None, line),
            }
        }
        _ => (None, line),
    }
}
