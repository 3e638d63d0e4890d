//! Clocks of recordings: what kind they are, and what the operator says of them.

use crate::text::date::{date, two, Order};
use modlens_protocol::Ns;

/// What the operator knows of a recording's clock.
#[derive(Clone, Debug, Default)]
pub struct ClockSettings {
    /// The zone of times without one: from which moment (UTC) on which offset holds, oldest first.
    pub zone: Vec<(Ns, Ns)>,
    /// The day (since 1970) of the first time of day.
    pub day: Option<i64>,
}

/// What stamps without more can be: the order is that of what they are worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// No clock.
    #[default]
    None,
    /// Seconds from some start.
    Relative,
    /// No date.
    TimeOfDay,
    /// No zone.
    Local,
    /// Date, time and zone.
    Utc,
}

impl Kind {
    /// As people read it.
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
    /// The moment (UTC) that a local time means; the time itself where no zone is known.
    pub fn utc(&self, local: Ns) -> (Ns, Kind) {
        let zone = &self.zone;
        // Where a clock was set back, the earlier of the two moments is meant.
        let fits = |i: usize| {
            let (from, offset) = zone[i];
            let utc = local - offset;
            (utc >= from && zone.get(i + 1).is_none_or(|next| utc < next.0)).then_some(utc)
        };
        let near = zone.partition_point(|(from, offset)| from + offset <= local);
        let utc = (near.saturating_sub(2)..(near + 1).min(zone.len())).find_map(fits);
        let kind = if zone.is_empty() { Kind::Local } else { Kind::Utc };
        // An hour that the zone leaves out: as before the clock was set forward.
        (utc.unwrap_or_else(|| local - zone.get(near.saturating_sub(1)).map_or(0, |entry| entry.1)), kind)
    }
}

/// A date as operators write it: days since 1970.
pub fn day_of(text: &str) -> Option<i64> {
    let line = text.as_bytes();
    let days = date(&[line, b" "].concat(), &mut Order::default()).map(|(days, _)| days);
    days.filter(|_| line.len() == 10 && two(line, 0).is_some())
}
