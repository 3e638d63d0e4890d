//! Damage, told apart by where in the frame it is and whose frames it hits.

use super::answers::slow_answers_once;
use super::switched::{failures_after_writes, noise_of_writes_once};
use crate::claim::{duration, severity_of, Claim, View, FEW};
use crate::contrast::tally::Tally;
use crate::contrast::times::ByDuration;
use crate::contrast::{Symptom, UnitCounts};
use crate::observation::DamagedPart;
use crate::statistics::{at_least, at_most, both, fisher, Share};
use modlens_protocol::decimal::thousands;
use modlens_protocol::framing::Verdict;
use modlens_protocol::Ns;

/// The share of random damage that falls into the first, or the last, two bytes of a frame of eight.
const RANDOM_AT_END: f64 = 0.25;

/// Of frames that noise damages on a line that works at all, at least this share is damaged in a single bit: of several bits as
/// many would hit other frames one by one.
pub(super) const NOISE_OF_ONE_BIT: f64 = 0.2;

/// Whether noise would leave the head, which two devices have in common, less often intact, or hit a single bit more often. The
/// contrast is significant by itself; this decides between two explanations.
fn is_dense(counts: &UnitCounts) -> bool {
    let total = counts.garbled.failed;
    let single = at_most(Share { failed: counts.damaged(DamagedPart::Bit), total }, NOISE_OF_ONE_BIT);
    let with_head = counts.damaged(DamagedPart::Inside) + counts.damaged(DamagedPart::End);
    let intact = at_least(Share { failed: with_head, total }, NOISE_SPARES_HEAD);
    both(single, intact) < 0.01
}

/// Of frames that noise damages, at most this share keeps unit and function: two bytes of 25, a usual answer.
const NOISE_SPARES_HEAD: f64 = 0.92;

/// One or two stray bytes where drivers are switched.
pub(super) fn no_bias(view: &View<'_>) -> Vec<Claim> {
    let mut strays = view.bus.noise.strays.clone();
    let turns = view.bus.frames.of(Verdict::Ok);
    // Strays of other bytes than a driver leaves speak against it.
    if strays.failed * 10 < strays.total * 8 || turns == 0 || super::foreign::have_preamble(view) {
        return Vec::new();
    }
    if let Some(claim) = strays_of_one_unit(view) {
        return vec![claim];
    }
    let share = Share { failed: strays.failed.min(turns), total: turns };
    let Some(chance) = view.beyond_accident(share) else { return Vec::new() };
    (strays.total, strays.before, strays.after) = (turns, 0, 0);
    let sum = |side: usize| -> u64 { view.bus.units.values().map(|counts| counts.strays[side].failed).sum() };
    let sides = sides([sum(0), sum(1)], view.units().map(|(_, counts)| counts.heard()).sum());
    vec![Claim::new("no_bias", &strays, chance).with_share(share).fact("sides", sides)]
}

/// Strays around the answers of one unit and of no other.
fn strays_of_one_unit(view: &View<'_>) -> Option<Claim> {
    let strays = |counts: &UnitCounts| counts.strays[0].failed + counts.strays[1].failed;
    let share = |counts: &UnitCounts| Share { failed: strays(counts).min(counts.failures.total), total: counts.failures.total };
    let (unit, counts) = view.units().max_by_key(|(_, counts)| strays(counts))?;
    let others = view.others(unit, share);
    let chance = view.significant(fisher(share(counts), others))?;
    view.beyond_accident(share(counts))?;
    if others.total == 0 || share(counts).rate() < 10.0 * others.rate() {
        return None;
    }
    let mut tally = counts.strays[0].clone();
    tally.merge(&counts.strays[1]);
    (tally.total, tally.before, tally.after) = (counts.failures.total, 0, 0);
    let sides = sides([counts.strays[0].failed, counts.strays[1].failed], counts.heard());
    Some(
        Claim::new("no_bias", &tally, chance)
            .of_unit(unit)
            .with_share(share(counts))
            .fact("sides", sides)
            .fact("of_unit", format!(" of unit {unit}")),
    )
}

