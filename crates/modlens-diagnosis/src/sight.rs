//! What a few examples suggest, where there are too few requests for a contrast: the cause that explains the symptoms best.

use crate::claim::{Certainty, Claim, View};
use crate::contrast::lists::Lists;
use crate::contrast::tally::Tally;
use crate::contrast::{Symptom, UnitCounts};
use crate::observation::Figures;
use crate::protocols::PROTOCOLS;
use crate::table::{diagnoses, diagnosis, Diagnosis, UNNAMED};
use modlens_protocol::annotate::exception_name;
use modlens_protocol::framing::Verdict;

/// More examples of one symptom than these add no certainty: they may share a reason.
const MOST_COUNTED: u64 = 4;

/// From so many examples on, and with such odds against the best rival, a suspicion is likely.
pub const LIKELY_EXAMPLES: u64 = 3;
const LIKELY_ODDS: f64 = 5.0;

/// So many causes at most are suspected at once.
const MOST_CAUSES: usize = 3;

/// The examples of one symptom.
type Seen = (Symptom, Tally, Option<u8>, Option<Figures>);

/// The causes that the symptoms suggest which none of these claims explains, the best explanation first.
pub fn suspected(view: &View<'_>, claims: &[Claim]) -> Vec<Claim> {
    let mut seen = by_symptom(view);
    let causes = || claims.iter().filter(|claim| claim.harm > 0).filter_map(|claim| diagnosis(claim.code));
    seen.retain(|(symptom, ..)| causes().all(|cause| !explains(cause, *symptom)));
    explained(view, seen)
}

/// Whether a cause shows a symptom more often than by chance.
fn explains(cause: &Diagnosis, symptom: Symptom) -> bool {
    cause.rate(symptom) >= 2.0 * UNNAMED
}

/// The same of two lists one after the other: by what each frame shows by itself, and by answers that no request asks for.
pub fn suspected_in_lists(view: &View<'_>, lists: &Lists) -> Vec<Claim> {
    let mut seen: Vec<Seen> = Vec::new();
    all(view)
        .filter(|(symptom, _, _)| symptom.is_of_frame())
        .for_each(|(symptom, unit, tally)| add(view, &mut seen, (symptom, symptom), unit, tally));
    let other_length = (Symptom::OtherLength, Symptom::OtherLength);
    lists.other_length.iter().for_each(|(unit, tally)| add(view, &mut seen, other_length, Some(*unit), tally));
    explained(view, seen)
}

fn explained(view: &View<'_>, mut seen: Vec<Seen>) -> Vec<Claim> {
    let mut claims = Vec::new();
    while claims.len() < MOST_CAUSES {
        let Some((mut claim, cause)) = best(&seen) else { break };
        // Where no answer at all was recorded, the recording may hear one direction only.
        if view.bus.units.keys().all(|unit| is_mute(view, *unit)) {
            claim.certainty = Certainty::Suspected;
        }
        seen.retain(|(symptom, ..)| !explains(cause, *symptom));
        claims.push(claim);
    }
    claims
}

/// The symptoms with all their examples, and the unit where there is one.
fn by_symptom(view: &View<'_>) -> Vec<Seen> {
    let mut seen: Vec<Seen> = Vec::new();
    for (symptom, unit, tally) in all(view).chain(never_answered(view)) {
        let shown = match (symptom, unit) {
            (Symptom::NoAnswer, Some(unit)) if is_mute(view, unit) => continue,
            (Symptom::Echo, _) if !is_echoed(view) => continue,
            (Symptom::AnswerWhole, Some(unit)) if has_no_valid_answer(view, unit) && !is_right_in_part(view, unit) => {
                Symptom::NeverValid
            }
            (Symptom::RefusalBare, _) if shows(view, Symptom::AnswerBare) => Symptom::AnswerBare,
            (symptom, Some(_)) if is_coded(symptom) && are_refusals_bare(view) => Symptom::RefusalBare,
            (Symptom::AnswerInverted, Some(unit)) if has_valid_answer(view, unit) => Symptom::AnswerIdle,
            (Symptom::Noise, _) if is_beside_whole_frames(view, tally) => Symptom::Extra,
            _ => symptom,
        };
        add(view, &mut seen, (shown, symptom), unit, tally);
    }
    push_out(view, &mut seen);
    seen
}

