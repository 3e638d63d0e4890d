//! Answers that come late, for a while not at all, or never.

use std::rc::Rc;

use modlens_protocol::Ns;

use super::unheard::Unheard;
use crate::claim::{duration, percent, Certainty, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::UnitCounts;
use crate::statistics::{at_least, fisher, in_runs_at_most, Share};
use crate::MAX_CHANCE;

/// The claims of `slow_answers`, recognized once for all kinds: a late answer shows itself as other troubles as well.
pub(super) fn slow_answers_once(view: &View<'_>) -> Rc<[Claim]> {
    view.once("slow_answers", slow_answers)
}

/// Answers that come after the master has given up, or that press against its timeout.
pub(super) fn slow_answers(view: &View<'_>) -> Vec<Claim> {
    let slow = |unit: u8, counts: &UnitCounts| {
        late(view, unit, counts)
            .or_else(|| overtaken(view, unit, counts))
            .or_else(|| pressing(view, unit, counts))
            .or_else(|| meeting(view, unit, counts))
            .or_else(|| intruding(view, unit, counts))
            .or_else(|| spoiling(view, unit, counts))
            .or_else(|| unheard(view, unit, counts))
    };
    view.units().filter_map(|(unit, counts)| slow(unit, counts)).collect()
}

/// On a network, an answer finds its request however late it comes. It was too late if the client had gone on without it; one
/// that goes on without most answers asks ahead by intention.
fn overtaken(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let mut answers = counts.overtaken.answers.clone();
    let share = Share { failed: answers.failed.min(counts.failures.total), total: counts.failures.total };
    let asks_ahead: Share =
        view.units().map(|(_, counts)| Share { failed: counts.overtaken.answers.failed, total: counts.failures.total }).sum();
    // On a line, no answer has an identifier by which it finds its request.
    if view.bus.facts.is_line() || view.bus.connections.clients.sorted().len() > 1 || asks_ahead.rate() > 0.5 {
        return None;
    }
    if asks_together(counts) {
        return None;
    }
    let chance = view.beyond_accident(share)?;
    (answers.total, answers.before, answers.after) = (share.total, 0, 0);
    let mut claim = Claim::new("slow_answers", &answers, chance).of_unit(unit).with_share(share);
    if let (Some(waited), Some(needed)) = (counts.overtaken.waited.percentile(0.5), counts.overtaken.needed.percentile(1.0)) {
        claim = claim
            .fact("timeout", format!(", after {}", duration(waited)))
            .fact("needed", format!("; the slowest answer took {}", duration(needed)));
        claim = suggested(claim, needed + needed / 2);
    }
    Some(claim)
}

/// Whether the client went on sooner than the answers in time take. A timeout is longer than these; a client that does not wait
/// as long sends several requests together, some of them in one packet, and has not given up any.
fn asks_together(counts: &UnitCounts) -> bool {
    // Of a client that gives up, the answers that were overtaken are the slowest ones: the others are those in time.
    let answers = counts.response_times.count.max(1) as f64;
    let in_time = 1.0 - (counts.overtaken.answers.failed as f64 / answers).min(1.0);
    let waited = counts.overtaken.waited.percentile(0.5);
    waited.zip(counts.response_times.percentile(in_time / 2.0)).is_some_and(|(waited, median)| waited < median)
}

fn late(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let share = Share { failed: counts.late.failed.min(counts.failures.total), total: counts.failures.total };
    let chance = view.beyond_accident(share).or_else(|| with_late_ones(view, unit, counts))?;
    let mut late = counts.late.clone();
    (late.total, late.before, late.after) = (share.total, 0, 0);
    let mut claim = Claim::new("slow_answers", &late, chance).of_unit(unit).with_share(share);
    // Where most failures are late answers, those in time in between part their spells.
    if late.failed * 2 > counts.failures.failed {
        claim = claim.in_the_time_of(&Claim::new("slow_answers", &counts.failures, 0.0));
    }
    if let Some(waited) = counts.waited.percentile(0.5) {
        claim = claim.fact("timeout", format!(", after {}", duration(waited)));
    }
    if let Some(needed) = counts.late_after.percentile(1.0) {
        claim = suggested(claim.fact("needed", format!("; the slowest answer took {}", duration(needed))), needed + needed / 2);
    }
    Some(claim)
}

/// A few of the failures are known to be late answers, and hardly another unit fails: the chance of all of them.
fn with_late_ones(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<f64> {
    let (late, failed) = (counts.late.failed, counts.failures.share());
    let others = view.others(unit, |other| other.failures.share());
    if late < 2 || late * 5 < failed.failed || others.rate() * 5.0 > failed.rate() {
        return None;
    }
    view.beyond_accident(failed)
}

/// Many good answers come shortly before the timeout, and few late ones or none are seen: those that failed were later still.
/// A late answer is damaged if it meets the next request; so where some are seen, all failures are taken together.
fn pressing(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let failed = if counts.late.failed > 0 { &counts.failures } else { &counts.silent };
    let chance = view.beyond_accident(failed.share())?;
    let timeout = counts.waited.percentile(0.1)?;
    let (median, high) = (counts.response_times.percentile(0.5)?, counts.response_times.percentile(0.9)?);
    let presses = high > timeout / 2 && high < timeout * 2 && median * 3 > timeout;
    (presses && counts.response_times.count >= 10).then(|| {
        let claim = Claim::new("slow_answers", failed, chance)
            .of_unit(unit)
            .fact("timeout", format!(", after {}", duration(timeout)))
            .fact("needed", format!("; of the answers in time, one in ten took more than {}", duration(high)));
        suggested(claim, 2 * timeout)
    })
}

/// Answers are damaged that come as late as the master waits: they meet its next request, and those that come sooner are whole.
fn meeting(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let met = meets_next(view, counts)?;
    let chance = view.significant(met.chance)?;
    let needed = format!("; answers that take more than {} meet its next request", duration(met.limit));
    let claim = Claim::new("slow_answers", &counts.failures, chance).of_unit(unit).fact("needed", needed);
    // Where each late answer meets a request, no silence shows the timeout; it is near the limit.
    let timeout = waited(view, counts);
    let claim = match timeout {
        Some(timeout) => claim.fact("timeout", format!(", after {}", duration(timeout))),
        None => claim,
    };
    Some(suggested(claim, 2 * timeout.unwrap_or(met.limit)))
}

/// Damaged answers by when they begin.
struct MeetsNext {
    limit: Ns,
    /// Damaged ones that begin later than the limit.
    late: u64,
    chance: f64,
}

/// How long the master waits, by the requests to the unit without any answer, or else to others.
fn waited(view: &View<'_>, counts: &UnitCounts) -> Option<Ns> {
    let others = || view.units().filter_map(|(_, counts)| counts.waited.percentile(0.5)).min();
    counts.waited.percentile(0.5).or_else(others)
}

/// The limit above which answers are damaged, as far as they begin about when the master asks again, and below which they are whole.
fn meets_next(view: &View<'_>, counts: &UnitCounts) -> Option<MeetsNext> {
    if view.bus.facts.is_network {
        return None;
    }
    let timeout = waited(view, counts);
    let splits = counts.garbled_by_response_time.splits();
    let limits = splits.len() as f64;
    let is_alike = |limit: Ns, late: u64| {
        let within = splits.iter().filter(|(other, _, _)| *other <= 2 * limit).map(|(_, below, _)| below.failed).max();
        let all = splits.last().map_or(0, |(_, below, above)| below.failed + above.failed);
        // Those of the last count have no limit above them.
        let is_last = splits.last().is_some_and(|(other, _, _)| *other < 2 * limit);
        is_last || within.is_some_and(|within| (within + late - all) * 5 >= late * 4)
    };
    let late = splits.iter().filter(|(limit, below, above)| {
        // A master that goes on sooner than this has not waited for its timeout. After a request that was met it waits twice.
        let begin = counts.garbled_by_response_time.least_above(*limit);
        let is_late = timeout.map_or_else(|| is_alike(*limit, above.failed), |timeout| begin * 3 > timeout);
        is_late && above.rate() > MOST_MEET && above.rate() > 10.0 * below.rate()
    });
    let chances = late.map(|(limit, below, above)| MeetsNext {
        limit: counts.garbled_by_response_time.least_above(*limit),
        late: above.failed,
        chance: fisher(*above, *below) * limits,
    });
    chances.min_by(|one, other| one.chance.total_cmp(&other.chance))
}

/// Of answers that come later than the limit, which is a little below the timeout, at least this share meet a request.
const MOST_MEET: f64 = 0.25;

/// Whether a unit's answers are damaged where they come late, or damage those of others.
pub(super) fn damages_late(view: &View<'_>, counts: &UnitCounts) -> bool {
    let meets = meets_next(view, counts).is_some_and(|met| view.significant(met.chance).is_some());
    meets || intruding(view, 0, counts).is_some()
}

/// Damage of a unit that no late answer explains: a late one meets the next request or its answer, so it comes after a failure, or
/// begins as late as the master waits.
pub(super) fn not_of_late_answers(view: &View<'_>, counts: &UnitCounts) -> Share {
    let alone = counts.damage_after_failure[0];
    let late = meets_next(view, counts).filter(|met| met.chance < MAX_CHANCE).map_or(0, |met| met.late);
    Share { failed: alone.failed.saturating_sub(late), ..alone }
}

/// Answers came as those of later requests, and damaged these; later than those in time, as of a master that had given up.
fn intruding(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let failed = counts.intruding.failed + counts.late.failed;
    let share = Share { failed: failed.min(counts.failures.total), total: counts.failures.total };
    let chance = view.beyond_accident(share)?;
    let (needed, usual) = (counts.intruding_after.percentile(0.5)?, counts.response_times.percentile(0.9)?);
    if view.bus.facts.is_network || needed < usual {
        return None;
    }
    let mut claim = Claim::new("slow_answers", &counts.failures, chance).of_unit(unit).with_share(share);
    if let Some(waited) = counts.waited.percentile(0.5) {
        claim = claim.fact("timeout", format!(", after {}", duration(waited)));
    }
    let slowest = counts.intruding_after.percentile(1.0)?;
    Some(suggested(claim.fact("needed", format!("; the slowest answer took {}", duration(slowest))), slowest + slowest / 2))
}

/// Whether requests to a unit fail only after the silence of others that answer late: their answers meet it.
pub(super) fn fails_after_late_answers(view: &View<'_>, unit: u8, counts: &UnitCounts) -> bool {
    let slow = slow_answers_once(view);
    let is_slow = |other: u8| other != unit && slow.iter().any(|claim| claim.unit == Some(other));
    let after = counts.by_previous.iter().filter(|((other, was_silent), _)| *was_silent && is_slow(*other));
    let after = after.fold(Share::default(), |sum, (_, share)| sum.with(*share));
    let all = counts.by_previous.values().fold(Share::default(), |sum, share| sum.with(*share));
    let damaged = counts.damaged_frames();
    let rest = if damaged * 5 > counts.failures.failed * 4 { counts.damage_after_failure[0] } else { all.without(after) };
    after.failed > 0 && view.beyond_accident(rest).is_none()
}

/// One unit alone stays silent more often than others, and what comes within the time of a late answer is damaged more often than all
/// else: its answers may have come then. Noise spares no unit, and does not wait for a silence.
fn spoiling(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let [alone, after] = view.units().fold([Share::default(); 2], |[alone, after], (_, counts)| {
        [alone.with(counts.damage_after_failure[0]), after.with(counts.damage_after_failure[1])]
    });
    let (own, others) = (counts.silent.share(), view.others(unit, |other| other.silent.share()));
    let has_answered = counts.failures.failed < counts.failures.total;
    if view.bus.facts.is_network || !has_answered || own.rate() < 5.0 * others.rate() || after.rate() < 5.0 * alone.rate() {
        return None;
    }
    let chance = view.significant(fisher(own, others).max(fisher(after, alone)))?;
    let mut claim = Claim::new("slow_answers", &counts.failures, chance).of_unit(unit);
    claim.certainty = Certainty::Likely;
    let words = format!("; {} frames that follow within the time of a late answer are damaged", after.failed);
    Some(claim.fact("needed", words))
}

/// Good answers come when the master has stopped waiting for them, and before it asks again: to the line they are as any other.
fn unheard(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let found = Unheard::of_unit(view, unit)?;
    let chance = view.significant(found.chance)?;
    let times = &counts.response_times;
    let share = Share {
        failed: (times.count - times.below(found.timeout.unwrap_or(found.least))).max(found.seen),
        total: counts.failures.total,
    };
    let mut claim = Claim::new("slow_answers", &Tally::default(), chance).of_unit(unit).with_share(share);
    claim.examples = found.examples;
    let timeout = found.timeout.map_or(String::new(), |timeout| format!(", after {}", duration(timeout)));
    let slowest = duration(times.most);
    let needed = format!("; the slowest answer took {slowest}, and came before the next request, which did not wait for it");
    Some(suggested(claim.fact("timeout", timeout).fact("needed", needed), times.most + times.most / 2))
}

/// With the timeout to set, which is the same in what to check and in its proof.
fn suggested(claim: Claim, timeout: Ns) -> Claim {
    let timeout = duration(timeout);
    claim.fact("suggestion", format!(": {timeout} or more")).fact("raised", format!(" to {timeout}"))
}

/// A unit that never answers.
pub(super) fn dead_unit_cost(view: &View<'_>) -> Vec<Claim> {
    let dead: Vec<(u8, &UnitCounts)> = view.units().filter(|(unit, counts)| is_never_heard(view, *unit, counts)).collect();
    // A search for devices asks each address once or twice, which is no contrast by itself, but is one of many.
    let silent = dead.iter().map(|(_, counts)| counts.silent.share()).sum();
    let of_many = view.significant(at_least(silent, MOST_SILENCE)).filter(|_| dead.len() > FEW_SILENT);
    dead.iter().filter_map(|(unit, counts)| dead_unit(view, *unit, counts, of_many)).collect()
}

/// So few units that never answer are a claim each, and each has to be asked often enough for it.
pub(super) const FEW_SILENT: usize = 7;

/// The share of requests that stay without answer on the worst of lines where units answer at all, and on the best.
const MOST_SILENCE: f64 = 0.5;
const LEAST_SILENCE: f64 = 0.05;

/// How often a unit would be silent if it were so as often as the others.
pub(super) fn usual_silence(view: &View<'_>, unit: u8) -> f64 {
    view.others(unit, |other| other.silent.share()).rate().clamp(LEAST_SILENCE, MOST_SILENCE)
}

/// Whether each request of a unit failed, most of them without any answer, and none was answered late. A refusal is an answer.
fn is_never_heard(view: &View<'_>, unit: u8, counts: &UnitCounts) -> bool {
    let (silent, failures) = (counts.silent.failed, counts.failures.share());
    if unit == 0 || failures.failed < failures.total || silent * 2 <= failures.total || counts.late.failed > 0 {
        return false;
    }
    // On a noisy line some of its requests are damaged, and noise may stand where its response would: as often as with others.
    let damaged =
        |other: &UnitCounts| Share { failed: other.damaged_frames().min(other.failures.total), total: other.failures.total };
    let usual = view.others(unit, damaged).rate().max(NOISE_OF_SILENCE);
    at_least(Share { failed: failures.total - silent, total: failures.total }, usual) > MAX_CHANCE
}

/// So many requests to a unit that is not there may be followed by noise, or damaged.
const NOISE_OF_SILENCE: f64 = 0.1;

/// Claims that a unit never answers; `of_many` is the chance of all that are silent, where they are many.
fn dead_unit(view: &View<'_>, unit: u8, counts: &UnitCounts, of_many: Option<f64>) -> Option<Claim> {
    let chance = view.significant(at_least(counts.silent.share(), usual_silence(view, unit))).or(of_many)?;
    // The times are those of all failures: a damaged request is not counted as silence, but it does not end the silence.
    let all_failures = Claim::new("dead_unit_cost", &counts.failures, 0.0);
    let mut claim = Claim::new("dead_unit_cost", &counts.silent, chance).of_unit(unit).in_the_time_of(&all_failures);
    claim = claim.fact("answers", "answers").fact("what_to_check", what_to_check(unit));
    if let Some(cost) = cost_of_silence(view, &[unit]) {
        claim = claim.fact("cost", cost);
    }
    let mut answers_then = String::new();
    if let Some((poisoned, inside)) = poisoned(view, unit) {
        let words = format!(", and unit {poisoned} fails {} of {} times right after it", inside.failed, inside.total);
        claim = claim.fact("poison", words);
        answers_then = format!(", and unit {poisoned} answers");
    }
    let experiment =
        format!("Remove unit {unit} from the master's polling list: the cycle gets shorter by its waiting time{answers_then}.");
    Some(claim.fact("experiment", experiment))
}

fn what_to_check(unit: u8) -> String {
    format!(
        "Power, address, rate and wiring of unit {unit}; if it is no longer there, remove it from the master's polling list, or let the \
         master ask it less often."
    )
}

/// What the silence of units costs, in words: how long the master waits, and for how much of its time.
pub(super) fn cost_of_silence(view: &View<'_>, units: &[u8]) -> Option<String> {
    let (first, last) = view.bus.frames.span?;
    let each = units.iter().filter_map(|unit| view.bus.units.get(unit)).filter_map(|counts| {
        let waited = counts.waited.percentile(0.5)?;
        Some((waited, waited as f64 * counts.silent.failed as f64))
    });
    let (longest, sum) = each.fold((0, 0.0), |(longest, sum), (waited, all)| (waited.max(longest), sum + all));
    let share = percent((sum / (last - first).max(1) as f64).min(1.0));
    (longest > 0).then(|| format!("; the master waits {} for each, {share} of its time", duration(longest)))
}

/// The unit that fails right after the silence of this one, and how often it does.
fn poisoned(view: &View<'_>, dead: u8) -> Option<(u8, Share)> {
    view.units().filter(|(unit, _)| *unit != dead).find_map(|(unit, counts)| {
        let inside = *counts.by_previous.get(&(dead, true))?;
        let outside = counts.failures.share().without(inside);
        view.significant(fisher(inside, outside))?;
        Some((unit, inside))
    })
}

/// A unit that answers, and was silent in one or several long runs.
pub(super) fn device_absent(view: &View<'_>) -> Vec<Claim> {
    let units = view.units().filter_map(|(unit, counts)| absent(view, unit, counts).or_else(|| not_seen(view, unit, counts)));
    units.map(|claim| claim.fact("asked", "requests").fact("fate", "not answered")).chain(server_down(view)).collect()
}

/// A server at whose port nobody listens for a while.
fn server_down(view: &View<'_>) -> Option<Claim> {
    let down = &view.bus.connections.down;
    let chance = view.beyond_accident(down.share()).filter(|_| down.failed >= 2)?;
    let claim = Claim::new("device_absent", down, chance).fact("subject", "the server");
    let runs = runs_in_words(claim.episodes.len().max(1) as u64);
    Some(claim.fact("asked", "attempts to connect").fact("fate", "refused").fact("runs", runs))
}

/// Without a fine clock, a request without answer may be one whose answer the recording lacks. Where those of one unit stand
/// in runs, and those of others are there, that is the unit's doing.
fn not_seen(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let (share, in_runs) = (counts.not_seen.share(), counts.not_seen_runs.in_long());
    let others = view.others(unit, |other| other.not_seen.share());
    let are_late = counts.late.failed * 4 > share.failed;
    if are_late || share.total - share.failed < 2 || in_runs * 10 < share.failed * 8 || counts.silent.failed == share.failed {
        return None;
    }
    let runs = counts.not_seen_runs.count_of_long() + (share.failed - in_runs);
    let chance = view.significant(in_runs_at_most(share, runs).max(fisher(share, others)))?;
    (others.total > 0 && share.rate() > 3.0 * others.rate()).then(|| {
        let runs = counts.not_seen_runs.count_of_long();
        Claim::new("device_absent", &counts.not_seen, chance).of_unit(unit).fact("runs", runs_in_words(runs))
    })
}

fn absent(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let silent = counts.silent.share();
    let answered = counts.answered();
    let in_runs = counts.runs.in_long();
    if answered < 2 || in_runs * 10 < counts.failures.failed * 8 || silent.failed * 10 < counts.failures.failed * 8 {
        return None;
    }
    // A retry after each failure makes runs of them by itself: so retries are left out.
    let repeated = counts.repeated_failures;
    let all = Share { failed: counts.runs.failures() - repeated, total: counts.failures.total - repeated };
    let runs = counts.runs.count_of_long() + (counts.runs.failures() - in_runs);
    let chance = view.corrected(in_runs_at_most(all, runs));
    if chance >= MAX_CHANCE || view.beyond_accident(silent).is_none() || counts.late.failed * 4 > silent.failed {
        return None;
    }
    let runs = runs_in_words(counts.runs.count_of_long());
    Some(Claim::new("device_absent", &counts.silent, chance).of_unit(unit).fact("runs", runs))
}

fn runs_in_words(runs: u64) -> String {
    match runs {
        1 => String::from("one run"),
        many => format!("{many} runs"),
    }
}
