//! Finds and parses the timestamps of log lines, and learns from them what kind of clock the log has.

use std::sync::Arc;

use crate::text::cached_second::CachedSecond;
use crate::text::clock::{ClockKind, ClockSettings};
use crate::text::date::{date, date_in_words, fraction, number, time_of_day, zone, DateOrder, POWERS_OF_TEN};
use crate::text::decimal::{decimal, digits, SECOND_NS};
use crate::text::{json_times, ticks};
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

const DAY_NS: Ns = 86_400 * SECOND_NS;

/// A number of seconds from this on (March 1973) counts since 1970, a smaller one since the start of the recording, as
/// the chunk log defines it.
const LEAST_EPOCH_NS: Ns = 100_000_000 * SECOND_NS;

/// The most digits of a number of seconds, and after its point.
const MAX_WHOLE_DIGITS: usize = 10;
const MAX_DECIMALS: usize = 9;

/// A timestamp is searched for in so many characters in front of the bytes.
const MAX_PREFIX_CHARS: usize = 200;

/// Parses the timestamps of one recording. What one of them shows (the clock, the order of day and month) holds for the
/// next ones.
#[derive(Clone, Debug, Default)]
pub struct TimestampParser {
    settings: Arc<ClockSettings>,
    pub(super) state: TimestampState,
    cached_second: CachedSecond,
}

/// What timestamps have shown so far. It is copied before a template is tried and restored if the template does not fit,
/// so that a line which turns out to be something else teaches nothing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TimestampState {
    kind: ClockKind,
    order: DateOrder,
    /// Nanoseconds to add to times of day, a whole day for each midnight that has passed.
    midnights_ns: Ns,
    /// The last time of day, to notice midnight.
    last_ns_of_day: Option<Ns>,
    /// The most decimals of a second.
    decimals: u32,
    /// Fractions of nine digits may be microseconds (socat 1.7).
    pub(super) short_fractions: bool,
    /// Position of the last timestamp in its line, where the next one is tried first.
    last_position: usize,
    /// Whole numbers in front of lines are milliseconds since any start.
    has_ticks: bool,
    /// The sum of the printed differences, in a log that prints only the time since the line before.
    delta_sum_ns: Ns,
}

/// One of the timestamps of a line.
#[derive(Clone, Copy, Debug)]
struct Stamp {
    time: Ns,
    kind: ClockKind,
    decimals: u32,
    state: TimestampState,
}

impl TimestampParser {
    /// A parser for one recording; `settings` is what the operator knows of its clock.
    pub fn new(settings: Arc<ClockSettings>) -> Self {
        Self { settings, ..Self::default() }
    }

    /// The clock as the engine needs to know it: absolute, relative or none.
    #[inline]
    pub fn clock(&self) -> Clock {
        match self.state.kind {
            ClockKind::None => Clock::None,
            ClockKind::Utc => Clock::Utc,
            _ => Clock::Relative,
        }
    }

    /// What the timestamps so far refer to, as messages say.
    pub fn kind(&self) -> ClockKind {
        self.state.kind
    }

    /// The smallest time difference in ns that the decimals of the timestamps can express; `None` without timestamps.
    #[inline]
    pub fn resolution(&self) -> Option<Ns> {
        (self.state.kind != ClockKind::None).then(|| 10i64.pow(9 - self.state.decimals.min(9)))
    }

    /// Reads the timestamps of text that comes later, to learn whether the day or the month comes first and whether nine
    /// decimals are microseconds. Without this the first lines of a file would be read differently from the later ones.
    pub fn look_ahead(&mut self, lines: &[u8]) {
        for line in lines.split(|&b| b == b'\n').take(2000) {
            let start = TimestampState {
                order: self.state.order,
                short_fractions: self.state.short_fractions,
                ..TimestampState::default()
            };
            let mut ahead = Self { settings: Arc::clone(&self.settings), state: start, ..Self::default() };
            ahead.find(line);
            self.state.order = ahead.state.order;
            self.state.short_fractions = ahead.state.short_fractions;
        }
        self.state.has_ticks = ticks::are_times(lines.split(|&b| b == b'\n'));
        self.cached_second = CachedSecond::default();
    }