/// Where the strays are, in words; of so many answers, whole or damaged.
fn sides(counts: [u64; 2], answers: u64) -> String {
    match counts {
        [0, 0] => String::new(),
        [before, 0] if answers == 0 => format!(", {before} of them after a request without an answer"),
        [before, after] if after * 9 < before => String::from(", nearly all of them before answers"),
        [before, after] if before * 9 < after => String::from(", nearly all of them after answers"),
        [before, after] => format!(", {before} before answers and {after} after them"),
    }
}

/// Fewer frames damaged in the middle do not tell where damage falls.
const LEAST_INSIDE: u64 = 3;

/// Damage in the middle of frames, of more than one unit or in both directions.
///
/// Where hardly a frame is good, bits are not flipped now and then: it is the settings or the wires.
pub(super) fn line_noise(view: &View<'_>) -> Vec<Claim> {
    let of_writes = noise_of_writes_once(view);
    if !of_writes.is_empty() {
        return of_writes.to_vec();
    }
    let frames = &view.bus.frames;
    let damaged = frames.of(Verdict::BadChecksum) + frames.of(Verdict::Incomplete);
    let good = frames.of(Verdict::Ok);
    let share = Share { failed: damaged, total: damaged + good };
    let (Some(chance), true) = (view.beyond_accident(share), good > damaged || (good * 4 > damaged && hits_both_sides(view)))
    else {
        return Vec::new();
    };
    // Noise does not repeat itself: another protocol on the wires hits as many frames as it has runs.
    if view.once("foreign_protocol", super::foreign::foreign_protocol).iter().any(|foreign| foreign.share.failed >= damaged) {
        return Vec::new();
    }
    let inside = parts(view, DamagedPart::Bit) + parts(view, DamagedPart::Inside);
    let known = inside + parts(view, DamagedPart::Start) + parts(view, DamagedPart::End) + parts(view, DamagedPart::Whole);
    // Noise spoils requests and answers. Damaged frames of no exchange are something else (foreign_protocol).
    let spoilt: u64 = view.units().map(|(_, counts)| damage(counts).failed).sum();
    let requests_seen = view.bus.requests_seen.total;
    if requests_seen > 0 && view.beyond_accident(Share { failed: spoilt.min(requests_seen), total: requests_seen }).is_none() {
        return Vec::new();
    }
    if is_of_late_answers(view) {
        return Vec::new();
    }
    // One that never answered may be the damaged address of another one.
    let has_answered = |counts: &UnitCounts| counts.answered() > 0;
    let is_hit = |counts: &UnitCounts| damage(counts).failed > 0 && has_answered(counts);
    let units: Vec<u8> = view.units().filter(|(_, counts)| is_hit(counts)).map(|(unit, _)| unit).collect();
    let requests: u64 = view.units().map(|(_, counts)| counts.bad_requests.failed).sum();
    // Of one unit alone, single bits are noise near it; what else it may be has kinds of its own.
    let is_of_one = units.len() < 2 && requests == 0 && view.units().count() > 1;
    if inside < LEAST_INSIDE || inside * 3 < known || (is_of_one && parts(view, DamagedPart::Bit) * 3 < known) {
        return Vec::new();
    }
    let tally: Tally = view.units().flat_map(|(_, counts)| [&counts.garbled, &counts.bad_requests]).sum();
    let mut claim = Claim::new("line_noise", &tally, chance).with_share(share);
    // A request fails if one of its two frames is damaged: how bad that is, is counted by requests.
    if requests_seen > 0 {
        claim = claim.at_most(severity_of(Share { failed: spoilt.min(requests_seen), total: requests_seen }));
    }
    claim = claim.in_the_time_of(&Claim::new("line_noise", &view.bus.requests_seen, 0.0));
    if let ([unit], 0, true) = (&units[..], requests, view.units().count() > 1) {
        claim = claim.of_unit(*unit);
    }
    let spread = match (units.len(), requests) {
        (1, 0) => format!("all of them answers of unit {}", units[0]),
        (_, 0) => String::from("all of them answers"),
        (1, _) => format!("{requests} of them requests"),
        (many, _) => format!("of {many} units, {requests} of them requests"),
    };
    let what = format!("{} of {} frames arrived damaged, {spread}", thousands(damaged), thousands(damaged + good));
    claim = claim.fact("what", what);
    if let Some(event) = failures_after_writes(view) {
        claim = claim.fact("event", event).fact("event_advice", "; what the write switches (a contactor, a pump, an inverter)");
    }
    vec![claim]
}

