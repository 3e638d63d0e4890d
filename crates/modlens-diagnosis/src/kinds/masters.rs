//! Who speaks on the line besides the master and the unit asked: an echo, a unit that answers for others, a writer.

use super::answers::slow_answers_once;
use super::damage::is_answering_twice;
use crate::claim::{duration, Certainty, Claim, ShownBy, View};
use crate::contrast::tally::{Place, Tally};
use crate::contrast::{ClientCounts, RequestCounts, UnitCounts};
use crate::observation::RequestKey;
use crate::statistics::{fisher, Share};
use modlens_protocol::decimal::thousands;
use modlens_protocol::functions::{Functions, StandardLayout};
use modlens_protocol::Ns;

/// Requests that are heard twice.
pub(super) fn own_echo(view: &View<'_>) -> Vec<Claim> {
    let mut echoes = view.bus.frames.echoes.clone();
    view.units().for_each(|(_, counts)| echoes.merge(&counts.echoes));
    let requests = Share { failed: echoes.failed, total: view.bus.requests_seen.total.max(echoes.failed) };
    let Some(chance) = view.beyond_accident(requests) else { return Vec::new() };
    (echoes.total, echoes.before, echoes.after) = (requests.total, 0, 0);
    let failing = view.bus.requests_seen.share();
    let severity = crate::claim::severity_of(failing);
    let mut claim = Claim::new("own_echo", &echoes, chance).at_most(severity);
    // Echoes of requests with an answer and of those without are counted apart; between those of one kind are those of the other.
    if echoes.failed * 10 > echoes.total * 9 {
        claim.episodes.clear();
    }
    vec![claim]
}

/// A unit that answers for others, or fails after the traffic of one of them.
pub(super) fn bystander(view: &View<'_>) -> Vec<Claim> {
    let mut found: Vec<Claim> = Vec::new();
    // On a network it is a gateway that answers with another number (gateway_mixup, device_busy). Of a few exchanges, the request
    // may be what is missing (sight).
    let is_line = view.bus.facts.is_line() && !view.is_small();
    for (asked, counts) in view.bus.units.iter().filter(|_| is_line) {
        for (unit, tally) in counts.answered_by.iter().filter(|(unit, _)| *unit != asked) {
            let share = Share { failed: tally.failed, total: counts.failures.total.max(tally.failed) };
            let Some(chance) = view.beyond_accident(share) else { continue };
            let claim = Claim::new("bystander", tally, chance).of_unit(*unit).shown_by(ShownBy::Unit(*asked)).with_share(share);
            found.push(claim.fact("what", format!("answers requests to unit {asked}")));
        }
    }
    for (unit, counts) in view.bus.units.iter().filter(|_| is_line) {
        // Unit 0 is all units: who reads from it gets answers of any (gateway_unit_id).
        for (asked, tally) in counts.answers_for.iter().filter(|(asked, _)| **asked != 0) {
            // Answers of other lengths than were asked for are those to another master's requests, which a client's log lacks.
            if counts.misfits.get(asked).is_some_and(|misfits| misfits * 2 > tally.failed) {
                continue;
            }
            // A damaged request names a unit that was not asked.
            let damaged = view.bus.units.get(asked).map_or(0, |counts| counts.bad_requests.failed);
            if tally.failed <= damaged {
                continue;
            }
            let total = view.bus.units.get(asked).map_or(0, |counts| counts.failures.total).max(tally.failed);
            let share = Share { failed: tally.failed, total };
            let Some(chance) = view.beyond_accident(share) else { continue };
            let claim = Claim::new("bystander", tally, chance).of_unit(*unit).with_share(share);
            found.push(claim.fact("what", format!("answers requests to unit {asked}, too")));
        }
    }
    found.extend(view.units().filter_map(|(unit, counts)| upset(view, unit, counts)));
    found
}

