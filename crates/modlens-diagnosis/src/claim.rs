//! What a kind of trouble claims of a bus, before it is put into words.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use crate::contrast::gaps::{without_lone, Episode};
use crate::contrast::tally::{Place, Tally};
use crate::contrast::{BusContrast, RequestCounts, Symptom, UnitCounts};
use crate::observation::RequestKey;
use crate::odd::Odd;
use crate::statistics::{at_least, greatest_rate, least_rate, Share};
use crate::MAX_CHANCE;
use modlens_protocol::decimal::thousands;
use modlens_protocol::finding::Severity;

/// Failures that happen on a healthy line: one request in five hundred.
pub const ACCIDENT: f64 = 0.002;

/// Refusals that happen to any request: one in a hundred.
pub const REFUSED_BY_ACCIDENT: f64 = 0.01;

/// A chance below this makes a refused request a claim: a refusal names its reason itself, so less is needed than of a contrast.
pub const SUGGESTED: f64 = 0.05;

/// Fewer requests than these make no line healthy, and no share certain.
pub const FEW: u64 = 10;

/// A bus as the kinds see it.
pub struct View<'a> {
    /// Its counters.
    pub bus: &'a BusContrast,
    /// Its requests, in the order of their keys.
    pub requests: Vec<(&'a RequestKey, &'a RequestCounts)>,
    /// How many contrasts are looked at, for the correction of chances.
    pub hypotheses: f64,
    recognized: RefCell<BTreeMap<&'static str, Rc<[Claim]>>>,
}

/// Contrasts that are looked at for each unit.
const CONTRASTS_PER_UNIT: usize = 16;

impl<'a> View<'a> {
    /// The view of a bus.
    pub fn new(bus: &'a BusContrast) -> Self {
        let hypotheses = (bus.units.len().max(1) * CONTRASTS_PER_UNIT) as f64;
        Self { bus, requests: bus.requests.sorted(), hypotheses, recognized: RefCell::default() }
    }

    /// Returns what is claimed under this name. It is recognized once for all kinds that ask for it.
    pub fn once(&self, name: &'static str, recognize: fn(&Self) -> Vec<Claim>) -> Rc<[Claim]> {
        if let Some(known) = self.recognized.borrow().get(name) {
            return known.clone();
        }
        let claims: Rc<[Claim]> = recognize(self).into();
        self.recognized.borrow_mut().insert(name, claims.clone());
        claims
    }

    /// Whether there are too few requests for shares.
    pub fn is_small(&self) -> bool {
        self.bus.requests_seen.total < FEW
    }

    /// The chance after correction (Bonferroni's), at most 1.
    pub fn corrected(&self, chance: f64) -> f64 {
        (chance * self.hypotheses).min(1.0)
    }

    /// The corrected chance that so many fail where accidents happen as on any line; `None` if it is too great to say
    /// anything.
    pub fn beyond_accident(&self, share: Share) -> Option<f64> {
        self.significant(at_least(share, ACCIDENT))
    }

    /// The corrected chance, if it is small enough to say something.
    pub fn significant(&self, chance: f64) -> Option<f64> {
        Some(self.corrected(chance)).filter(|chance| *chance < MAX_CHANCE)
    }

    /// The units that were asked, with their counters.
    pub fn units(&self) -> impl Iterator<Item = (u8, &'a UnitCounts)> {
        self.bus.units.iter().filter(|(_, counts)| counts.failures.total > 0).map(|(unit, counts)| (*unit, counts))
    }

    /// The sum of a share over all units but one.
    pub fn others(&self, unit: u8, share: impl Fn(&UnitCounts) -> Share) -> Share {
        self.units().filter(|(other, _)| *other != unit).map(|(_, counts)| share(counts)).sum()
    }
}

/// How certain a diagnosis is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Certainty {
    /// A few examples suggest it.
    Suspected,
    /// Several examples suggest it, and no other cause explains them as well.
    Likely,
    /// The contrast of failed and good transactions is no accident.
    Diagnosed,
}

