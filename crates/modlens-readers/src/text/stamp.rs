//! Times in lines: what they say, and what kind of clock they show.

use std::sync::Arc;

use crate::text::clock::{ClockSettings, Kind};
use crate::text::date::{date, fraction, number, time_of_day, words_before, zone, Order};
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

const SECOND: Ns = 1_000_000_000;
const DAY: Ns = 86_400 * SECOND;

/// Numbers of seconds below this count from the start of the recording (records.md, chunk log).
const EPOCH_FROM: Ns = 100_000_000 * SECOND;

/// Characters in front of the bytes in which a time is looked for.
const FRONT_LIMIT: usize = 200;

/// What the stamps of a recording have shown so far.
#[derive(Clone, Debug, Default)]
pub struct Stamps {
    settings: Arc<ClockSettings>,
    pub(super) seen: Seen,
    last: LastSecond,
}

/// A stamp up to its seconds, as it stood: most lines have the same as the line before.
#[derive(Clone, Copy, Debug, Default)]
struct LastSecond {
    text: [u8; LAST_SECOND],
    length: usize,
    days: Option<i64>,
    of_day: Ns,
}

/// The longest of them: a date, a time of day, what stands between.
const LAST_SECOND: usize = 24;

impl LastSecond {
    fn of<'a>(&self, line: &'a [u8]) -> Option<(Option<i64>, Ns, &'a [u8])> {
        let rest = line.strip_prefix(&self.text[..self.length])?;
        (self.length > 0).then_some((self.days, self.of_day, rest))
    }

    fn keep(&mut self, text: &[u8], days: Option<i64>, of_day: Ns) {
        self.length = 0;
        if let Some(place) = self.text.get_mut(..text.len()) {
            place.copy_from_slice(text);
            (self.length, self.days, self.of_day) = (text.len(), days, of_day);
        }
    }
}

/// The part that changes: a line that turns out to be something else must not change it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    kind: Kind,
    order: Order,
    /// Days to add to times of day, and the last one.
    days: Ns,
    last_of_day: Option<Ns>,
    digits: u32,
    /// Fractions of nine digits may be microseconds (socat 1.7).
    pub(super) short_fractions: bool,
    /// Where the last stamp stood in its line.
    hint: usize,
    /// Of the times between records, where only these are printed.
    sum: Ns,
}

impl Stamps {
    /// Stamps of a recording of which this is known.
    pub fn new(settings: Arc<ClockSettings>) -> Self {
        Self { settings, ..Self::default() }
    }

    /// The clock.
    pub fn clock(&self) -> Clock {
        match self.seen.kind {
            Kind::None => Clock::None,
            Kind::Utc => Clock::Utc,
            _ => Clock::Relative,
        }
    }

    /// What kind of clock it is.
    pub fn kind(&self) -> Kind {
        self.seen.kind
    }

    /// What the digits can express.
    pub fn resolution(&self) -> Option<Ns> {
        (self.seen.kind != Kind::None).then(|| 10i64.pow(9 - self.seen.digits.min(9)))
    }

    /// Learns from text ahead which of day and month comes first.
    pub fn look_ahead(&mut self, lines: &[u8]) {
        for line in lines.split(|&b| b == b'\n').take(2000) {
            let start = Seen { order: self.seen.order, short_fractions: self.seen.short_fractions, ..Seen::default() };
            let mut ahead = Self { settings: Arc::clone(&self.settings), seen: start, ..Self::default() };
            ahead.find(line);
            self.seen.order = ahead.seen.order;
            self.seen.short_fractions = ahead.seen.short_fractions;
        }
        self.last = LastSecond::default();
    }

    /// A number of seconds, since 1970 or since any start.
    pub fn seconds(&mut self, text: &[u8]) -> Option<Ns> {
        let (ns, digits) = decimal(text)?;
        self.shown(if ns >= EPOCH_FROM { Kind::Utc } else { Kind::Relative }, digits);
        Some(ns)
    }

    /// A number of milliseconds since any start.
    pub fn milliseconds(&mut self, text: &[u8]) -> Option<Ns> {
        let value = number(text)?.checked_mul(1_000_000)?;
        self.shown(Kind::Relative, 3);
        Some(value)
    }