/// A unit that fails after one other unit has answered. After the silence of one, it is that silence (`dead_unit_cost`) or its
/// late answer (`slow_answers`) that counts.
fn upset(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    // What a write switches spoils what follows it, whoever that is (line_noise).
    if !super::switched::noise_of_writes_once(view).is_empty() {
        return None;
    }
    let after_answers = || counts.by_previous.iter().filter(|((_, was_silent), _)| !was_silent);
    let all: Share = after_answers().map(|(_, share)| *share).sum();
    let others = after_answers().filter(|((other, _), _)| *other != unit);
    let worst = others.map(|((other, _), inside)| (fisher(*inside, all.without(*inside)), *other, *inside));
    let (chance, other, inside) = worst.min_by(|one, other| one.0.total_cmp(&other.0))?;
    let outside = all.without(inside);
    let several = after_answers().count() as f64;
    let corrected = view.significant(chance * several)?;
    // A unit whose answers are late answers into the request after the next one, too (slow_answers).
    let is_slow = || slow_answers_once(view).iter().any(|claim| claim.unit == Some(other));
    if inside.rate() <= 3.0 * outside.rate() || is_slow() || is_answering_twice(view, other) {
        return None;
    }
    let mut claim = Claim::new("bystander", &counts.failures, corrected)
        .of_unit(unit)
        .with_share(inside)
        .fact("contrast", format!(" there, {} of {} otherwise", outside.failed, outside.total));
    if best_by_request(view, unit) > chance {
        return Some(claim.fact("what", format!("fails after the traffic of unit {other}")));
    }
    let (key, _) = fixed_place(view, unit, inside).filter(|_| !is_pressed(counts))?;
    claim.certainty = Certainty::Likely;
    let what = format!(
        "fails where it is asked for {} with function {}, which always comes after the traffic of unit {other}",
        key.block(),
        key.function
    );
    Some(claim.at(key.function, key.address).fact("what", what))
}

/// The request to a unit that bears all of these failures, in a cycle in which it always has the same place. It fails nearly
/// always, but not always: the unit knows it.
fn fixed_place<'a>(view: &View<'a>, unit: u8, inside: Share) -> Option<(&'a RequestKey, &'a RequestCounts)> {
    let all = &view.requests;
    let (key, counts) = all.iter().find(|(key, counts)| key.unit == unit && counts.failures() == inside)?;
    (inside.rate() > 0.8 && counts.good > 0).then_some((key, counts))
}

/// Whether answers of the unit take half of the time that the master waits, or more: it may be too slow for it.
fn is_pressed(counts: &UnitCounts) -> bool {
    let times = (counts.response_times.percentile(0.99), counts.waited.percentile(0.1));
    matches!(times, (Some(taken), Some(waited)) if taken * 2 > waited)
}

/// In a fixed cycle, a request always follows the same one. So the chance that some request to the unit fails as often as it
/// does by chance, whatever came before it.
fn best_by_request(view: &View<'_>, unit: u8) -> f64 {
    let requests = &view.requests;
    let own = || requests.iter().filter(|(key, _)| key.unit == unit).map(|(_, counts)| counts.failures());
    let all: Share = own().sum();
    own().map(|inside| fisher(inside, all.without(inside))).fold(1.0, f64::min)
}

/// So many writes that do not change anything are no accident ...
const LEAST_WRITES: u64 = 10;

/// ... of one request, or of several of the same unit that were written so often each.
const LEAST_WRITES_EACH: u64 = 5;

/// Writes that never change anything.
pub(super) fn unexpected_writer(view: &View<'_>) -> Vec<Claim> {
    let writes = constant_writes(view);
    let of_one: Vec<Claim> = writes.iter().filter(|(_, counts)| are_many(counts, LEAST_WRITES)).map(needless).collect();
    if !of_one.is_empty() {
        return of_one;
    }
    let of_units = writes.chunk_by(|(one, _), (other, _)| one.unit == other.unit).filter_map(needless_together);
    let of_units: Vec<Claim> = of_units.collect();
    if of_units.is_empty() {
        new_writer(view).into_iter().collect()
    } else {
        of_units
    }
}

/// A request that writes.
type Write<'a> = (&'a RequestKey, &'a RequestCounts);

/// The requests that write the same again and again, by unit.
fn constant_writes<'a>(view: &View<'a>) -> Vec<Write<'a>> {
    // The addresses of function 23 are those that it reads.
    let kind = |key: &RequestKey| Functions::embedded().standard_request(key.function).map(|request| request.kind);
    let is_known = |key: &RequestKey| kind(key) != Some(StandardLayout::ReadWriteRegisters);
    let is_constant = |counts: &RequestCounts| counts.writes && counts.changes == 0 && are_many(counts, LEAST_WRITES_EACH);
    let requests = view.requests.iter().copied();
    let mut writes: Vec<Write<'a>> = requests.filter(|(key, counts)| is_known(key) && is_constant(counts)).collect();
    writes.sort_by_key(|(key, _)| key.unit);
    writes
}