/// Whether requests and answers are damaged, more than once each. Where answers only are, it is their sender, or the recorder.
fn hits_both_sides(view: &View<'_>) -> bool {
    let sum = |value: fn(&UnitCounts) -> u64| view.units().map(|(_, counts)| value(counts)).sum::<u64>();
    sum(|counts| counts.garbled.failed) > 1 && sum(|counts| counts.bad_requests.failed) > 1
}

/// Whether damage may all be that of late answers. One meets the next request or its answer, so damage is theirs where it comes
/// after a failure, or is that of a unit that answers late (`slow_answers`).
fn is_of_late_answers(view: &View<'_>) -> bool {
    let slow: Vec<Option<u8>> = slow_answers_once(view).iter().map(|claim| claim.unit).collect();
    let late: u64 = view.units().map(|(_, counts)| counts.late.failed).sum();
    let others = view.units().filter(|(unit, _)| !slow.contains(&Some(*unit)));
    let rest = others.map(|(_, counts)| super::answers::not_of_late_answers(view, counts)).sum();
    (late > 0 || !slow.is_empty()) && view.beyond_accident(rest).is_none()
}

fn parts(view: &View<'_>, part: DamagedPart) -> u64 {
    let of = |counts: &UnitCounts| counts.damaged(part) + counts.request_parts[part as usize].failed;
    view.units().map(|(_, counts)| of(counts)).sum()
}

fn damage(counts: &UnitCounts) -> Share {
    counts.garbled.share().with(Share { failed: counts.bad_requests.failed, total: 0 })
}

/// Damage at the first or the last bytes of a unit's answers, or at the last bytes of requests.
pub(super) fn driver_enable(view: &View<'_>) -> Vec<Claim> {
    let answers = view.units().filter_map(|(unit, counts)| {
        let edge = &counts.damaged_parts[DamagedPart::Start as usize];
        let damaged = counts.garbled.share();
        let alike = begins_alike(view, counts);
        let (start, chance, place) = match alike {
            Some(_) => {
                let chance = view.beyond_accident(damaged)?;
                (&counts.garbled, chance, "from the first byte on, and begin with the same wrong bytes")
            }
            None => match at_the_edge(view, edge, damaged) {
                Some(chance) => (edge, chance, "in the first one or two bytes of its answers, and nowhere else"),
                None => (&counts.garbled, in_the_first_bytes(view, counts)?, "in the first bytes of its answers, and nowhere else"),
            },
        };
        let share = alike.map_or(start.share(), |alike| Share { failed: alike, total: damaged.failed });
        let late = "its driver-enable timing: it sends before its own transceiver, or the master's, has turned round; a delay before the answer helps";
        let claim = Claim { share, ..Claim::new("driver_enable", start, chance) };
        Some(
            claim
                .of_unit(unit)
                .fact("where", place)
                .fact("what_to_check", format!("Unit {unit}: {late}. Also how long the master holds its driver after a request."))
                .fact("experiment", format!("Set a longer response delay in unit {unit}: the first bytes are whole."))
                .at_most(severity_of(Share { failed: start.failed, total: counts.failures.total })),
        )
    });
    // Requests that miss their end often belong to no transaction.
    let cut = view.bus.frames.request_parts[DamagedPart::End as usize].clone();
    let without_transaction = Share { failed: cut.total, total: cut.total };
    let requests = view.units().fold((cut, without_transaction), |(mut tally, mut all), (_, counts)| {
        tally.merge(&counts.request_parts[DamagedPart::End as usize]);
        all = all.with(Share { failed: counts.bad_requests.failed, total: counts.failures.total });
        (tally, all)
    });
    let from_master = at_the_edge(view, &requests.0, requests.1).map(|chance| {
        Claim::new("driver_enable", &requests.0, chance)
            .fact("where", "at the end of requests, and nowhere else")
            .fact("what_to_check", "The master's adapter: it switches its driver off before the last byte has left (wait for the transmitter to be empty, not for its buffer).")
            .fact("experiment", "Use an adapter that switches by itself: the requests are whole.")
            .at_most(severity_of(requests.1))
    });
    let of_units: Vec<Claim> =
        answers.chain(ends_of_answers(view)).chain(after_answers(view)).chain(held_after_requests(view)).collect();
    let of_fast_units = if of_units.is_empty() { held_before_fast_units(view) } else { None };
    of_units.into_iter().chain(of_fast_units).chain(from_master).collect()
}