impl Certainty {
    /// The word in tables and sentences.
    pub fn text(self) -> &'static str {
        match self {
            Self::Suspected => "suspected",
            Self::Likely => "likely",
            Self::Diagnosed => "diagnosed",
        }
    }
}

/// Whose transactions show what a claim says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ShownBy {
    /// Those of the unit that the claim names, or of any unit where it names none.
    OwnUnit,
    /// Those of another unit.
    Unit(u8),
    /// Those of any unit, though the claim names one.
    AllUnits,
}

/// What is wrong, of whom, and how much speaks for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Claim {
    /// The row of `dissectors/diagnoses.toml`.
    pub code: &'static str,
    /// The unit.
    pub unit: Option<u8>,
    /// Whose transactions show it.
    pub shown_by: ShownBy,
    /// The function.
    pub function: Option<u8>,
    /// The address.
    pub address: Option<u16>,
    /// The client.
    pub client: Option<String>,
    /// So many bear it.
    pub share: Share,
    /// Requests that it spoils, for the order of diagnoses.
    pub harm: u64,
    /// The first of them.
    pub first: Option<Place>,
    /// The last of them.
    pub last: Option<Place>,
    /// Its runs, lone failures left out; empty where they are not known.
    pub episodes: Vec<Episode>,
    /// It was not there at the beginning.
    pub has_begun: bool,
    /// It is over.
    pub has_ended: bool,
    /// The corrected chance that it is an accident.
    pub chance: f64,
    /// How certain it is.
    pub certainty: Certainty,
    /// The odds against the best rival, and its code, where they were weighed.
    pub odds: Option<(f64, &'static str)>,
    /// Another cause that would show the very same.
    pub undecided: Option<&'static str>,
    /// How many of the odd transactions and bytes of the bus it explains; `None` where no symptom shows it.
    pub explains: Option<Odd>,
    /// Transactions that show it.
    pub examples: Vec<u64>,
    /// At most so severe, whatever the table says.
    pub at_most: Severity,
    /// The symptom of which a few examples are all that speaks for it.
    pub sight: Option<Symptom>,
    /// What fills the places of the sentence, besides those that all have.
    pub facts: Vec<(&'static str, String)>,
}

impl Claim {
    /// A claim of what a tally has counted.
    pub fn new(code: &'static str, tally: &Tally, chance: f64) -> Self {
        let episodes = without_lone(tally.episodes());
        let (mut before, mut after, mut failed) = (tally.before, tally.after, tally.failed);
        let (mut first, mut last) = (tally.first, tally.last);
        if let (Some(one), Some(other)) = (episodes.first(), episodes.last()) {
            let window = tally.total.saturating_sub(tally.before + tally.after);
            before += one.before;
            after += window.saturating_sub(other.before + other.total);
            failed = episodes.iter().map(|one| one.failed).sum();
            (first, last) = (Some(one.first), Some(other.last));
        }
        let in_window = Share { failed, total: tally.total.saturating_sub(before + after) };
        let none_of = |count: u64| (1.0 - in_window.rate()).max(0.0).powf(count as f64);
        Self {
            code,
            unit: None,
            shown_by: ShownBy::OwnUnit,
            function: None,
            address: None,
            client: None,
            share: tally.share(),
            harm: tally.failed,
            first,
            last,
            has_begun: before > 0 && none_of(before) < MAX_CHANCE,
            has_ended: after > 0 && none_of(after) < MAX_CHANCE,
            episodes,
            chance,
            certainty: Certainty::Diagnosed,
            odds: None,
            undecided: None,
            explains: None,
            examples: tally.examples.numbers(),
            at_most: severity_of(tally.share()),
            sight: None,
            facts: Vec::new(),
        }
    }

    /// Names the unit.
    #[must_use]
    pub fn of_unit(mut self, unit: u8) -> Self {
        self.unit = Some(unit);
        self
    }

    /// Names those whose transactions show it.
    #[must_use]
    pub fn shown_by(mut self, shown_by: ShownBy) -> Self {
        self.shown_by = shown_by;
        self
    }

    /// Returns the unit whose transactions show it; `None` where those of any unit do.
    pub fn spoiled_unit(&self) -> Option<u8> {
        match self.shown_by {
            ShownBy::OwnUnit => self.unit,
            ShownBy::Unit(unit) => Some(unit),
            ShownBy::AllUnits => None,
        }
    }

    /// Names a function and an address.
    #[must_use]
    pub fn at(mut self, function: u8, address: u16) -> Self {
        (self.function, self.address) = (Some(function), Some(address));
        self
    }

    /// Fills a place of the sentence.
    #[must_use]
    pub fn fact(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.facts.push((name, value.into()));
        self
    }

    /// Sets how many of how many bear it.
    #[must_use]
    pub fn with_share(mut self, share: Share) -> Self {
        self.share = share;
        self.harm = share.failed;
        self.at_most = severity_of(share);
        self
    }

    /// Names another cause that would show the very same.
    #[must_use]
    pub fn undecided_from(mut self, code: Option<&'static str>) -> Self {
        self.undecided = code;
        if code.is_some() {
            self.certainty = Certainty::Likely;
        }
        self
    }

    /// Takes the times of another claim.
    #[must_use]
    pub fn in_the_time_of(mut self, other: &Self) -> Self {
        (self.first, self.last, self.has_begun, self.has_ended) = (other.first, other.last, other.has_begun, other.has_ended);
        self.episodes.clone_from(&other.episodes);
        self
    }

    /// Sets the greatest severity.
    #[must_use]
    pub fn at_most(mut self, severity: Severity) -> Self {
        self.at_most = severity;
        self
    }
}

/// How severe so many failures can be: what may be less than one in a hundred is no error, and what is surely less is only
/// worth knowing.
pub fn severity_of(share: Share) -> Severity {
    if greatest_rate(share) < 0.01 {
        Severity::Info
    } else if least_rate(share) < 0.01 {
        Severity::Warning
    } else {
        Severity::Error
    }
}

/// So many, in the past.
pub fn were(count: u64) -> String {
    format!("{} {}", thousands(count), if count == 1 { "was" } else { "were" })
}

/// A duration in words: milliseconds up to ten seconds, seconds up to two minutes, then in the two greatest units.
///
/// ```
/// use modlens_diagnosis::claim::duration;
/// assert_eq!([2_500_000_i64, 145_000_000_000, 7_260_000_000_000].map(duration), ["2.5 ms", "2 min 25 s", "2 h 1 min"]);
/// ```
pub fn duration(ns: i64) -> String {
    let ms = ns as f64 / 1e6;
    let seconds = (ms / 1000.0).round() as i64;
    match seconds {
        _ if ms < 10.0 => format!("{ms:.1} ms"),
        0..10 => format!("{ms:.0} ms"),
        10..120 => format!("{seconds} s"),
        120..7200 => in_two(seconds, (60, "min"), (1, "s")),
        7200..172_800 => in_two(seconds, (3600, "h"), (60, "min")),
        _ => in_two(seconds, (86_400, "d"), (3600, "h")),
    }
}

/// So many of the one unit and of the other; the second one is left out where there is none.
fn in_two(seconds: i64, (one, name): (i64, &str), (other, less): (i64, &str)) -> String {
    match seconds % one / other {
        0 => format!("{} {name}", seconds / one),
        rest => format!("{} {name} {rest} {less}", seconds / one),
    }
}

/// A share in per cent, with a decimal where it is small or nearly all. `100 %` is said of all only.
pub fn percent(rate: f64) -> String {
    if rate > 0.0 && rate < 0.0995 {
        format!("{:.1} %", rate * 100.0)
    } else if (0.995..1.0).contains(&rate) {
        format!("{:.1} %", (rate * 1000.0).floor() / 10.0)
    } else {
        format!("{:.0} %", rate * 100.0)
    }
}

#[cfg(test)]
mod tests {
    use super::percent;

    #[test]
    fn a_hundred_per_cent_is_said_of_all_only() {
        assert_eq!(
            [0.0, 0.004, 0.12, 0.994, 0.995, 7983.0 / 7987.0, 1.0].map(percent),
            ["0 %", "0.4 %", "12 %", "99 %", "99.5 %", "99.9 %", "100 %"]
        );
    }
}
