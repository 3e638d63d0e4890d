//! Units that never answer, told as one trouble: where no unit of the line answers, or many do not, it is not a matter of each.

use std::ops::RangeInclusive;

use super::answers;
use crate::claim::{Claim, View};
use modlens_protocol::finding::Severity;

/// What to check, and what would prove it.
const NOBODY_ANSWERS: [&str; 2] = [
    "What all units have in common: the wires between the master and the first unit (A and B may be swapped), rate and parity of the master, the supply of the units; and whether the recording hears both directions.",
    "Ask one unit alone, with a second program and the same settings. If the master has values, the units do answer, and the recording does not hear them.",
];
const MANY_DO_NOT: [&str; 2] = [
    "The master's list of units: a search for devices asks addresses that nobody has; each of them costs a timeout. If all of these are there, what they have in common: their part of the wires, their supply.",
    "Remove them from the list: the cycle gets shorter by their waiting time.",
];
const SEARCHED: [&str; 2] = [
    "Nothing, if the master has searched for devices and no device has these addresses: it does not ask them any more.",
    "Let the master search again: the same units answer.",
];

/// Claims with those of many units that never answer as one.
pub(super) fn together(view: &View<'_>, claims: Vec<Claim>) -> Vec<Claim> {
    let (silent, mut rest): (Vec<Claim>, Vec<Claim>) = claims.into_iter().partition(|claim| claim.code == "dead_unit_cost");
    let asked = view.units().filter(|(unit, _)| *unit != 0).count();
    let is_nobody = silent.len() == asked && asked > 1;
    if !is_nobody && silent.len() <= answers::FEW_SILENT {
        rest.splice(0..0, silent);
        return rest;
    }
    let mut units: Vec<u8> = silent.iter().filter_map(|claim| claim.unit).collect();
    units.sort_unstable();
    let of_all = match asked {
        _ if !is_nobody => format!("{} of {asked}", units.len()),
        2 => String::from("both"),
        _ => format!("all {asked}"),
    };
    let subject = format!("units {}, {of_all} that were asked,", in_words(&units));
    let is_over = !is_nobody && is_over(view, &silent);
    let [check, proof] = match (is_nobody, is_over) {
        (true, _) => NOBODY_ANSWERS,
        (_, true) => SEARCHED,
        _ => MANY_DO_NOT,
    };
    let share = silent.iter().map(|claim| claim.share).sum();
    let longest = silent.iter().max_by_key(|claim| claim.share.failed).expect("more than one unit is silent");
    let mut claim = longest.clone().with_share(share);
    claim.unit = None;
    claim.chance = silent.iter().map(|one| one.chance).fold(1.0, f64::min);
    claim.first = silent.iter().filter_map(|one| one.first).min_by_key(|place| place.number);
    claim.last = silent.iter().filter_map(|one| one.last).max_by_key(|place| place.number);
    claim.has_begun = silent.iter().all(|one| one.has_begun);
    claim.has_ended = is_over || silent.iter().all(|one| one.has_ended);
    if is_over {
        claim = claim.at_most(Severity::Info);
    }
    claim.episodes.clear();
    claim.facts.clear();
    if let Some(cost) = answers::cost_of_silence(view, &units) {
        claim = claim.fact("cost", cost);
    }
    claim = claim.fact("subject", subject).fact("answers", "answer").fact("what_to_check", check).fact("experiment", proof);
    rest.insert(0, claim);
    rest
}

/// Whether the master has stopped to ask these units before half of the recording, all of them: it has searched for devices once, and
/// that so many requests fall to one half by chance is out of the question.
fn is_over(view: &View<'_>, silent: &[Claim]) -> bool {
    let last = silent.iter().filter_map(|one| one.last).map(|place| place.number).max();
    last.is_some_and(|last| last * 2 < view.bus.requests_seen.total)
}

/// Numbers in words, runs of three or more by their ends: `1, 2, 4 to 119 and 121`.
fn in_words(units: &[u8]) -> String {
    let mut runs: Vec<RangeInclusive<u8>> = Vec::new();
    for &unit in units {
        match runs.last_mut().filter(|run| run.end() + 1 == unit) {
            Some(run) => *run = *run.start()..=unit,
            None => runs.push(unit..=unit),
        }
    }
    let mut parts: Vec<String> = Vec::new();
    for run in runs {
        match (*run.start(), *run.end()) {
            (one, other) if one + 1 < other => parts.push(format!("{one} to {other}")),
            (one, other) => parts.extend((one..=other).map(|unit| unit.to_string())),
        }
    }
    match parts.pop() {
        Some(last) if !parts.is_empty() => format!("{} and {last}", parts.join(", ")),
        last => last.unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::in_words;

    #[test]
    fn runs_of_three_or_more_are_named_by_their_ends() {
        assert_eq!(in_words(&[1, 2, 4, 5, 6, 9]), "1, 2, 4 to 6 and 9");
        assert_eq!(in_words(&[7, 8]), "7 and 8");
        assert_eq!(in_words(&[1, 2, 3]), "1 to 3");
    }
}