fn are_many(counts: &RequestCounts, least: u64) -> bool {
    counts.written.failed >= least && counts.good >= least
}

/// Claims that these writes of one request are without need.
fn needless((key, counts): &Write<'_>) -> Claim {
    let period = counts.period.percentile(0.5).map_or(String::new(), |period| format!(", one each {}", duration(period)));
    without_need(&counts.written, &key.block()).of_unit(key.unit).at(key.function, key.address).fact("period", period)
}

/// Claims that the writes of several requests to a unit are, where they are enough together.
fn needless_together(writes: &[Write<'_>]) -> Option<Claim> {
    let written = || writes.iter().map(|(_, counts)| &counts.written);
    let count = written().map(|one| one.failed).sum();
    // They are not in one order, but the first and the last are known.
    let first = written().filter_map(|one| one.first).min_by_key(|place| place.number);
    let last = written().filter_map(|one| one.last).max_by_key(|place| place.number);
    let all = Tally { failed: count, total: count, first, last, ..Tally::default() };
    let blocks: Vec<String> = writes.iter().map(|(key, _)| key.block()).collect();
    let claim = || without_need(&all, &blocks.join(" and of ")).of_unit(writes[0].0.unit).fact("period", "");
    (writes.len() > 1 && count >= LEAST_WRITES).then(claim)
}

fn without_need(written: &Tally, blocks: &str) -> Claim {
    let count = thousands(written.failed);
    let what = format!("is written to without need: {count} writes of {blocks} did not change anything");
    Claim::new("unexpected_writer", written, 0.0).fact("what", what)
}

/// A client writes so often at least, or it may be one that always writes, now and then.
const WRITES_OF_NEW_CLIENT: u64 = 3;

/// It was away for so many times its usual time from one write to the next, before it came.
const AWAY: f64 = 5.0;

/// A client, or a program of one that has others beside it.
struct Program<'a> {
    client: &'a str,
    is_beside_others: bool,
    requests: u64,
    writes: u64,
    span: Option<(Ns, Ns)>,
}

/// The programs of a client: those that are open at the same time, and of which one only writes, are two.
fn programs<'a>((client, counts): (&'a String, &ClientCounts)) -> Vec<Program<'a>> {
    let is_beside_others = counts.has_two_programs;
    let one = |requests, writes, span| Program { client: client.as_str(), is_beside_others, requests, writes, span };
    let [(written, writing), (_, reading)] = counts.kinds;
    if !is_beside_others {
        return vec![one(counts.requests, counts.writes, counts.span)];
    }
    let rest = one(counts.requests.saturating_sub(written), counts.writes.saturating_sub(written), reading);
    vec![one(written, written, writing), rest]
}

/// A client that comes later than others and only writes, where all others only read.
fn new_writer(view: &View<'_>) -> Option<Claim> {
    let programs: Vec<Program<'_>> = view.bus.connections.clients.sorted().into_iter().flat_map(programs).collect();
    let mut writers = programs.iter().enumerate().filter(|(_, program)| program.writes > 0);
    let (at, writer) = writers.next().filter(|_| writers.next().is_none())?;
    if writer.writes < WRITES_OF_NEW_CLIENT || writer.writes < writer.requests || view.is_small() {
        return None;
    }
    let (first, last) = writer.span?;
    let last = last.min(view.bus.frames.span?.1);
    let others = programs.iter().enumerate().filter(|(other, _)| *other != at).filter_map(|(_, program)| program.span);
    let begin = others.map(|(first, _)| first).min()?;
    let usual = (last - first) as f64 / (writer.writes - 1) as f64;
    if ((first - begin) as f64) < AWAY * usual {
        return None;
    }
    let [place, last] = [first, last].map(|time| Some(Place { number: 0, elapsed: None, time: Some(time) }));
    let counted = Tally { failed: writer.writes, total: writer.writes, first: place, last, ..Tally::default() };
    let own = if writer.is_beside_others { " on a connection of its own" } else { "" };
    let mut claim = Claim::new("unexpected_writer", &counted, 0.0)
        .fact("what", format!("has written {} times{own}, where all others only read,", thousands(writer.writes)));
    claim.client = Some(writer.client.to_owned());
    claim.has_begun = true;
    claim.episodes.clear();
    Some(claim)
}
