//! Frames that are built wrongly by the program that makes them: their checksum is right, and their layout is not.

use crate::claim::{Claim, View, FEW};
use crate::contrast::tally::Tally;
use crate::contrast::Symptom;
use crate::statistics::Share;
use crate::table::diagnosis;

/// Units whose frames have another layout than that of their function, or a wrong length field or checksum order.
pub(super) fn wrong_layout(view: &View<'_>) -> Vec<Claim> {
    let mut units: Vec<Option<u8>> = of_layout(view).map(|(_, unit, _)| unit).collect();
    units.dedup();
    units.sort_unstable();
    units.dedup();
    units.into_iter().filter_map(|unit| of_unit(view, unit)).collect()
}

fn of_layout<'a>(view: &'a View<'_>) -> impl Iterator<Item = (Symptom, Option<u8>, &'a Tally)> {
    let all = view.bus.symptoms.all().map(|(symptom, unit, seen)| (symptom, unit, &seen.all));
    let is_usual = |symptom, unit: Option<u8>, tally: &Tally| {
        symptom == Symptom::OtherLength && unit.is_some_and(|unit| 2 * tally.failed >= asked_of(view, unit))
    };
    // Answers to the request before have other lengths, too.
    let is_behind = !view.once("lockstep", super::lockstep::lockstep).is_empty();
    let all =
        all.filter(move |(symptom, unit, tally)| symptom.is_of_layout() || (!is_behind && is_usual(*symptom, *unit, tally)));
    all.filter(|(symptom, unit, tally)| !symptom.is_like_damage() || are_most_of_the_damaged(view, *unit, tally))
}

/// Whether most damaged frames of a unit are these. A program builds its frames alike; what cuts frames and mixes them makes all kinds.
fn are_most_of_the_damaged(view: &View<'_>, unit: Option<u8>, tally: &Tally) -> bool {
    let counts = unit.and_then(|unit| view.bus.units.get(&unit));
    counts.is_none_or(|counts| 2 * tally.failed > counts.damaged_frames())
}

/// The requests to a unit.
fn asked_of(view: &View<'_>, unit: u8) -> u64 {
    view.bus.units.get(&unit).map_or(0, |counts| counts.failures.total)
}

fn of_unit(view: &View<'_>, unit: Option<u8>) -> Option<Claim> {
    let own = || of_layout(view).filter(|(_, of, _)| *of == unit);
    let (main, _, _) = own().max_by_key(|(symptom, _, tally)| (tally.failed, std::cmp::Reverse(*symptom)))?;
    let mut all: Tally = own().map(|(_, _, tally)| tally).sum();
    if let Some(counts) = unit.and_then(|unit| view.bus.units.get(&unit)).filter(|_| main == Symptom::AnswerBare) {
        // After a few of them, the rest is taken for whole: a text that prints no checksum has none of the few.
        all.merge(&counts.bare);
    }
    let asked = unit.map_or(0, |unit| asked_of(view, unit));
    let share = Share { failed: all.failed, total: all.failed.max(asked) };
    // Of a few frames, the first sight speaks.
    if all.failed.max(asked) < FEW {
        return None;
    }
    let chance = view.beyond_accident(share)?;
    let words = diagnosis("wrong_layout").and_then(|row| row.sight(main)).unwrap_or_default();
    let subject = unit.map_or_else(|| String::from("the line"), |unit| format!("unit {unit}"));
    let what = crate::sight::with_figures(words, view.bus.symptoms.figures(main, unit)).replace("{unit}", &subject);
    let mut claim = Claim::new("wrong_layout", &all, chance).with_share(share).fact("what", what);
    claim.unit = unit;
    Some(claim)
}
