//! The time column of a table: time of day, time since the start, time since the previous row, or the position in the
//! file if there are no times.
//!
//! The first row decides which of these is shown; the title of the column names it.

use crate::view::grid::ColumnHead;
use crate::view::notation::{TimeDisplay, Zone};
use crate::view::room::Room;
use modlens_protocol::source::Place;
use modlens_protocol::timestamp::push_time;
use modlens_protocol::Ns;
use modlens_tables::columns::{Cell, RowRef, TableKind};

const SECOND_NS: Ns = 1_000_000_000;

/// The time zone is looked up once per this time, in ns: looking it up costs more than a row, and zones change only at
/// full minutes.
const ZONE_LOOKUP_NS: Ns = 60 * SECOND_NS;

/// The content of the column.
#[derive(Clone, Copy, PartialEq, Eq)]
enum TimeColumnContent {
    Clock,
    Elapsed,
    Delta,
    Place,
}

/// The time column of one table.
pub struct TimeColumn {
    content: TimeColumnContent,
    title: String,
    digits: usize,
    time: Option<usize>,
    elapsed: Option<usize>,
    source: Option<usize>,
    zone: Zone,
    /// The last lookup of the time zone: from when on it applies, and its offset from UTC, in ns.
    cached_offset: Option<(Ns, Ns)>,
    day: String,
    previous_us: Option<f64>,
}

impl TimeColumn {
    /// A time column for rows like `first`, with as many decimals of a second as there is room for. Falls back to elapsed
    /// time or position if the wanted times are not known.
    pub fn new(wanted: TimeDisplay, table: TableKind, first: &RowRef<'_>, room: Room, zone: Zone) -> Self {
        let column = |key| table.column(key).ok();
        let mut column = Self {
            content: TimeColumnContent::Place,
            title: String::new(),
            digits: if room.is_wide() { 6 } else { 3 },
            time: column(table.time_column()),
            elapsed: column("elapsed_us"),
            source: column("source"),
            zone,
            cached_offset: None,
            day: String::new(),
            previous_us: None,
        };
        let relative = column.elapsed_us(first).is_some();
        match (wanted, column.time(first)) {
            (TimeDisplay::Clock, Some(ns)) => {
                column.content = TimeColumnContent::Clock;
                let zone = zone_text(column.utc_offset(ns));
                column.title = if room == Room::Narrow { zone } else { format!("time {zone}") };
                if room == Room::Narrow {
                    column.digits = 0;
                }
            }
            (TimeDisplay::Delta, _) if relative => (column.content, column.title) = (TimeColumnContent::Delta, "delta s".into()),
            _ if relative => (column.content, column.title) = (TimeColumnContent::Elapsed, "elapsed s".into()),
            _ if table == TableKind::Diagnoses => column.title = "since".into(),
            _ => column.title = column.position(first).map_or("place", |(position, _)| position_name(position)).into(),
        }
        column
    }

    /// The head of the column.
    pub fn head(&self) -> ColumnHead {
        let least = match self.content {
            TimeColumnContent::Clock => self.clock_width(),
            TimeColumnContent::Place => 7,
            TimeColumnContent::Elapsed | TimeColumnContent::Delta => 5 + self.digits,
        };
        ColumnHead::right(&self.title, least)
    }

    /// The text of a row's cell.
    pub fn cell(&mut self, row: &RowRef<'_>) -> String {
        match self.content {
            TimeColumnContent::Clock => {
                self.time(row).map_or_else(String::new, |ns| self.local(ns)[11..11 + self.clock_width()].to_owned())
            }
            TimeColumnContent::Place => self.position(row).map_or_else(String::new, |(_, number)| number.to_string()),
            TimeColumnContent::Elapsed => self.elapsed_us(row).map_or_else(String::new, |us| self.seconds(us)),
            TimeColumnContent::Delta => {
                let us = self.elapsed_us(row);
                us.map_or_else(String::new, |us| self.seconds(us - self.previous_us.unwrap_or(us)))
            }
        }
    }

    /// The date of a row, if it differs from that of the row before.
    pub fn day(&mut self, row: &RowRef<'_>) -> Option<String> {
        let ns = self.time(row).filter(|_| self.content == TimeColumnContent::Clock)?;
        let mut text = self.local(ns);
        text.truncate(10);
        if text == self.day {
            return None;
        }
        self.day.clone_from(&text);
        Some(text)
    }

    /// Ends a row: times since the previous row count from it now.
    pub fn advance(&mut self, row: &RowRef<'_>) {
        if self.content == TimeColumnContent::Delta {
            self.previous_us = self.elapsed_us(row);
        }
    }

    /// The time of a row, if its clock is UTC.
    fn time(&self, row: &RowRef<'_>) -> Option<Ns> {
        match self.time.map(|column| row.cell(column)) {
            Some(Cell::Time(ns)) => Some(ns),
            _ => None,
        }
    }

    /// The time of a row since the start, in microseconds.
    fn elapsed_us(&self, row: &RowRef<'_>) -> Option<f64> {
        match self.elapsed.map(|column| row.cell(column)) {
            Some(Cell::Us(ns)) => Some(ns as f64 / 1e3),
            _ => None,
        }
    }

    /// The position of a row in the input.
    fn position(&self, row: &RowRef<'_>) -> Option<(Place, u64)> {
        match self.source.map(|column| row.cell(column)) {
            Some(Cell::Source(_, position, number)) => Some((position, number)),
            _ => None,
        }
    }

    /// The width of a time of day: hours to seconds, and the decimals after a point.
    fn clock_width(&self) -> usize {
        "00:00:00".len() + if self.digits > 0 { 1 + self.digits } else { 0 }
    }

    /// A duration in seconds, with the decimals of the column.
    fn seconds(&self, us: f64) -> String {
        format!("{:.*}", self.digits, us / 1e6)
    }

    /// The local time: `2026-11-21T10:00:00.123456...`. Its digits are cut later, not rounded, so that no time is later
    /// than the event.
    fn local(&mut self, ns: Ns) -> String {
        let mut out = Vec::with_capacity(32);
        push_time(ns + self.utc_offset(ns), &mut out);
        String::from_utf8(out).unwrap_or_default()
    }

    /// The offset of local time from UTC at a time, in ns.
    fn utc_offset(&mut self, ns: Ns) -> Ns {
        match self.cached_offset {
            Some((from, utc_offset)) if (from..from + ZONE_LOOKUP_NS).contains(&ns) => utc_offset,
            _ => {
                let from = ns.div_euclid(ZONE_LOOKUP_NS) * ZONE_LOOKUP_NS;
                let utc_offset = (self.zone)(from);
                self.cached_offset = Some((from, utc_offset));
                utc_offset
            }
        }
    }
}

/// The title of the column if it shows positions.
fn position_name(position: Place) -> &'static str {
    match position {
        Place::Offset => "offset",
        Place::Line => "line",
        Place::Packet => "packet",
    }
}

/// An offset from UTC as `+02:00`; `UTC` for zero.
fn zone_text(utc_offset: Ns) -> String {
    if utc_offset == 0 {
        return "UTC".into();
    }
    let minutes = utc_offset.div_euclid(60 * SECOND_NS);
    let sign = if minutes < 0 { '-' } else { '+' };
    format!("{sign}{:02}:{:02}", minutes.abs() / 60, minutes.abs() % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_are_named_by_their_offset_from_utc() {
        assert_eq!(zone_text(0), "UTC");
        assert_eq!(zone_text(7200 * SECOND_NS), "+02:00");
        assert_eq!(zone_text(-12_600 * SECOND_NS), "-03:30");
    }
}