/// Adds examples of a symptom, and forgets the unit where they are of several.
fn add(view: &View<'_>, seen: &mut Vec<Seen>, (shown, counted): (Symptom, Symptom), unit: Option<u8>, tally: &Tally) {
    match seen.iter_mut().find(|(other, ..)| *other == shown) {
        Some((_, all, of, figures)) => {
            all.merge(tally);
            let is_same = *of == unit || *figures == view.bus.symptoms.figures(counted, unit);
            (*of, *figures) = (unit.filter(|_| *of == unit), figures.filter(|_| is_same));
        }
        None => seen.push((shown, tally.clone(), unit, view.bus.symptoms.figures(counted, unit))),
    }
}

/// Whether bytes of no frame are too few for one, and others are whole frames.
fn is_beside_whole_frames(view: &View<'_>, tally: &Tally) -> bool {
    let frames = &view.bus.frames;
    let (all, whole) = (frames.bytes.iter().sum::<u64>(), frames.bytes_of(Verdict::Ok));
    whole > 0 && view.bus.received_damage == 0 && all - whole <= MOST_EXTRA * tally.failed
}

/// The shortest frame has four bytes.
const MOST_EXTRA: u64 = 3;

/// A byte or two in front of each answer that lacks its last byte: who counts bytes has read them in its place.
fn push_out(view: &View<'_>, seen: &mut Vec<Seen>) {
    let count = |symptom| seen.iter().find(|(one, ..)| *one == symptom).map_or(0, |(_, all, ..)| all.failed);
    let strays: u64 = view.bus.units.values().map(|counts| counts.strays[0].failed).sum();
    let others = seen.iter().any(|(symptom, ..)| !matches!(symptom, Symptom::AnswerEnd | Symptom::Stray | Symptom::Noise));
    if others || count(Symptom::AnswerEnd) == 0 || strays < count(Symptom::AnswerEnd) {
        return;
    }
    seen.retain(|(symptom, ..)| *symptom == Symptom::AnswerEnd);
    for (symptom, ..) in seen {
        *symptom = Symptom::AnswerShifted;
    }
}

/// The symptoms of a bus with their examples.
fn all<'a>(view: &View<'a>) -> impl Iterator<Item = (Symptom, Option<u8>, &'a Tally)> {
    view.bus.symptoms.all().map(|(symptom, unit, seen)| (symptom, unit, &seen.all))
}

/// Whether no answer of a unit is in the recording, not even a damaged one.
fn is_mute(view: &View<'_>, unit: u8) -> bool {
    let counts = view.bus.units.get(&unit);
    let is_never_heard = counts.is_some_and(|counts| {
        counts.failures.total == counts.silent.failed && counts.late.failed + counts.second_answers.failed == 0
    });
    // A byte or two that a line leaves are no answer.
    let is_level = |symptom| matches!(symptom, Symptom::NoAnswer | Symptom::Stray);
    let is_silence = |symptom| is_level(symptom) || (symptom == Symptom::Echo && !is_echoed(view));
    is_never_heard && all(view).all(|(symptom, of, _)| of != Some(unit) || is_silence(symptom))
}

/// Whether at least half of all requests came twice: an adapter that hears itself hears all of them. A request that is repeated
/// alone is a retry.
fn is_echoed(view: &View<'_>) -> bool {
    let echoes: u64 = all(view).filter(|(symptom, _, _)| *symptom == Symptom::Echo).map(|(_, _, tally)| tally.failed).sum();
    let requests: u64 = view.bus.units.values().map(|counts| counts.heard() + counts.not_seen.failed).sum();
    echoes * 2 >= requests
}