    /// Parses a number of seconds, since 1970 or since any start.
    pub fn seconds(&mut self, text: &[u8]) -> Option<Ns> {
        let (ns, decimals) = decimal(text)?;
        self.note_clock(if ns >= LEAST_EPOCH_NS { ClockKind::Utc } else { ClockKind::Relative }, decimals);
        Some(ns)
    }

    /// Parses a number of milliseconds or other parts of a second, since any start or since 1970.
    pub fn count(&mut self, text: &[u8], unit: Ns, decimals: u32) -> Option<Ns> {
        let value = number(text)?.checked_mul(unit)?;
        self.note_clock(if value >= LEAST_EPOCH_NS { ClockKind::Utc } else { ClockKind::Relative }, decimals);
        Some(value)
    }

    /// Parses a number that is known to be a time: seconds with a fraction, or seconds, milliseconds, microseconds or
    /// nanoseconds since 1970, which have 10, 13, 16 and 19 digits from 2001 to 2286.
    pub fn number_of_time(&mut self, text: &[u8]) -> Option<Ns> {
        match text.len() {
            _ if text.contains(&b'.') => self.seconds(text),
            10 => self.seconds(text),
            13 => self.count(text, 1_000_000, 3),
            16 => self.count(text, 1000, 6),
            19 => self.count(text, 1, 9),
            _ => None,
        }
    }

    /// Adds a difference that the log prints instead of a time, and returns the sum of all of them.
    pub fn add_delta(&mut self, delta: Ns) -> Ns {
        self.note_clock(ClockKind::Relative, 3);
        self.state.delta_sum_ns = self.state.delta_sum_ns.saturating_add(delta);
        self.state.delta_sum_ns
    }

    /// Lets the sum of the differences begin again.
    pub fn restart_deltas(&mut self) {
        self.state.delta_sum_ns = 0;
    }

