//! Times at the start of a line.

use crate::records::Clock;
use crate::write::day_number;
use crate::Ns;

const SECOND: Ns = 1_000_000_000;
const DAY: Ns = 86_400 * SECOND;

/// Numbers of seconds below this count from the start of the recording (records.md, chunk log).
const EPOCH_FROM: Ns = 100_000_000 * SECOND;

/// What the stamps of a recording have shown so far.
#[derive(Debug, Default)]
pub struct Stamps {
    utc: bool,
    any: bool,
    /// Days to add to times of day, and the last one.
    days: Ns,
    last_of_day: Option<Ns>,
    digits: u32,
}

impl Stamps {
    /// The clock.
    pub fn clock(&self) -> Clock {
        match (self.any, self.utc) {
            (false, _) => Clock::None,
            (true, true) => Clock::Utc,
            (true, false) => Clock::Relative,
        }
    }

    /// What the digits can express.
    pub fn resolution(&self) -> Option<Ns> {
        self.any.then(|| 10i64.pow(9 - self.digits.min(9)))
    }

    /// A number of seconds, since 1970 or since any start.
    pub fn seconds(&mut self, text: &[u8]) -> Option<Ns> {
        let (ns, digits) = decimal(text)?;
        self.any = true;
        self.utc |= ns >= EPOCH_FROM;
        self.digits = self.digits.max(digits);
        Some(ns)
    }

    /// A stamp at the start of the line, and what follows it.
    pub fn take<'a>(&mut self, line: &'a [u8]) -> (Option<Ns>, &'a [u8]) {
        let inner = line.strip_prefix(b"[").unwrap_or(line);
        let bracket = inner.len() < line.len();
        let end = |rest: &'a [u8]| if bracket { rest.strip_prefix(b"]") } else { Some(rest) };
        let found = self.date_time(inner).or_else(|| self.seconds_stamp(inner));
        match found.and_then(|(time, rest)| Some((time, end(rest)?))) {
            Some((time, rest)) => (Some(time), rest),
            None => (None, line),
        }
    }

    fn seconds_stamp<'a>(&mut self, line: &'a [u8]) -> Option<(Ns, &'a [u8])> {
        let length = line.iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
        let (text, rest) = line.split_at(length);
        // A stamp has a fraction and is followed by a blank or colon; anything else may be bytes.
        if !text.contains(&b'.') || !matches!(rest.first(), Some(b' ' | b'\t' | b':' | b']' | b',' | b';')) {
            return None;
        }
        Some((self.seconds(text)?, rest))
    }

    fn date_time<'a>(&mut self, line: &'a [u8]) -> Option<(Ns, &'a [u8])> {
        let (date, rest) = match date(line) {
            Some((days, rest)) => (Some(days), rest.strip_prefix(b" ").or_else(|| rest.strip_prefix(b"T"))?),
            None => (None, line),
        };
        let (of_day, digits, rest) = time_of_day(rest)?;
        let (zone, rest) = zone(rest);
        // A colon with a digit behind it goes on: `11:03:00:6b` are bytes.
        let ends = match rest {
            [b':', after, ..] => matches!(after, b' ' | b'\t'),
            [first, ..] => matches!(first, b' ' | b'\t' | b']' | b';' | b','),
            [] => true,
        };
        if !ends {
            return None;
        }
        self.any = true;
        self.digits = self.digits.max(digits);
        if let Some(days) = date {
            self.utc |= zone.is_some();
            return Some((days * DAY + of_day - zone.unwrap_or(0), rest));
        }
        // Past midnight times of day begin again.
        if self.last_of_day.is_some_and(|last| last - of_day > DAY / 2) {
            self.days += DAY;
        }
        self.last_of_day = Some(of_day);
        Some((self.days + of_day, rest))
    }
}

/// Seconds as ns, exactly, and the number of decimals.
fn decimal(text: &[u8]) -> Option<(Ns, u32)> {
    let (sign, text) = text.strip_prefix(b"-").map_or((1, text), |rest| (-1, rest));
    let mut parts = text.splitn(2, |&b| b == b'.');
    let (whole, fraction) = (parts.next()?, parts.next().unwrap_or(b""));
    if whole.is_empty() || whole.len() > 10 || !whole.iter().chain(fraction).all(u8::is_ascii_digit) {
        return None;
    }
    let number = |digits: &[u8]| digits.iter().fold(0i64, |value, digit| value * 10 + i64::from(digit - b'0'));
    let kept = &fraction[..fraction.len().min(9)];
    let ns = number(kept) * 10i64.pow(9 - kept.len() as u32);
    Some((sign * (number(whole).checked_mul(SECOND)?.checked_add(ns)?), kept.len() as u32))
}

fn two(line: &[u8], at: usize) -> Option<i64> {
    let digit = |i: usize| line.get(i).filter(|b| b.is_ascii_digit()).map(|b| i64::from(b - b'0'));
    Some(digit(at)? * 10 + digit(at + 1)?)
}

/// `2026-11-21` or `2026/11/21`.
fn date(line: &[u8]) -> Option<(i64, &[u8])> {
    let mark = *line.get(4).filter(|b| matches!(b, b'-' | b'/'))?;
    let year = two(line, 0)? * 100 + two(line, 2)?;
    let (month, day) = (two(line, 5)?, two(line, 8)?);
    if line.get(7) != Some(&mark) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    Some((day_number(year, month, day), &line[10..]))
}

/// `16:20:34`, with `.123`, `,123` or `:123` behind it.
fn time_of_day(line: &[u8]) -> Option<(Ns, u32, &[u8])> {
    let (hour, minute, second) = (two(line, 0)?, two(line, 3)?, two(line, 6)?);
    if line.get(2) != Some(&b':') || line.get(5) != Some(&b':') || hour > 23 || minute > 59 || second > 60 {
        return None;
    }
    let mut rest = &line[8..];
    let mut ns = (hour * 3600 + minute * 60 + second) * SECOND;
    let mut digits = 0;
    if matches!(rest.first(), Some(b'.' | b',' | b':')) {
        let length = rest[1..].iter().take_while(|b| b.is_ascii_digit()).count();
        // Three digits behind a colon are milliseconds; two would be a byte.
        if length > 2 || (length > 0 && rest[0] != b':') {
            let (fraction, kept) = decimal(&[b"0.", &rest[1..=length]].concat())?;
            ns += fraction;
            digits = kept;
            rest = &rest[1 + length..];
        } else if rest[0] == b':' && length == 2 {
            return None;
        }
    }
    Some((ns, digits, rest))
}

/// `Z`, `+01:00`, `+0100`.
fn zone(line: &[u8]) -> (Option<Ns>, &[u8]) {
    match line.first() {
        Some(b'Z') => (Some(0), &line[1..]),
        Some(sign @ (b'+' | b'-')) => {
            let colon = usize::from(line.get(3) == Some(&b':'));
            match (two(line, 1), two(line, 3 + colon)) {
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