/// Whether no answer of a unit on a serial line is valid.
fn has_no_valid_answer(view: &View<'_>, unit: u8) -> bool {
    view.bus.facts.is_line() && view.bus.units.get(&unit).is_some_and(|counts| counts.failures.failed == counts.failures.total)
}

/// Whether there are examples of a symptom.
fn shows(view: &View<'_>, symptom: Symptom) -> bool {
    all(view).any(|(one, _, _)| one == symptom)
}

/// Whether the number that shows a symptom is that of an exception.
fn is_coded(symptom: Symptom) -> bool {
    symptom.is_refusal() && symptom != Symptom::RefusedReference
}

/// Whether refusals are all that has no checksum, and the rest has: where a text leaves checksums out, it does so of other frames, too.
fn are_refusals_bare(view: &View<'_>) -> bool {
    let refusals: u64 = all(view).filter(|(symptom, _, _)| symptom.is_refusal()).map(|(_, _, tally)| tally.failed).sum();
    let frames = &view.bus.frames;
    view.bus.facts.is_line() && frames.of(Verdict::Ok) > 0 && frames.of(Verdict::NoChecksum) == refusals
}

/// Whether an answer of a unit is valid.
fn has_valid_answer(view: &View<'_>, unit: u8) -> bool {
    view.bus.units.get(&unit).is_some_and(|counts| counts.answered() > 0)
}

/// Whether a part of an answer of a unit is right, whatever is wrong with the rest: then the line settings are.
fn is_right_in_part(view: &View<'_>, unit: u8) -> bool {
    let shows = |symptom| {
        use Symptom::{AnswerAdded, AnswerBehind, AnswerBit, AnswerCut, AnswerEnd, AnswerInside, AnswerStart};
        matches!(symptom, AnswerAdded | AnswerBehind | AnswerBit | AnswerStart | AnswerEnd | AnswerInside | AnswerCut)
    };
    all(view).any(|(symptom, of, _)| of == Some(unit) && shows(symptom))
}

/// The requests to units that are never heard, but for the last one of all: the end of the recording may cut off what comes of it.
fn never_answered<'a>(view: &View<'a>) -> impl Iterator<Item = (Symptom, Option<u8>, &'a Tally)> {
    // A unit that logs what it receives and sends passes over what others answer.
    if view.bus.is_quoted() || view.bus.is_unit {
        return Vec::new().into_iter();
    }
    // A single one counts where nothing else is odd, which might be its answer.
    let least = if view.bus.ends_open() || all(view).next().is_some() { 2 } else { 1 };
    let is_unanswered = |unit: u8, counts: &UnitCounts| counts.not_seen.failed > answered_by_others(view, unit);
    let mute = view.bus.units.iter().filter(|(unit, counts)| counts.not_seen.failed >= least && is_mute(view, **unit));
    let mute = mute.filter(|(unit, counts)| is_unanswered(**unit, counts));
    let mute: Vec<_> = mute.map(|(unit, counts)| (Symptom::NeverAnswered, Some(*unit), &counts.not_seen)).collect();
    mute.into_iter()
}

/// How many answers of other units came that fit the requests to this one.
fn answered_by_others(view: &View<'_>, asked: u8) -> u64 {
    let of_unit = |counts: &UnitCounts| {
        let misfits = counts.misfits.get(&asked).copied().unwrap_or_default();
        counts.answers_for.get(&asked).map_or(0, |tally| tally.failed.saturating_sub(misfits))
    };
    view.bus.units.values().map(of_unit).sum()
}

/// The logarithm of how well a cause explains the symptoms.
fn fit(cause: &Diagnosis, seen: &[Seen]) -> f64 {
    let symptoms = seen.iter().map(|(symptom, all, ..)| all.failed.min(MOST_COUNTED) as f64 * cause.rate(*symptom).ln());
    cause.met.ln() + symptoms.sum::<f64>()
}

