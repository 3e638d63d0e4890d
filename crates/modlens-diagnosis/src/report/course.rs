//! When a diagnosis was, and how much of what is odd it explains.

use modlens_protocol::decimal::thousands;
use modlens_protocol::Ns;
use serde_json::Value as Json;

use super::episodes;
use crate::attribution::{Rest, MOST_ODDS};
use crate::claim::{Certainty, Claim};
use crate::contrast::tally::Place;
use crate::contrast::BusContrast;
use crate::odd::Odd;

/// Smaller odds are not stated as a number.
const EVEN_ODDS: f64 = 2.0;

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
    pub(super) explains: Option<Odd>,
    odd: Odd,
    is_diagnosed: bool,
    odds: Option<f64>,
    /// Its best rival.
    pub(super) rival: Option<&'static str>,
}

impl Course {
    /// What a claim of a bus says.
    pub(super) fn of(bus: &BusContrast, claim: &Claim, rest: Rest) -> Self {
        let time = |place: Option<Place>| place.and_then(|place| place.time);
        Self {
            first: time(claim.first),
            last: time(claim.last),
            has_ended: claim.has_ended,
            episodes: episodes::json(bus, claim),
            explains: claim.explains,
            odd: rest.odd,
            is_diagnosed: claim.certainty == Certainty::Diagnosed,
            odds: claim.odds.map(|(odds, _)| odds),
            rival: claim.odds.map(|(_, rival)| rival),
        }
    }

    /// The share of a diagnosis and its odds in words, of a suspicion its odds alone: it is of a few examples. `None` where no
    /// symptom shows it.
    pub(super) fn evidence(&self) -> Option<String> {
        let explains = self.explains?;
        let odds = match (self.odds, self.rival) {
            (Some(odds), Some(rival)) if (1.0..EVEN_ODDS).contains(&odds) => {
                Some(format!("hardly likelier from this than from {rival}."))
            }
            (Some(odds), Some(rival)) if odds >= 1.0 => {
                let more = if odds >= MOST_ODDS { "over " } else { "" };
                Some(format!("{more}{} times likelier from this than from {rival}.", thousands(odds.round() as u64)))
            }
            _ => None,
        };
        if !self.is_diagnosed {
            return odds.map(|odds| odds.replacen("over", "Over", 1).replacen("hardly", "Hardly", 1));
        }
        let said = format!("Explains {}", in_words(explains, self.odd));
        Some(odds.map_or(format!("{said}."), |odds| format!("{said}: {odds}")))
    }
}

/// So many of so many failed requests, refusals, and the rest, each where there is any.
pub(super) fn in_words(some: Odd, all: Odd) -> String {
    let mut parts: Vec<String> = [
        (some.failed, all.failed, "failed request", "failed requests"),
        (some.refused, all.refused, "refused request", "refused requests"),
        (some.other, all.other, "odd answer or stray byte", "odd answers and stray bytes"),
    ]
    .into_iter()
    .filter(|(some, ..)| *some > 0)
    .map(|(some, all, one, several)| match all.max(some) {
        1 => format!("the {one}"),
        all if all == some => format!("all {} {several}", thousands(all)),
        all => format!("{} of the {} {several}", thousands(some), thousands(all)),
    })
    .collect();
    match parts.pop() {
        Some(last) if !parts.is_empty() => format!("{} and {last}", parts.join(", ")),
        last => last.unwrap_or_default(),
    }
}