/// Units whose answers lack their beginning, and only those that begin soon: another driver still holds the line, mostly the master's.
/// Noise does not depend on that, and of two devices that answer at once no byte is missing.
fn held_after_requests<'a>(view: &'a View<'_>) -> impl Iterator<Item = Claim> + 'a {
    view.units().filter(|(_, counts)| lack_their_beginning(view, &[counts], 0.95)).filter_map(|(unit, counts)| {
        let (chance, limit) = sooner(view, &counts.garbled_by_response_time)?;
        let place = format!("from the first byte on where they begin sooner than {} after the request", duration(limit));
        let check = format!("How long the master, or its adapter, holds its driver after a request: what unit {unit} sends meanwhile is lost. A longer response delay in unit {unit} helps.");
        let (failed, total) = (counts.garbled.failed, counts.failures.total);
        let claim = Claim::new("driver_enable", &counts.garbled, chance).of_unit(unit).with_share(Share { failed, total: failed });
        let severity = severity_of(Share { failed, total });
        let experiment = format!("Set a longer response delay in unit {unit}: the first bytes are whole.");
        Some(claim.fact("where", place).fact("what_to_check", check).fact("experiment", experiment).at_most(severity))
    })
}

/// The same where each unit answers always as soon: those that do so lack their beginning, and the others are whole.
fn held_before_fast_units(view: &View<'_>) -> Option<Claim> {
    let is_whole = |counts: &&UnitCounts| counts.garbled.failed * 20 <= counts.failures.total;
    let (whole, cut): (Vec<&UnitCounts>, Vec<&UnitCounts>) = view.units().map(|(_, counts)| counts).partition(is_whole);
    if whole.is_empty() || !lack_their_beginning(view, &cut, 0.9) {
        return None;
    }
    let mut times = ByDuration::default();
    view.units().for_each(|(_, counts)| times.merge(&counts.garbled_by_response_time));
    let (chance, limit) = sooner(view, &times)?;
    let tally: Tally = cut.iter().map(|counts| &counts.garbled).sum();
    let share = Share { failed: tally.failed, total: cut.iter().map(|counts| counts.failures.total).sum() };
    let claim = Claim::new("driver_enable", &tally, chance).with_share(Share { total: tally.failed, ..share });
    let place = format!("from the first byte on, and only answers that begin sooner than {} after the request", duration(limit));
    let check = "How long the master, or its adapter, holds its driver after a request: what units send meanwhile is lost. A longer response delay in the fast units helps.";
    let experiment = "Set a longer response delay in one of these units: its first bytes are whole.";
    Some(claim.fact("where", place).fact("what_to_check", check).fact("experiment", experiment).at_most(severity_of(share)))
}

