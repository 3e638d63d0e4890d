//! When a row was: time of day, time since the start, time since the row before, or the place in the file.
//!
//! The first row decides which of them there is; the head of the column says which it is.

use crate::view::grid::Head;
use crate::view::{Times, Zone};
use modlens_protocol::source::Place;
use modlens_protocol::timestamp::push_time;
use modlens_protocol::Ns;
use modlens_tables::columns::{Cell, RowRef, TableKind};

const SECOND: Ns = 1_000_000_000;

/// Zones change at whole minutes, and to ask for one costs more than a row.
const ASKED_FOR: Ns = 60 * SECOND;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Clock,
    Elapsed,
    Delta,
    Place,
}

/// The time column of one table.
pub struct Moments {
    kind: Kind,
    title: String,
    digits: usize,
    time: Option<usize>,
    elapsed: usize,
    source: Option<usize>,
    zone: Zone,
    /// From which moment on which shift was last asked for.
    known: Option<(Ns, Ns)>,
    day: String,
    before: Option<f64>,
}

impl Moments {
    /// What there is to be said of rows like this one, with so many digits of a second.
    pub fn new(wanted: Times, table: TableKind, first: &RowRef<'_>, digits: usize, zone: Zone) -> Self {
        let column = |key| table.column(key).ok();
        let elapsed = column("elapsed_us").expect("every table has it");
        let mut made = Self {
            kind: Kind::Place,
            title: String::new(),
            digits,
            time: column("time"),
            elapsed,
            source: column("source"),
            zone,
            known: None,
            day: String::new(),
            before: None,
        };
        let relative = made.elapsed_us(first).is_some();
        match (wanted, made.time(first)) {
            (Times::Clock, Some(ns)) => {
                made.kind = Kind::Clock;
                made.title = format!("time {}", zone_text(made.shift(ns)));
            }
            (Times::Delta, _) if relative => (made.kind, made.title) = (Kind::Delta, "delta s".into()),
            _ if relative => (made.kind, made.title) = (Kind::Elapsed, "elapsed s".into()),
            _ => made.title = made.place(first).map_or("place", |(place, _)| place_name(place)).into(),
        }
        made
    }

    /// The head of the column.
    pub fn head(&self) -> Head {
        let least = match self.kind {
            Kind::Clock => "00:00:00.".len() + self.digits,
            Kind::Place => 7,
            Kind::Elapsed | Kind::Delta => 5 + self.digits,
        };
        Head::right(&self.title, least)
    }

    /// The cell of a row.
    pub fn cell(&mut self, row: &RowRef<'_>) -> String {
        match self.kind {
            Kind::Clock => self.time(row).map_or_else(String::new, |ns| self.local(ns)[11..=19 + self.digits].to_owned()),
            Kind::Place => self.place(row).map_or_else(String::new, |(_, number)| number.to_string()),
            Kind::Elapsed => self.elapsed_us(row).map_or_else(String::new, |us| self.seconds(us)),
            Kind::Delta => {
                let us = self.elapsed_us(row);
                us.map_or_else(String::new, |us| self.seconds(us - self.before.unwrap_or(us)))
            }
        }
    }

    /// The date, if it is another than that of the row before.
    pub fn day(&mut self, row: &RowRef<'_>) -> Option<String> {
        let ns = self.time(row).filter(|_| self.kind == Kind::Clock)?;
        let mut text = self.local(ns);
        text.truncate(10);
        if text == self.day {
            return None;
        }
        self.day.clone_from(&text);
        Some(text)
    }

    /// The row has been printed: the next one counts from it.
    pub fn advance(&mut self, row: &RowRef<'_>) {
        if self.kind == Kind::Delta {
            self.before = self.elapsed_us(row);
        }
    }

    fn time(&self, row: &RowRef<'_>) -> Option<Ns> {
        match self.time.map(|column| row.cell(column)) {
            Some(Cell::Time(ns)) => Some(ns),
            _ => None,
        }
    }

    fn elapsed_us(&self, row: &RowRef<'_>) -> Option<f64> {
        match row.cell(self.elapsed) {
            Cell::Us(ns) => Some(ns as f64 / 1e3),
            _ => None,
        }
    }

    fn place(&self, row: &RowRef<'_>) -> Option<(Place, u64)> {
        match self.source.map(|column| row.cell(column)) {
            Some(Cell::Source(_, place, number)) => Some((place, number)),
            _ => None,
        }
    }

    fn seconds(&self, us: f64) -> String {
        format!("{:.*}", self.digits, us / 1e6)
    }

    /// `2026-11-21T10:00:00.123456...` where the reader is. Digits are cut, not rounded: a clock does not run ahead.
    fn local(&mut self, ns: Ns) -> String {
        let mut out = Vec::with_capacity(32);
        push_time(ns + self.shift(ns), &mut out);
        String::from_utf8(out).unwrap_or_default()
    }

    /// How far clocks are ahead of UTC there and then.
    fn shift(&mut self, ns: Ns) -> Ns {
        match self.known {
            Some((from, shift)) if (from..from + ASKED_FOR).contains(&ns) => shift,
            _ => {
                let from = ns.div_euclid(ASKED_FOR) * ASKED_FOR;
                let shift = (self.zone)(from);
                self.known = Some((from, shift));
                shift
            }
        }
    }
}

fn place_name(place: Place) -> &'static str {
    match place {
        Place::Offset => "offset",
        Place::Line => "line",
        Place::Packet => "packet",
    }
}

/// A shift as `+02:00`; `UTC` where there is none.
fn zone_text(shift: Ns) -> String {
    if shift == 0 {
        return "UTC".into();
    }
    let minutes = shift.div_euclid(60 * SECOND);
    let sign = if minutes < 0 { '-' } else { '+' };
    format!("{sign}{:02}:{:02}", minutes.abs() / 60, minutes.abs() % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_are_named_by_their_shift() {
        assert_eq!(zone_text(0), "UTC");
        assert_eq!(zone_text(7200 * SECOND), "+02:00");
        assert_eq!(zone_text(-12_600 * SECOND), "-03:30");
    }
}