    /// Time has gone on by so much since this was last said.
    pub fn after(&mut self, delta: Ns) -> Ns {
        self.shown(Kind::Relative, 3);
        self.seen.sum = self.seen.sum.saturating_add(delta);
        self.seen.sum
    }

    /// A stamp at the start of the line, and what follows it.
    pub fn take<'a>(&mut self, line: &'a [u8]) -> (Option<Ns>, &'a [u8]) {
        if !line.first().is_some_and(|b| b.is_ascii_digit() || *b == b'[') {
            return (None, line);
        }
        let inner = line.strip_prefix(b"[").unwrap_or(line);
        let bracket = inner.len() < line.len();
        let end = |rest: &'a [u8]| if bracket { rest.strip_prefix(b"]") } else { Some(rest) };
        let found = self.date_time(inner, &[]).or_else(|| self.seconds_stamp(inner));
        match found.and_then(|(time, rest)| Some((time, end(rest)?))) {
            Some((time, rest)) => (Some(time), rest),
            None => (None, line),
        }
    }

    /// `-0.00125`: seconds before what a recorder calls its start.
    pub fn before_start<'a>(&mut self, line: &'a [u8]) -> (Option<Ns>, &'a [u8]) {
        match self.seconds_stamp(&line[1..]) {
            Some((time, rest)) => (Some(-time), rest),
            None => (None, line),
        }
    }

    /// A stamp anywhere in the text in front of the bytes.
    pub fn find(&mut self, front: &[u8]) -> Option<Ns> {
        if front.len() < 8 {
            return None;
        }
        let front = &front[..front.len().min(FRONT_LIMIT)];
        // Nearly always where it stood in the line before.
        if let Some((time, _)) = self.stamp_at(front, self.seen.hint) {
            return Some(time);
        }
        for at in 0..front.len() {
            if let Some((time, _)) = self.stamp_at(front, at) {
                self.seen.hint = at;
                return Some(time);
            }
        }
        let text = front.trim_ascii_start();
        let text = text.strip_prefix(b"[").or_else(|| text.strip_prefix(b"(")).unwrap_or(text).trim_ascii_start();
        self.seconds_stamp(text).map(|(time, _)| time)
    }

    fn stamp_at<'a>(&mut self, front: &'a [u8], at: usize) -> Option<(Ns, &'a [u8])> {
        let starts = front.get(at).is_some_and(u8::is_ascii_digit) && (at == 0 || !front[at - 1].is_ascii_alphanumeric());
        if starts {
            self.date_time(&front[at..], &front[..at])
        } else {
            None
        }
    }

    fn seconds_stamp<'a>(&mut self, line: &'a [u8]) -> Option<(Ns, &'a [u8])> {
        let length = line.iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
        let (text, rest) = line.split_at(length);
        // A stamp has a fraction and is followed by a blank or colon; anything else may be bytes.
        if !text.contains(&b'.') || !matches!(rest.first(), None | Some(b' ' | b'\t' | b':' | b']' | b',' | b';' | b')')) {
            return None;
        }
        Some((self.seconds(text)?, rest))
    }

    fn date_time<'a>(&mut self, line: &'a [u8], before: &[u8]) -> Option<(Ns, &'a [u8])> {
        let (days, of_day, rest) = match self.last.of(line) {
            Some(known) => known,
            None => self.second(line)?,
        };
        let (part, digits, rest) = fraction(rest, &mut self.seen.short_fractions)?;
        let of_day = of_day + part;
        let (zone, rest) = zone(rest);
        // A colon with a digit behind it goes on: `11:03:00:6b` are bytes.
        let ends = match rest {
            [b':', after, ..] => matches!(after, b' ' | b'\t' | b':'),
            [first, ..] => matches!(first, b' ' | b'\t' | b']' | b')' | b';' | b',' | b'|'),
            [] => true,
        };
        if !ends {
            return None;
        }
        let days = days.or_else(|| words_before(before));
        let time = match (days, zone) {
            (Some(days), Some(offset)) => {
                self.shown(Kind::Utc, digits);
                days * DAY + of_day - offset
            }
            (Some(days), None) => self.local(days * DAY + of_day, digits),
            (None, _) => self.of_day(of_day, digits),
        };
        Some((time, rest))
    }

    /// A date, where there is one, and a time of day in seconds.
    fn second<'a>(&mut self, line: &'a [u8]) -> Option<(Option<i64>, Ns, &'a [u8])> {
        let order = self.seen.order;
        let (days, rest) = match date(line, &mut self.seen.order) {
            Some((days, rest)) => (Some(days), rest),
            None => (None, line),
        };
        let (of_day, rest) = time_of_day(rest)?;
        // A date that tells which of day and month comes first is read anew, until that is known.
        if self.seen.order == order {
            self.last.keep(&line[..line.len() - rest.len()], days, of_day);
        }
        Some((days, of_day, rest))
    }

    /// A time of day: past midnight it begins again.
    fn of_day(&mut self, of_day: Ns, digits: u32) -> Ns {
        if self.seen.last_of_day.is_some_and(|last| last - of_day > DAY / 2) {
            self.seen.days += DAY;
        }
        self.seen.last_of_day = Some(of_day);
        if let Some(day) = self.settings.day {
            return self.local(day * DAY + self.seen.days + of_day, digits);
        }
        self.shown(Kind::TimeOfDay, digits);
        self.seen.days + of_day
    }

    fn local(&mut self, local: Ns, digits: u32) -> Ns {
        let (utc, kind) = self.settings.utc(local);
        self.shown(kind, digits);
        utc
    }

    fn shown(&mut self, kind: Kind, digits: u32) {
        self.seen.kind = self.seen.kind.max(kind);
        self.seen.digits = self.seen.digits.max(digits);
    }
}