/// Words with the numbers that show a symptom in their places; what is in brackets is left out where there are none.
pub(crate) fn with_figures(words: &str, figures: Option<Figures>) -> String {
    let Some([first, second]) = figures else {
        let mut parts = words.split(['[', ']']);
        let mut kept = parts.next().unwrap_or_default().to_owned();
        parts.skip(1).step_by(2).for_each(|part| kept.push_str(part));
        return kept;
    };
    let pair = |number: u32| format!("{:02X} {:02X}", number >> 8, number & 0xFF);
    let protocol = PROTOCOLS.get(first as usize).map_or("another protocol", |protocol| protocol.name);
    let words = words
        .replace(['[', ']'], "")
        .replace("{protocol}", protocol)
        .replace("{exception}", &exception(first))
        .replace("{first}", &first.to_string())
        .replace("{second}", &second.to_string())
        .replace("{first_byte}", &format!("{first:02X}"))
        .replace("{second_byte}", &format!("{second:02X}"));
    words.replace("{first_bytes}", &pair(first)).replace("{second_bytes}", &pair(second))
}

/// The number of an exception, and its name where there is one.
fn exception(code: u32) -> String {
    let name = u8::try_from(code).ok().and_then(exception_name);
    name.map_or_else(|| format!("exception {code}"), |name| format!("exception {code}, {name}"))
}

/// The best explanation, with its odds against the next one; `None` if no cause has words for what was seen.
fn best(seen: &[Seen]) -> Option<(Claim, &'static Diagnosis)> {
    let mut ranked: Vec<(f64, &Diagnosis)> = diagnoses().iter().map(|cause| (fit(cause, seen), cause)).collect();
    ranked.sort_by(|one, other| other.0.total_cmp(&one.0));
    // That no answer came may have any reason: what else was seen is named before it.
    let is_named = |symptom: Symptom| diagnoses().iter().any(|cause| cause.sight(symptom).is_some());
    let has_others = seen.iter().any(|(symptom, ..)| *symptom != Symptom::NoAnswer && is_named(*symptom));
    let says = |symptom: Symptom| symptom != Symptom::NoAnswer || !has_others;
    let has_words = |cause: &Diagnosis| seen.iter().any(|(symptom, ..)| says(*symptom) && cause.sight(*symptom).is_some());
    let at = ranked.iter().position(|(_, cause)| has_words(cause))?;
    let (score, cause) = ranked[at];
    let rival = ranked.iter().enumerate().find(|(other, _)| *other != at).map(|(_, one)| *one)?;
    let with_words = seen.iter().filter_map(|one| Some((one, cause.sight(one.0)?)));
    // That no answer came may have any reason; what else was seen says more.
    let weight = |(symptom, all, ..): &Seen| (*symptom != Symptom::NoAnswer, all.failed);
    let ((symptom, all, unit, figures), words) = with_words.max_by_key(|(one, _)| weight(one))?;
    let odds = (score - rival.0).exp();
    let is_likely = all.failed >= LIKELY_EXAMPLES && odds >= LIKELY_ODDS;
    let mut all = all.clone();
    all.total = all.failed;
    let mut claim = Claim::new(&cause.code, &all, 1.0);
    claim.unit = *unit;
    claim.odds = Some((odds, rival.1.code.as_str())).filter(|(odds, _)| *odds >= 1.0);
    claim.certainty = if is_likely { Certainty::Likely } else { Certainty::Suspected };
    claim.at_most = modlens_protocol::finding::Severity::Warning;
    let examples = if all.failed == 1 { "1 example".to_owned() } else { format!("{} examples", all.failed) };
    let words = with_figures(words, *figures);
    let words = words.replace("{unit}", &unit.map_or("the unit".to_owned(), |unit| format!("unit {unit}")));
    claim.sight = Some(*symptom);
    Some((claim.fact("sight", format!("{words} ({examples}).")), cause))
}