    /// Parses a timestamp at the start of the line, in brackets or not; returns it and the rest of the line.
    pub fn take_leading<'a>(&mut self, line: &'a [u8]) -> (Option<Ns>, &'a [u8]) {
        if !line.first().is_some_and(|b| b.is_ascii_digit() || *b == b'[') {
            return (None, line);
        }
        let inner = line.strip_prefix(b"[").unwrap_or(line);
        let bracket = inner.len() < line.len();
        let end = |rest: &'a [u8]| if bracket { rest.strip_prefix(b"]") } else { Some(rest) };
        let found = self.date_time(inner, &[]).or_else(|| self.seconds_stamp(inner));
        match found.and_then(|(time, rest)| Some((time, end(rest)?))) {
            Some((time, rest)) => (Some(time), rest),
            None => self.milliseconds(line).map_or((None, line), |(time, rest)| (Some(time), rest)),
        }
    }

    /// Parses a whole number of milliseconds at the start of the line; one since any start only where the text has shown that
    /// such numbers are times.
    fn milliseconds<'a>(&mut self, line: &'a [u8]) -> Option<(Ns, &'a [u8])> {
        let ticks = if self.state.has_ticks { ticks::since_start(line) } else { None };
        let (text, rest) = ticks.or_else(|| ticks::since_1970(line))?;
        Some((self.count(text, 1_000_000, 3)?, rest))
    }

    /// Parses a number of seconds with a fraction at the start of the line, if one blank and a hex digit follow; returns the
    /// time and the position of that digit. It is what `take_leading` would return, which first looks for a date and a time of
    /// day: these have separators at places where a number has digits. `None` also for numbers that `take_leading` takes.
    pub fn leading_seconds(&mut self, line: &[u8]) -> Option<(Ns, usize)> {
        let (whole, point) = digits(line, MAX_WHOLE_DIGITS);
        let (fraction, decimals) = digits(line.get(point + 1..).filter(|_| line[point] == b'.')?, MAX_DECIMALS);
        let end = point + 1 + decimals;
        let is_number = point > 0 && decimals > 0 && line.get(end) == Some(&b' ');
        if !is_number || !line.get(end + 1).is_some_and(u8::is_ascii_hexdigit) {
            return None;
        }
        let ns = whole.checked_mul(SECOND_NS)?.checked_add(fraction * POWERS_OF_TEN[MAX_DECIMALS - decimals])?;
        self.note_clock(if ns >= LEAST_EPOCH_NS { ClockKind::Utc } else { ClockKind::Relative }, decimals as u32);
        Some((ns, end + 1))
    }

    /// Parses a negative number of seconds at the start of the line, such as `-0.00125`, which a recorder writes for what
    /// came before its trigger; returns the time and the rest of the line.
    pub fn before_start<'a>(&mut self, line: &'a [u8]) -> (Option<Ns>, &'a [u8]) {
        match self.seconds_stamp(&line[1..]) {
            Some((time, rest)) => (Some(-time), rest),
            None => (None, line),
        }
    }

    /// Finds a timestamp anywhere in the text that is in front of the bytes. Of several the finest counts, such as that of
    /// a program after that of the journal.
    pub fn find(&mut self, front: &[u8]) -> Option<Ns> {
        if front.len() < 4 {
            return None;
        }
        let front = &front[..front.len().min(MAX_PREFIX_CHARS)];
        let start = self.state;
        // It nearly always stands where it stood in the line before, and is as fine.
        let is_fine = |one: &Stamp| start.kind != ClockKind::None && (one.decimals, one.kind) >= (start.decimals, start.kind);
        let usual = self.stamp_at(front, start.last_position, &start);
        let found = usual.filter(is_fine).or_else(|| {
            let all = (0..front.len()).filter_map(|at| self.stamp_at(front, at, &start));
            all.reduce(|best, one| if (one.decimals, one.kind) > (best.decimals, best.kind) { one } else { best })
        });
        self.state = start;
        if let Some(Stamp { time, kind, decimals, state }) = found {
            self.state = TimestampState { kind: start.kind, decimals: start.decimals, ..state };
            self.note_clock(kind, decimals);
            return Some(time);
        }
        let text = front.trim_ascii_start();
        if let Some((time, _)) = self.milliseconds(text) {
            return Some(time);
        }
        if text.first() == Some(&b'{') {
            return json_times::number(text).and_then(|number| self.number_of_time(number));
        }
        let text = text.strip_prefix(b"[").or_else(|| text.strip_prefix(b"(")).unwrap_or(text).trim_ascii_start();
        let text = text.strip_prefix(b"+").unwrap_or(text);
        self.seconds_stamp(text).or_else(|| self.count_stamp(text)).map(|(time, _)| time)
    }

    /// The date and time at position `at` with what it shows, if the parser is in the state `start` before it.
    fn stamp_at(&mut self, front: &[u8], at: usize, start: &TimestampState) -> Option<Stamp> {
        self.state = TimestampState { kind: ClockKind::None, decimals: 0, last_position: at, ..*start };
        let (time, _) = self.date_time_at(front, at)?;
        Some(Stamp { time, kind: self.state.kind, decimals: self.state.decimals, state: self.state })
    }

    /// Parses a number of milliseconds, microseconds or seconds with its unit at the start of the line, such as `145ms`.
    fn count_stamp<'a>(&mut self, line: &'a [u8]) -> Option<(Ns, &'a [u8])> {
        let digits = line.iter().take_while(|b| b.is_ascii_digit()).count();
        let (text, rest) = line.split_at(digits);
        let units: [(&[u8], Ns, u32); 4] =
            [(b"ms", 1_000_000, 3), (b"us", 1000, 6), ("\u{b5}s".as_bytes(), 1000, 6), (b"s", SECOND_NS, 0)];
        let (unit, ns, decimals) = units.into_iter().find(|(unit, ..)| rest.starts_with(unit))?;
        let rest = &rest[unit.len()..];
        // Words such as `12 seconds` are no stamps.
        if rest.first().is_some_and(u8::is_ascii_alphanumeric) {
            return None;
        }
        let time = number(text)?.checked_mul(ns)?;
        self.note_clock(ClockKind::Relative, decimals);
        Some((time, rest))
    }

    /// Parses the date and time at position `at`, which has to be the start of a word.
    fn date_time_at<'a>(&mut self, front: &'a [u8], at: usize) -> Option<(Ns, &'a [u8])> {
        let is_start = front.get(at).is_some_and(u8::is_ascii_digit) && (at == 0 || !front[at - 1].is_ascii_alphanumeric());
        if is_start {
            self.date_time(&front[at..], &front[..at])
        } else {
            None
        }
    }

    /// Parses a timestamp in seconds with a fraction at the start of the line.
    fn seconds_stamp<'a>(&mut self, line: &'a [u8]) -> Option<(Ns, &'a [u8])> {
        let length = line.iter().take_while(|b| b.is_ascii_digit() || **b == b'.').count();
        let (text, rest) = line.split_at(length);
        // A timestamp in seconds has a fraction and is followed by a space or punctuation; anything else may be bytes, or the
        // number of an item, as in `2. The device responds`.
        if !text.contains(&b'.')
            || text.ends_with(b".")
            || !matches!(rest.first(), None | Some(b' ' | b'\t' | b':' | b']' | b',' | b';' | b')'))
        {
            return None;
        }
        Some((self.seconds(text)?, rest))
    }

    /// Parses a time of day with an optional date in front and an optional zone after it. `before` is the text before
    /// `line`, where a date with a month name may stand. Returns the time in ns and the rest of the line.
    fn date_time<'a>(&mut self, line: &'a [u8], before: &[u8]) -> Option<(Ns, &'a [u8])> {
        let (days, ns_of_day, rest) = match self.cached_second.lookup(line) {
            Some(known) => known,
            None => self.date_and_second(line)?,
        };
        let (fraction_ns, decimals, rest) = fraction(rest, &mut self.state.short_fractions)?;
        let ns_of_day = ns_of_day + fraction_ns;
        let (zone, rest) = zone(rest);
        // A colon with a digit after it continues a list of bytes, as in `11:03:00:6b`.
        let is_end = match rest {
            [b':', next, ..] => matches!(next, b' ' | b'\t' | b':'),
            [first, ..] => matches!(first, b' ' | b'\t' | b']' | b')' | b';' | b',' | b'|'),
            [] => true,
        };
        if !is_end {
            return None;
        }
        let days = days.or_else(|| date_in_words(before));
        let time = match (days, zone) {
            (Some(days), Some(offset)) => {
                self.note_clock(ClockKind::Utc, decimals);
                days * DAY_NS + ns_of_day - offset
            }
            (Some(days), None) => self.local(days * DAY_NS + ns_of_day, decimals),
            (None, _) => self.time_without_date(ns_of_day, decimals),
        };
        Some((time, rest))
    }

    /// Parses an optional date and a time of day down to seconds: days since 1970-01-01, nanoseconds since midnight, and the
    /// rest of the line.
    fn date_and_second<'a>(&mut self, line: &'a [u8]) -> Option<(Option<i64>, Ns, &'a [u8])> {
        let order = self.state.order;
        let (days, rest) = match date(line, &mut self.state.order) {
            Some((days, rest)) => (Some(days), rest),
            None => (None, line),
        };
        let (ns_of_day, rest) = time_of_day(rest)?;
        // A date that has just settled the order of day and month is not cached: it was parsed with the old order.
        if self.state.order == order {
            self.cached_second.store(&line[..line.len() - rest.len()], days, ns_of_day);
        }
        Some((days, ns_of_day, rest))
    }

    /// Converts a time of day without date to ns since the first midnight, or to UTC if the operator named the day. A step
    /// back by more than half a day means that midnight has passed.
    fn time_without_date(&mut self, ns_of_day: Ns, decimals: u32) -> Ns {
        if self.state.last_ns_of_day.is_some_and(|last| last - ns_of_day > DAY_NS / 2) {
            self.state.midnights_ns += DAY_NS;
        }
        self.state.last_ns_of_day = Some(ns_of_day);
        if let Some(day) = self.settings.day {
            return self.local(day * DAY_NS + self.state.midnights_ns + ns_of_day, decimals);
        }
        self.note_clock(ClockKind::TimeOfDay, decimals);
        self.state.midnights_ns + ns_of_day
    }

    /// Converts a local time to UTC with the operator's zone, if there is one.
    fn local(&mut self, local: Ns, decimals: u32) -> Ns {
        let (utc, kind) = self.settings.utc(local);
        self.note_clock(kind, decimals);
        utc
    }

    /// Records what a timestamp has shown; the best kind of clock and the most decimals count.
    fn note_clock(&mut self, kind: ClockKind, decimals: u32) {
        self.state.kind = self.state.kind.max(kind);
        self.state.decimals = self.state.decimals.max(decimals);
    }
}