/// Whether the damaged answers of units lack bytes, and so many of them the first ones.
fn lack_their_beginning(view: &View<'_>, units: &[&UnitCounts], least: f64) -> bool {
    let sum = |value: fn(&UnitCounts) -> u64| units.iter().map(|counts| value(counts)).sum::<u64>();
    let whole = sum(|counts| counts.damaged(DamagedPart::Whole));
    let from_start = sum(|counts| counts.damaged(DamagedPart::Start)) + whole;
    let lacks_bytes = sum(|counts| counts.length_ratios.came) < sum(|counts| counts.length_ratios.expected);
    let is_short = lacks_bytes && sum(|counts| counts.odd_lengths.failed) * 2 > whole;
    let is_cut = from_start > 0 && from_start as f64 >= sum(|counts| counts.garbled.failed) as f64 * least;
    !view.bus.facts.is_network && is_short && is_cut
}

/// The chance that the answers which come sooner than a time are damaged so much more often by chance, and the time.
fn sooner(view: &View<'_>, times: &ByDuration) -> Option<(f64, Ns)> {
    let splits = times.splits();
    let limits = splits.len() as f64;
    let soon = splits.into_iter().filter(|(_, below, above)| below.rate() > 10.0 * above.rate());
    let chances = soon.map(|(limit, below, above)| (fisher(below, above) * limits, limit));
    let (chance, limit) = chances.min_by(|one, other| one.0.total_cmp(&other.0))?;
    Some((view.significant(chance)?, limit))
}

/// A unit that holds the line after its answers: what begins there is damaged, after those of others it is whole. Such a request is
/// no transaction, so that hardly any transaction fails; noise, or another device, spoils answers as well.
fn after_answers<'a>(view: &'a View<'_>) -> impl Iterator<Item = Claim> + 'a {
    let share =
        |counts: &UnitCounts| Share { failed: counts.spoiled_after.failed.min(counts.answered()), total: counts.answered() };
    // Whole frames of another protocol are no requests that were spoiled.
    let is_foreign = super::foreign::known(view).is_some();
    view.units().filter(move |_| !is_foreign).filter_map(move |(unit, counts)| {
        let (own, others) = (share(counts), view.others(unit, share));
        // One request is due after each answer.
        let spoils_others = view.bus.requests_seen.failed * 5 > own.failed || counts.spoiled_after.failed > own.total;
        if spoils_others || own.failed < FEW || own.rate() < 0.1 || others.rate() * 10.0 > own.rate() || others.total < FEW {
            return None;
        }
        let chance = view.significant(fisher(own, others))?;
        let damaged = Share { failed: own.failed, total: own.failed + others.failed };
        let claim = Claim::new("driver_enable", &counts.spoiled_after, chance).of_unit(unit).with_share(damaged);
        let held = "how long it holds its driver after an answer: what the master sends meanwhile is damaged; a delay before each request helps";
        Some(
            claim
                .fact("where", "where a request is due, right after its answers")
                .fact("what_to_check", format!("Unit {unit}: {held}."))
                .fact("experiment", format!("Let the master wait 50 ms after each answer of unit {unit}: its requests are whole.")),
        )
    })
}

/// Units whose answers lack their last byte, and are whole otherwise.
fn ends_of_answers<'a>(view: &'a View<'_>) -> impl Iterator<Item = Claim> + 'a {
    view.units().filter_map(|(unit, counts)| {
        let end = &counts.damaged_parts[DamagedPart::End as usize];
        let chance = at_the_edge(view, end, counts.garbled.share())?;
        // Where a client reads as many bytes as it expects, a stray byte in front pushes the last one out (no_bias).
        if counts.strays[0].failed * 2 > end.failed {
            return None;
        }
        let check = format!("Unit {unit}: it switches its driver off before the last byte has left (wait for the transmitter to be empty, not for its buffer). Where a program wrote the recording, whether it reads a byte too few.");
        let experiment = format!("Listen with a second adapter: if the last byte is missing there as well, it is unit {unit}; otherwise it is the program.");
        let claim = Claim::new("driver_enable", end, chance).of_unit(unit).fact("where", "at the end of its answers, and nowhere else");
        let severity = severity_of(Share { failed: end.failed, total: counts.failures.total });
        Some(claim.fact("what_to_check", check).fact("experiment", experiment).at_most(severity))
    })
}