/// `+4ms` at the end of a line, as node's `debug` writes it: the time since its line before, rounded from seconds on.
pub(super) fn delta(line: &[u8]) -> Option<Ns> {
    let at = line.iter().rposition(|&b| b == b' ')?;
    let text = line[at + 1..].strip_prefix(b"+")?;
    let digits = text.iter().take_while(|b| b.is_ascii_digit()).count();
    let unit = match &text[digits..] {
        b"ms" => SECOND / 1000,
        b"s" => SECOND,
        b"m" => 60 * SECOND,
        b"h" => 3600 * SECOND,
        b"d" => DAY,
        _ => return None,
    };
    number(&text[..digits])?.checked_mul(unit)
}

/// Seconds as ns, exactly, and the number of decimals.
fn decimal(text: &[u8]) -> Option<(Ns, u32)> {
    let (sign, text) = text.strip_prefix(b"-").map_or((1, text), |rest| (-1, rest));
    let point = text.iter().position(|&b| b == b'.').unwrap_or(text.len());
    let fraction = text.get(point + 1..).unwrap_or(&[]);
    let whole = Some(&text[..point]).filter(|whole| !whole.is_empty() && whole.len() <= 10)?;
    let kept = &fraction[..fraction.len().min(9)];
    if !fraction[kept.len()..].iter().all(u8::is_ascii_digit) {
        return None;
    }
    let part = if kept.is_empty() { 0 } else { number(kept)? * 10i64.pow(9 - kept.len() as u32) };
    Some((sign * number(whole)?.checked_mul(SECOND)?.checked_add(part)?, kept.len() as u32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::clock::day_of;

    fn found(line: &str) -> (Option<Ns>, Kind) {
        let mut stamps = Stamps::default();
        (stamps.find(line.as_bytes()), stamps.kind())
    }

    const NOON: Ns = 1_551_441_600 * SECOND; // 2019-03-01 12:00 UTC, `date -ud 2019-03-01T12:00 +%s`

    #[test]
    fn stamps_of_many_loggers() {
        for (line, ns, kind) in [
            ("2019-03-01 12:00:00.250 DEBUG", NOON + 250_000_000, Kind::Local),
            ("[bus] TRACE 2019/03/01 12:00:00 ", NOON, Kind::Local),
            ("2019-03-01T12:00:00Z host app: ", NOON, Kind::Utc),
            ("2019-03-01T13:00:00,5+01:00 ", NOON + 500_000_000, Kind::Utc),
            ("01 Mar 2019 12:00:00 tty: ", NOON, Kind::Local),
            ("Mar  1 2019 12:00:00 tty: ", NOON, Kind::Local),
            ("01.03.2019 12:00:00.5 ", NOON + 500_000_000, Kind::Local),
            ("[28/02/2019 12:00:00] ", NOON - DAY, Kind::Local),
            ("02/28/2019 12:00:00 ", NOON - DAY, Kind::Local),
            ("28/02/2019@12:00:00.829::Packet", NOON - DAY + 829_000_000, Kind::Local),
            ("Mar  1 12:00:00 host ", DAY / 2, Kind::TimeOfDay),
            ("[12:00:00.25][D][uart:114]: ", DAY / 2 + 250_000_000, Kind::TimeOfDay),
            ("16 12:00:00.25 G ", DAY / 2 + 250_000_000, Kind::TimeOfDay),
            ("[RTU]>Tx > 12:00:00:250 - ", DAY / 2 + 250_000_000, Kind::TimeOfDay),
            ("1551441600.5: ", NOON + 500_000_000, Kind::Utc),
            ("000001.500 RX ", 1_500_000_000, Kind::Relative),
        ] {
            assert_eq!(found(line), (Some(ns), kind), "{line}");
        }
        for line in ["conn[192.168.40.39]: ", "[uart_debug:114]: ", "11:03:00:6b:00:03", "v1.5.2 of x"] {
            assert_eq!(found(line).0, None, "{line}");
        }
    }

    #[test]
    fn a_date_above_twelve_tells_the_order() {
        let mut stamps = Stamps::default();
        stamps.look_ahead(b"01/02/2019 00:00:00 x\n01/31/2019 00:00:00 x\n");
        let first = stamps.find(b"01/02/2019 00:00:00 x").unwrap();
        assert_eq!(first, 1_546_387_200 * SECOND); // 2019-01-02
        let mut stamps = Stamps::default();
        assert_eq!(stamps.find(b"01/02/2019 00:00:00 x").unwrap(), 1_548_979_200 * SECOND);
        // 2019-02-01
    }

    #[test]
    fn a_zone_and_a_date_make_utc() {
        // Berlin: +1, from 2019-03-31 01:00 UTC on +2, from 2019-10-27 01:00 UTC on +1.
        let hour = 3600 * SECOND;
        let zone = vec![(Ns::MIN / 2, hour), (1_553_994_000 * SECOND, 2 * hour), (1_572_138_000 * SECOND, hour)];
        let mut stamps = Stamps::new(Arc::new(ClockSettings { zone, day: day_of("2019-03-01") }));
        assert_eq!(stamps.find(b"13:00:00.000 x"), Some(NOON));
        assert_eq!(stamps.find(b"2019-07-01 14:00:00 x"), Some(1_561_982_400 * SECOND)); // 2019-07-01 12:00 UTC
        assert_eq!(stamps.find(b"2019-10-27 02:30:00 x"), Some(1_572_136_200 * SECOND)); // the first of the two
        assert_eq!(stamps.find(b"2019-10-27 03:30:00 x"), Some(1_572_143_400 * SECOND));
        assert_eq!(stamps.kind(), Kind::Utc);
    }

    #[test]
    fn times_between_lines() {
        assert_eq!(delta(b"buffer: <Buffer 05> } +14ms"), Some(14_000_000));
        assert_eq!(delta(b"x +2s"), Some(2 * SECOND));
        assert_eq!((delta(b"x + 2s"), delta(b"x +2"), delta(b"+2s")), (None, None, None));
    }

    #[test]
    fn socat_prints_microseconds_as_nanoseconds() {
        let mut stamps = Stamps { seen: Seen { short_fractions: true, ..Seen::default() }, ..Stamps::default() };
        assert_eq!(stamps.find(b"12:00:00.000393542 x"), Some(DAY / 2 + 393_542_000));
        assert_eq!(stamps.find(b"12:00:00.393542123 x"), Some(DAY / 2 + 393_542_123));
        assert_eq!(stamps.find(b"12:00:00.000393542 x"), Some(DAY / 2 + 393_542));
    }
}
