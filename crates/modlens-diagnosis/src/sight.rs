//! What a few examples suggest, where there are too few requests for a contrast: the cause that explains the symptoms best.

use crate::claim::{Certainty, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::Symptom;
use crate::table::{diagnoses, Diagnosis, UNNAMED};

/// More examples of one symptom than these add no certainty: they may share a reason.
const MOST_COUNTED: u64 = 4;

/// From so many examples on, and with such odds against the best rival, a suspicion is likely.
pub const LIKELY_EXAMPLES: u64 = 3;
const LIKELY_ODDS: f64 = 5.0;

/// So many causes at most are suspected at once.
const MOST_CAUSES: usize = 3;

/// The examples of one symptom.
type Seen = (Symptom, Tally, Option<u8>);

/// The causes that the symptoms suggest, the best explanation first.
pub fn suspected(view: &View<'_>) -> Vec<Claim> {
    let mut seen = by_symptom(view);
    let mut claims = Vec::new();
    while claims.len() < MOST_CAUSES {
        let Some((claim, cause)) = best(&seen) else { break };
        seen.retain(|(symptom, _, _)| cause.rate(*symptom) < 2.0 * UNNAMED);
        claims.push(claim);
    }
    claims
}

/// The symptoms with all their examples, and the unit where there is one.
fn by_symptom(view: &View<'_>) -> Vec<Seen> {
    let mut seen: Vec<Seen> = Vec::new();
    for (symptom, unit, tally) in view.bus.symptoms.all() {
        match seen.last_mut().filter(|(last, _, _)| *last == symptom) {
            Some((_, all, of)) => {
                all.merge(tally);
                *of = None;
            }
            None => seen.push((symptom, tally.clone(), unit)),
        }
    }
    seen
}

/// The logarithm of how well a cause explains the symptoms.
fn fit(cause: &Diagnosis, seen: &[Seen]) -> f64 {
    let symptoms = seen.iter().map(|(symptom, all, _)| all.failed.min(MOST_COUNTED) as f64 * cause.rate(*symptom).ln());
    cause.met.ln() + symptoms.sum::<f64>()
}

/// The best explanation, with its odds against the next one; `None` if no cause has words for what was seen.
fn best(seen: &[Seen]) -> Option<(Claim, &'static Diagnosis)> {
    let mut ranked: Vec<(f64, &Diagnosis)> = diagnoses().iter().map(|cause| (fit(cause, seen), cause)).collect();
    ranked.sort_by(|one, other| other.0.total_cmp(&one.0));
    let has_words = |cause: &Diagnosis| seen.iter().any(|(symptom, _, _)| cause.sight(*symptom).is_some());
    let at = ranked.iter().position(|(_, cause)| has_words(cause))?;
    let (score, cause) = ranked[at];
    let rival = ranked.iter().enumerate().find(|(other, _)| *other != at).map(|(_, one)| *one)?;
    let with_words = seen.iter().filter_map(|one| Some((one, cause.sight(one.0)?)));
    let ((_, all, unit), words) = with_words.max_by(|one, other| one.0 .1.failed.cmp(&other.0 .1.failed))?;
    let odds = (score - rival.0).exp();
    let is_likely = all.failed >= LIKELY_EXAMPLES && odds >= LIKELY_ODDS;
    let mut all = all.clone();
    all.total = all.failed;
    let mut claim = Claim::new(&cause.code, &all, 1.0);
    claim.unit = *unit;
    claim.odds = Some((odds, rival.1.code.as_str()));
    claim.certainty = if is_likely { Certainty::Likely } else { Certainty::Suspected };
    claim.at_most = modlens_protocol::finding::Severity::Warning;
    let examples = if all.failed == 1 { "1 example".to_owned() } else { format!("{} examples", all.failed) };
    Some((claim.fact("sight", format!("{words} ({examples}).")), cause))
}