/// Returns how many answers that are damaged from the first byte on begin alike, if nearly all do, with one wrong beginning or two (one for each function),
/// while others are whole. A driver that is switched on late shows the line at the same bit each time; two devices differ.
fn begins_alike(view: &View<'_>, counts: &UnitCounts) -> Option<u64> {
    // A late answer that meets the next request begins alike each time, too: before it, the unit was silent.
    if counts.late.failed > 0
        || counts.silent.failed * 4 > counts.garbled.failed
        || view.beyond_accident(counts.damage_after_failure[0]).is_none()
    {
        return None;
    }
    let mut heads: Vec<u64> = counts.wrong_heads.sorted().into_iter().map(|(_, count)| *count).collect();
    heads.sort_unstable_by(|one, other| other.cmp(one));
    let (all, most): (u64, u64) = (heads.iter().sum(), heads.iter().take(2).sum());
    let whole = counts.damaged(DamagedPart::Whole);
    let answered = counts.answered();
    let is_alike = all >= LEAST_BEGINNINGS && most * 10 >= whole * 8 && whole * 2 > counts.garbled.failed && answered > 0;
    is_alike.then_some(most)
}

/// Fewer beginnings may be alike by chance.
const LEAST_BEGINNINGS: u64 = 5;

/// How likely damage falls to this edge of the frame by chance.
fn at_the_edge(view: &View<'_>, edge: &Tally, damaged: Share) -> Option<f64> {
    if edge.failed * 10 < edge.total * 7 {
        return None;
    }
    view.beyond_accident(damaged)?;
    view.significant(at_least(edge.share(), RANDOM_AT_END))
}

/// Answers of which more than half are damaged in the first one or two bytes only, and all others from there on: a receiver that a
/// driver wakes inside a byte is out of step for some more.
fn in_the_first_bytes(view: &View<'_>, counts: &UnitCounts) -> Option<f64> {
    let [start, whole] = [DamagedPart::Start, DamagedPart::Whole].map(|part| &counts.damaged_parts[part as usize]);
    if start.failed * 2 < start.total || (start.failed + whole.failed) * 20 < start.total * 19 {
        return None;
    }
    view.beyond_accident(counts.garbled.share())?;
    view.significant(at_least(start.share(), RANDOM_AT_END))
}

/// The answers of one unit are damaged from the first byte on, and nothing else is.
pub(super) fn duplicate_address(view: &View<'_>) -> Vec<Claim> {
    if view.bus.facts.is_network || !noise_of_writes_once(view).is_empty() {
        return Vec::new();
    }
    // A late answer meets the next request, and its answer.
    let slow = slow_answers_once(view);
    let is_slow = |unit: u8| slow.iter().any(|claim| claim.unit == Some(unit));
    let others = view.units().filter(|(unit, counts)| answers_twice(view, *unit, counts) || !is_slow(*unit));
    let others = others.filter(|(unit, counts)| !super::answers::fails_after_late_answers(view, *unit, counts));
    others.filter_map(|(unit, counts)| duplicate(view, unit, counts)).collect()
}

/// Answers of a unit after which a second one came, whole or damaged, of all its answers.
fn twice(counts: &UnitCounts) -> Share {
    let answered = counts.answered();
    // After a silence, a second answer is mostly a late one.
    let whole = if counts.late.failed > 0 { 0 } else { counts.second_answers.failed };
    Share { failed: (whole + counts.doubled.failed).min(answered), total: answered }
}

