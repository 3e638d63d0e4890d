//! Units whose requests fail without a cause that the doctor knows: no diagnosis, but a trouble all the same.

use modlens_engine::records::DiagnosisRow;
use modlens_protocol::decimal::thousands;
use modlens_protocol::finding::Severity;
use modlens_protocol::source::Clock;

use super::course::Course;
use crate::attribution::Rest;
use crate::claim::{Certainty, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::UnitCounts;
use crate::statistics::Share;

/// The code of these rows, which are no diagnoses.
pub const UNEXPLAINED: &str = "unexplained";

/// The units of a bus that fail more often than by chance, of which no claim says why.
pub(super) fn of_bus(name: &str, view: &View<'_>, claims: &[Claim], rest: Rest) -> Vec<(DiagnosisRow, Course)> {
    if view.is_small() {
        return Vec::new();
    }
    let is_claimed = |unit: u8| {
        let is_of_unit = |claim: &&Claim| claim.certainty == Certainty::Diagnosed && claim.unit.is_none_or(|own| own == unit);
        let explains = |claim: &Claim| claim.at_most != Severity::Info || is_nearly_all(claim, rest);
        claims.iter().filter(is_of_unit).any(explains)
    };
    let open = view.units().filter(|(unit, _)| !is_claimed(*unit));
    open.filter_map(|(unit, counts)| row(name, view, unit, counts)).collect()
}

/// Whether a claim, however harmless, explains at least nine in ten of the failed requests of its bus.
fn is_nearly_all(claim: &Claim, rest: Rest) -> bool {
    claim.explains.is_some_and(|explains| explains.failed * 10 >= rest.odd.failed * 9 && rest.odd.failed > 0)
}

fn row(name: &str, view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<(DiagnosisRow, Course)> {
    let refused =
        counts.exceptions.iter().max_by_key(|tally| tally.failed).filter(|most| most.failed * 2 > counts.failures.total);
    let (tally, how): (&Tally, &str) = match refused {
        Some(refused) => (refused, "were refused (exception)"),
        None => (&counts.failures, "failed"),
    };
    let share = Share { failed: tally.failed, total: counts.failures.total };
    let chance = view.beyond_accident(share)?;
    let claim = Claim::new(UNEXPLAINED, tally, chance);
    let time = claim.first.and_then(|place| place.time).filter(|_| view.bus.facts.clock == Clock::Utc);
    let row = DiagnosisRow {
        code: UNEXPLAINED,
        severity: crate::claim::severity_of(share),
        bus: name.to_owned(),
        unit: Some(unit),
        function: None,
        address: None,
        client: None,
        failed: share.failed,
        total: share.total,
        since: time,
        until: None,
        certainty: Certainty::Diagnosed.text(),
        chance: Some(chance),
        share: None,
        odds: None,
        episodes: String::new(),
        sentence: format!(
            "Unit {unit}: {} of {} requests {how}, and no known cause explains it.",
            thousands(share.failed),
            thousands(share.total)
        ),
        advice: "What changed when it began; modlens show names each transaction's own reason.".into(),
        proof: "A recording with more traffic before and after it.".into(),
        examples: claim.examples.clone(),
    };
    Some((row, Course::of(view.bus, &claim, Rest::default())))
}
