//! What kind of clock a log has, and the time zone and date that the operator supplies for it.

use crate::text::date::{date, two_digits, DateOrder};
use modlens_protocol::Ns;

/// What the operator has said about the clock of a recording.
#[derive(Clone, Debug, Default)]
pub struct ClockSettings {
    /// The time zone of timestamps that state none, as (UTC moment from which the offset holds, offset to UTC), both in ns,
    /// oldest first.
    pub zone: Vec<(Ns, Ns)>,
    /// The day (counted from 1970-01-01) of the first timestamp that is a time of day only.
    pub day: Option<i64>,
}

/// What the timestamps of a log refer to, from the least to the most precise; a log is as good as its best timestamp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ClockKind {
    /// The log has no timestamps.
    #[default]
    None,
    /// Seconds since an unknown start.
    Relative,
    /// A time of day without a date.
    TimeOfDay,
    /// A date and a time without a zone.
    Local,
    /// A date, a time and a zone.
    Utc,
}

impl ClockKind {
    /// The name shown to users.
    pub fn text(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Relative => "relative",
            Self::TimeOfDay => "time of day",
            Self::Local => "local",
            Self::Utc => "utc",
        }
    }
}

impl ClockSettings {
    /// Converts a local time (ns since 1970) to UTC; without a known zone the time is returned unchanged.
    pub fn utc(&self, local: Ns) -> (Ns, ClockKind) {
        let zone = &self.zone;
        // A local time exists twice where clocks are set back; the earlier moment is taken.
        let utc_in_period = |i: usize| {
            let (from, offset) = zone[i];
            let utc = local - offset;
            (utc >= from && zone.get(i + 1).is_none_or(|next| utc < next.0)).then_some(utc)
        };
        let next_period = zone.partition_point(|(from, offset)| from + offset <= local);
        let utc = (next_period.saturating_sub(2)..(next_period + 1).min(zone.len())).find_map(utc_in_period);
        let kind = if zone.is_empty() { ClockKind::Local } else { ClockKind::Utc };
        // A local time in the hour that is skipped where clocks are set forward keeps the offset from before.
        (utc.unwrap_or_else(|| local - zone.get(next_period.saturating_sub(1)).map_or(0, |entry| entry.1)), kind)
    }
}

/// Parses a date that the operator supplied, such as `2026-11-21`, into days since 1970-01-01.
pub fn day_of(text: &str) -> Option<i64> {
    let line = text.as_bytes();
    let days = date(&[line, b" "].concat(), &mut DateOrder::default()).map(|(days, _)| days);
    days.filter(|_| line.len() == 10 && two_digits(line, 0).is_some())
}