/// Whether most answers of this unit come twice, and hardly any of others: where two masters meet, those of all do.
fn answers_twice(view: &View<'_>, unit: u8, counts: &UnitCounts) -> bool {
    let (own, others) = (twice(counts), view.others(unit, twice));
    own.rate() > 0.5 && own.rate() > 10.0 * others.rate() && view.significant(fisher(own, others)).is_some()
}

/// Whether there is such a unit.
pub(super) fn one_answers_twice(view: &View<'_>) -> bool {
    view.units().any(|(unit, counts)| answers_twice(view, unit, counts))
}

/// Whether this unit is one: what follows its first answer meets the second one.
pub(super) fn is_answering_twice(view: &View<'_>, unit: u8) -> bool {
    view.units().any(|(other, counts)| other == unit && answers_twice(view, unit, counts))
}

/// Whether most bad answers of a unit have a right checksum and another length than was asked for, or are right with inverted levels:
/// nothing has damaged these.
fn are_whole(view: &View<'_>, unit: u8, counts: &UnitCounts) -> bool {
    let is_whole = |symptom| matches!(symptom, Symptom::OtherLength | Symptom::AnswerSwapped);
    let whole = view.bus.symptoms.all().filter(|(symptom, of, _)| is_whole(*symptom) && *of == Some(unit));
    whole.map(|(_, _, seen)| 2 * seen.all.failed).sum::<u64>() > counts.garbled.failed
}

fn duplicate(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let whole = &counts.damaged_parts[DamagedPart::Whole as usize];
    let has_two = answers_twice(view, unit, counts);
    let twice = if has_two {
        twice(counts).failed
    } else if counts.late.failed > 0 {
        0
    } else {
        counts.second_answers.failed
    };
    let share = Share { failed: (counts.garbled.failed + twice).min(counts.failures.total), total: counts.failures.total };
    // Noise leaves most first bytes and nearly all lengths as they are, and often hits a single bit. Two devices begin alike
    // if they begin together, but go on differently, and rarely end together.
    let edges = counts.damaged(DamagedPart::Start) + counts.damaged(DamagedPart::End);
    // A driver makes no second answer.
    if !has_two && (begins_alike(view, counts).is_some() || are_whole(view, unit, counts)) {
        return None;
    }
    let is_overlap =
        whole.failed * 5 >= whole.total * 2 || counts.odd_lengths.failed * 2 >= counts.odd_lengths.total || is_dense(counts);
    if !has_two && (!is_overlap || edges * 2 > whole.total || counts.garbled.failed + twice == 0) {
        return None;
    }
    // A late answer meets the next request, and the next answer.
    if counts.late.failed > 0 && view.beyond_accident(counts.damage_after_failure[0]).is_none() {
        return None;
    }
    let requests = counts.bad_requests.share();
    let others = view.others(unit, damage);
    // Against the requests of the same unit, and against the other units where there are any.
    let mut chance = fisher(share, Share { failed: requests.failed, total: requests.total });
    if others.total > 0 {
        chance = chance.max(fisher(share, others));
    }
    let chance = view.significant(chance)?;
    if share.rate() < 0.1 || others.rate() * 10.0 > share.rate() {
        return None;
    }
    let tally = match twice {
        twice if counts.garbled.failed > twice => &counts.garbled,
        _ if counts.doubled.failed > counts.second_answers.failed => &counts.doubled,
        _ => &counts.second_answers,
    };
    let clean = match (requests.failed, others.total, others.failed) {
        (0, 0, _) => String::from("its requests are clean"),
        (0, _, 0) => String::from("its requests and all other units are clean"),
        (0, _, other) => format!("its requests are clean; of the other units only {other} answers are damaged"),
        (bad, _, other) => format!("only {bad} of its requests and {other} answers of other units are damaged"),
    };
    Some(Claim::new("duplicate_address", tally, chance).of_unit(unit).with_share(share).fact("clean", clean))
}
