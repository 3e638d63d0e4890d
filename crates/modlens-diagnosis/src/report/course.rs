//! When a diagnosis was, and how much of what is odd it explains.

use modlens_protocol::decimal::thousands;
use modlens_protocol::Ns;
use serde_json::Value as Json;

use super::episodes;
use crate::attribution::{Rest, MOST_ODDS};
use crate::claim::Claim;
use crate::contrast::tally::Place;
use crate::contrast::BusContrast;

/// When the failures of a diagnosis were, on any clock, and which of all it explains.
#[derive(Clone, Debug)]
pub struct Course {
    /// The start of the first one.
    pub first: Option<Ns>,
    /// The start of the last one.
    pub last: Option<Ns>,
    /// Too many requests went well since then for chance.
    pub has_ended: bool,
    /// Its runs, as JSON.
    pub(super) episodes: Vec<Json>,
    /// How many of so many odd transactions and bytes it explains.
    pub(super) explains: Option<u64>,
    odd: u64,
    odds: Option<f64>,
    /// Its best rival.
    pub(super) rival: Option<&'static str>,
}

impl Course {
    /// What a claim of a bus tells.
    pub(super) fn of(bus: &BusContrast, claim: &Claim, rest: Rest) -> Self {
        let time = |place: Option<Place>| place.and_then(|place| place.time);
        Self {
            first: time(claim.first),
            last: time(claim.last),
            has_ended: claim.has_ended,
            episodes: episodes::json(bus, claim),
            explains: claim.explains,
            odd: rest.odd,
            odds: claim.odds.map(|(odds, _)| odds),
            rival: claim.odds.map(|(_, rival)| rival),
        }
    }

    /// The share of a diagnosis and its odds in words; `None` where no symptom shows it.
    pub(super) fn evidence(&self) -> Option<String> {
        let (explains, odd) = (self.explains?, self.odd);
        let said = format!("Explains {} of {} odd transactions and bytes", thousands(explains.min(odd)), thousands(odd));
        Some(match (self.odds, self.rival) {
            (Some(odds), Some(rival)) if odds >= 1.0 => {
                let more = if odds >= MOST_ODDS { "over " } else { "" };
                format!("{said}: {more}{} times likelier from this than from {rival}.", thousands(odds.round() as u64))
            }
            _ => format!("{said}."),
        })
    }
}