/// Parses `+4ms` at the end of a line, the time since the line before as Node's `debug` module prints it (rounded to whole
/// seconds, minutes, hours or days where it is longer).
pub(super) fn delta(line: &[u8]) -> Option<Ns> {
    let at = line.iter().rposition(|&b| b == b' ')?;
    let text = line[at + 1..].strip_prefix(b"+")?;
    let decimals = text.iter().take_while(|b| b.is_ascii_digit()).count();
    let unit = match &text[decimals..] {
        b"ms" => SECOND_NS / 1000,
        b"s" => SECOND_NS,
        b"m" => 60 * SECOND_NS,
        b"h" => 3600 * SECOND_NS,
        b"d" => DAY_NS,
        _ => return None,
    };
    number(&text[..decimals])?.checked_mul(unit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::clock::day_of;

    #[test]
    fn the_number_of_an_item_is_no_time() {
        assert_eq!(found("2. El esclavo responde: ").0, None);
        assert_eq!(found("2.5 El esclavo responde: ").0, Some(2_500_000_000));
    }

    fn found(line: &str) -> (Option<Ns>, ClockKind) {
        let mut timestamps = TimestampParser::default();
        (timestamps.find(line.as_bytes()), timestamps.kind())
    }

    const NOON: Ns = 1_551_441_600 * SECOND_NS; // 2019-03-01 12:00 UTC, `date -ud 2019-03-01T12:00 +%s`

    #[test]
    fn timestamps_of_many_loggers_are_parsed() {
        for (line, ns, kind) in [
            ("2019-03-01 12:00:00.250 DEBUG", NOON + 250_000_000, ClockKind::Local),
            ("[bus] TRACE 2019/03/01 12:00:00 ", NOON, ClockKind::Local),
            ("2019-03-01T12:00:00Z host app: ", NOON, ClockKind::Utc),
            ("2019-03-01T13:00:00,5+01:00 ", NOON + 500_000_000, ClockKind::Utc),
            ("01 Mar 2019 12:00:00 tty: ", NOON, ClockKind::Local),
            ("Mar  1 2019 12:00:00 tty: ", NOON, ClockKind::Local),
            ("01.03.2019 12:00:00.5 ", NOON + 500_000_000, ClockKind::Local),
            ("[28/02/2019 12:00:00] ", NOON - DAY_NS, ClockKind::Local),
            ("02/28/2019 12:00:00 ", NOON - DAY_NS, ClockKind::Local),
            ("28/02/2019@12:00:00.829::Packet", NOON - DAY_NS + 829_000_000, ClockKind::Local),
            ("Mar  1 12:00:00 host ", DAY_NS / 2, ClockKind::TimeOfDay),
            ("[12:00:00.25][D][uart:114]: ", DAY_NS / 2 + 250_000_000, ClockKind::TimeOfDay),
            ("16 12:00:00.25 G ", DAY_NS / 2 + 250_000_000, ClockKind::TimeOfDay),
            ("[RTU]>Tx > 12:00:00:250 - ", DAY_NS / 2 + 250_000_000, ClockKind::TimeOfDay),
            ("1551441600.5: ", NOON + 500_000_000, ClockKind::Utc),
            ("000001.500 RX ", 1_500_000_000, ClockKind::Relative),
            ("145ms TX: ", 145_000_000, ClockKind::Relative),
            ("Mar 01 11:59:59 host ha[691]: 2019-03-01 12:00:00.250 DEBUG send: ", NOON + 250_000_000, ClockKind::Local),
            ("2019-03-01T12:00:00.250Z app 11:22:33 x ", NOON + 250_000_000, ClockKind::Utc),
        ] {
            assert_eq!(found(line), (Some(ns), kind), "{line}");
        }
        for line in ["conn[192.168.40.39]: ", "[uart_debug:114]: ", "11:03:00:6b:00:03", "v1.5.2 of x"] {
            assert_eq!(found(line).0, None, "{line}");
        }
    }

    #[test]
    fn a_day_above_twelve_settles_the_order_of_day_and_month() {
        let mut timestamps = TimestampParser::default();
        timestamps.look_ahead(b"01/02/2019 00:00:00 x\n01/31/2019 00:00:00 x\n");
        let first = timestamps.find(b"01/02/2019 00:00:00 x").unwrap();
        assert_eq!(first, 1_546_387_200 * SECOND_NS); // 2019-01-02
        let mut timestamps = TimestampParser::default();
        assert_eq!(timestamps.find(b"01/02/2019 00:00:00 x").unwrap(), 1_548_979_200 * SECOND_NS);
        // 2019-02-01
    }

    #[test]
    fn a_zone_and_a_date_make_utc() {
        // Berlin: +1, from 2019-03-31 01:00 UTC on +2, from 2019-10-27 01:00 UTC on +1.
        let hour = 3600 * SECOND_NS;
        let zone = vec![(Ns::MIN / 2, hour), (1_553_994_000 * SECOND_NS, 2 * hour), (1_572_138_000 * SECOND_NS, hour)];
        let mut timestamps = TimestampParser::new(Arc::new(ClockSettings { zone, day: day_of("2019-03-01") }));
        assert_eq!(timestamps.find(b"13:00:00.000 x"), Some(NOON));
        assert_eq!(timestamps.find(b"2019-07-01 14:00:00 x"), Some(1_561_982_400 * SECOND_NS)); // 2019-07-01 12:00 UTC
        assert_eq!(timestamps.find(b"2019-10-27 02:30:00 x"), Some(1_572_136_200 * SECOND_NS)); // the first of the two
        assert_eq!(timestamps.find(b"2019-10-27 03:30:00 x"), Some(1_572_143_400 * SECOND_NS));
        assert_eq!(timestamps.kind(), ClockKind::Utc);
    }

    #[test]
    fn whole_numbers_in_front_are_times_where_the_text_shows_it() {
        let mut timestamps = TimestampParser::default();
        assert_eq!(timestamps.find(b"I (12345) mb: rx "), None);
        timestamps.look_ahead(b"I (12345) mb: rx 05\nI (12365) mb: tx 05\n");
        assert_eq!(timestamps.find(b"I (12345) mb: rx "), Some(12_345_000_000));
        assert_eq!(timestamps.take_leading(b"[12345] > 05"), (Some(12_345_000_000), &b" > 05"[..]));
        assert_eq!(timestamps.kind(), ClockKind::Relative);
        assert_eq!(TimestampParser::default().find(b"1551441600500 TX: "), Some(NOON + 500_000_000));
    }

    #[test]
    fn differences_to_the_line_before_are_parsed() {
        assert_eq!(delta(b"buffer: <Buffer 05> } +14ms"), Some(14_000_000));
        assert_eq!(delta(b"x +2s"), Some(2 * SECOND_NS));
        assert_eq!((delta(b"x + 2s"), delta(b"x +2"), delta(b"+2s")), (None, None, None));
    }

    #[test]
    fn socat_prints_microseconds_as_nanoseconds() {
        let mut timestamps = TimestampParser {
            state: TimestampState { short_fractions: true, ..TimestampState::default() },
            ..TimestampParser::default()
        };
        assert_eq!(timestamps.find(b"12:00:00.000393542 x"), Some(DAY_NS / 2 + 393_542_000));
        assert_eq!(timestamps.find(b"12:00:00.393542123 x"), Some(DAY_NS / 2 + 393_542_123));
        assert_eq!(timestamps.find(b"12:00:00.000393542 x"), Some(DAY_NS / 2 + 393_542));
    }
}
