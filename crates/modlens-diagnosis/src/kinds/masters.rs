//! Who speaks on the line: a second master, an echo, a unit that answers for others, a writer.

use std::collections::BTreeMap;

use crate::claim::{duration, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::{Pair, UnitCounts};
use crate::statistics::{at_least, both, fisher, Share};
use crate::MAX_CHANCE;

/// Requests that were sent while another one was open, and damage where two streams of requests meet.
pub(super) fn two_masters(view: &View<'_>) -> Vec<Claim> {
    let has_times = view.units().any(|(_, counts)| counts.response_times.count > 0);
    if view.bus.facts.is_network || !has_times {
        return Vec::new();
    }
    let mut crossings = Tally::default();
    view.units().for_each(|(_, counts)| crossings.merge(&counts.crossings));
    // What only a meeting of two frames brings forth, among all that is odd.
    let mixed: u64 = view.units().map(|(_, counts)| mixed(counts)).sum();
    let odd = crossings.failed + view.bus.frames.collisions.failed + mixed;
    let failed = view.bus.requests_seen.failed;
    let total = view.bus.requests_seen.total.max(odd + failed);
    let late: u64 = view.units().map(|(_, counts)| counts.late.failed).sum();
    let (Some(chance), false) = (view.beyond_accident(Share { failed: odd + failed, total }), late > odd) else {
        return Vec::new();
    };
    let by_noise = |odd: u64| at_least(Share { failed: odd, total: odd + failed }, ODD_BY_NOISE);
    // A unit that is silent for a while is no meeting: those damage frames.
    let damaged: u64 = view.units().map(|(_, counts)| counts.garbled.failed + counts.bad_requests.failed).sum();
    let is_certain = crossings.failed > 0 && by_noise(odd) <= MAX_CHANCE;
    let met = by_noise(crossings.failed + view.bus.frames.collisions.failed);
    if !is_certain && (damaged * 4 < failed || !meetings(view).is_some_and(|order| order.tells(met))) {
        return Vec::new();
    }
    let share = Share { failed: (odd + failed).min(total), total };
    let tally = if crossings.failed > 0 { crossings } else { view.bus.requests_seen.clone() };
    let tally = Tally { total: share.total, before: 0, after: 0, ..tally };
    let claim = Claim::new("two_masters", &tally, chance).with_share(share);
    vec![claim.at_most(modlens_protocol::finding::Severity::Error)]
}

/// The order of requests: that of one master's list, and how often they come in another one.
struct Order {
    /// Requests that failed behind, or in front of, one that they do not usually follow: the chance that so many do by accident.
    chance: f64,
    /// Whether those out of order are mostly clean.
    varies_by_itself: bool,
    /// Some requests are sent more often than others, and not a whole number of times as often.
    has_two_cycles: bool,
}

impl Order {
    /// Whether there are two masters; `met` is the chance that noise makes so many frames look like the meeting of two.
    fn tells(&self, met: f64) -> bool {
        // Two cycles in a varying order are two masters, or one with two lists; failures where they meet decide between them.
        let enough = if self.has_two_cycles { 10.0 * MAX_CHANCE } else { MAX_CHANCE };
        self.varies_by_itself && (both(self.chance, met) < MAX_CHANCE || self.chance < enough)
    }
}

/// Fewer requests of a kind say nothing about their cycle.
const FEW: u64 = 10;

/// One master asks in one order, and a request follows the same one or two others each time: what it follows more rarely than
/// one time in so many is out of order.
const USUAL: u64 = 4;

/// What the order of requests shows, if there is one. Noise makes requests unreadable and so changes the order, too, but then
/// most of those out of order have failed themselves.
fn meetings(view: &View<'_>) -> Option<Order> {
    let requests = view.bus.requests.sorted();
    let mut pairs: Vec<(u64, u64, Pair)> = Vec::new();
    for (key, counts) in &requests {
        pairs.extend(counts.after.sorted().into_iter().map(|(before, pair)| (*before, key.hash(), *pair)));
    }
    let (mut of_first, mut of_second) = (BTreeMap::<u64, u64>::new(), BTreeMap::<u64, u64>::new());
    for (first, second, pair) in &pairs {
        *of_first.entry(*first).or_default() += pair.total;
        *of_second.entry(*second).or_default() += pair.total;
    }
    // Out of order and in order: by what the second follows, and by what follows the first.
    let (mut behind, mut in_front) = ([Share::default(); 2], [Share::default(); 2]);
    let (mut clean, mut failed) = (0, 0);
    for (first, second, pair) in &pairs {
        let usual = pair.total * USUAL >= of_second[second];
        let at = usize::from(usual);
        behind[at] = behind[at].with(Share { failed: pair.second_failed, total: pair.total });
        if !usual {
            (clean, failed) = (clean + pair.clean, failed + pair.total - pair.clean);
        }
        let at = usize::from(pair.total * USUAL >= of_first[first]);
        in_front[at] = in_front[at].with(Share { failed: pair.first_failed, total: pair.total });
    }
    let chance = (2.0 * fisher(behind[0], behind[1]).min(fisher(in_front[0], in_front[1]))).min(1.0);
    let varies_by_itself = clean >= FEW && clean * 5 >= failed * 4;
    Some(Order { chance, varies_by_itself, has_two_cycles: has_two_cycles(view) }).filter(|_| !pairs.is_empty())
}

/// The requests of one master are sent equally often, or one of them a whole number of times as often as another one; a share of
/// them is lost.
fn has_two_cycles(view: &View<'_>) -> bool {
    let lost = view.bus.requests_seen.share().rate();
    let often: Vec<u64> =
        view.bus.requests.sorted().iter().map(|(_, counts)| counts.period.count).filter(|count| *count >= FEW).collect();
    let Some(most) = often.iter().max() else { return false };
    let is_apart = |count: &u64| {
        let ratio = *most as f64 / *count as f64;
        (ratio - ratio.round()).abs() > 0.08 + lost * ratio / 2.0
    };
    often.iter().filter(|count| is_apart(count)).count() > 1
}

/// Noise makes one damaged frame in so many look like the meeting of two.
const ODD_BY_NOISE: f64 = 0.05;

/// Answers that fit no open request of their unit.
fn mixed(counts: &UnitCounts) -> u64 {
    let others: u64 = counts.answered_by.values().chain(counts.answers_for.values()).map(|tally| tally.failed).sum();
    counts.other_functions.failed + counts.second_answers.failed + others
}

/// Requests that are heard twice.
pub(super) fn own_echo(view: &View<'_>) -> Vec<Claim> {
    let mut echoes = view.bus.frames.echoes.clone();
    view.units().for_each(|(_, counts)| echoes.merge(&counts.echoes));
    let requests = Share { failed: echoes.failed, total: view.bus.requests_seen.total.max(echoes.failed) };
    let Some(chance) = view.beyond_accident(requests) else { return Vec::new() };
    (echoes.total, echoes.before, echoes.after) = (requests.total, 0, 0);
    let failing = view.bus.requests_seen.share();
    let severity = crate::claim::severity_of(failing);
    vec![Claim::new("own_echo", &echoes, chance).at_most(severity)]
}

/// A unit that answers for others, or fails after the traffic of one of them.
pub(super) fn bystander(view: &View<'_>) -> Vec<Claim> {
    let mut found: Vec<Claim> = Vec::new();
    for (asked, counts) in view.bus.units.iter().filter(|_| !view.bus.facts.is_network) {
        for (unit, tally) in &counts.answered_by {
            let share = Share { failed: tally.failed, total: counts.failures.total.max(tally.failed) };
            let Some(chance) = view.beyond_accident(share) else { continue };
            let claim = Claim::new("bystander", tally, chance).of_unit(*unit).with_share(share);
            found.push(claim.fact("what", format!("answers requests to unit {asked}")));
        }
    }
    for (unit, counts) in view.bus.units.iter().filter(|_| !view.bus.facts.is_network) {
        // Unit 0 is all units: who reads from it gets answers of any (gateway_unit_id).
        for (asked, tally) in counts.answers_for.iter().filter(|(asked, _)| **asked != 0) {
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
    let after_answers = || counts.by_previous.iter().filter(|((_, was_silent), _)| !was_silent);
    let all = after_answers().fold(Share::default(), |sum, (_, share)| sum.with(*share));
    let others = after_answers().filter(|((other, _), _)| *other != unit);
    let worst = others.map(|((other, _), inside)| (fisher(*inside, all.without(*inside)), *other, *inside));
    let (chance, other, inside) = worst.min_by(|one, other| one.0.total_cmp(&other.0))?;
    let outside = all.without(inside);
    let several = after_answers().count() as f64;
    let corrected = view.significant(chance * several)?;
    if inside.rate() <= 3.0 * outside.rate() || best_by_request(view, unit) <= chance {
        return None;
    }
    Some(
        Claim::new("bystander", &counts.failures, corrected)
            .of_unit(unit)
            .with_share(inside)
            .fact("what", format!("fails after the traffic of unit {other}"))
            .fact("contrast", format!(" there, {} of {} otherwise", outside.failed, outside.total)),
    )
}

/// In a fixed cycle, a request always follows the same one. So the chance that some request to the unit fails as often as it
/// does by accident, whatever came before it.
fn best_by_request(view: &View<'_>, unit: u8) -> f64 {
    let requests = view.bus.requests.sorted();
    let own = || requests.iter().filter(|(key, _)| key.unit == unit).map(|(_, counts)| counts.failures());
    let all = own().fold(Share::default(), Share::with);
    own().map(|inside| fisher(inside, all.without(inside))).fold(1.0, f64::min)
}

/// Writes that never change anything.
pub(super) fn unexpected_writer(view: &View<'_>) -> Vec<Claim> {
    let requests = view.bus.requests.sorted();
    let writes = requests.into_iter().filter(|(_, counts)| counts.writes && counts.written.failed >= 10 && counts.changes == 0);
    let claims = writes.map(|(key, counts)| {
        let period = counts.period.percentile(0.5).map_or(String::new(), |period| format!(", one each {}", duration(period)));
        let block = match key.quantity {
            1 => format!("address {}", key.address),
            _ => format!("addresses {} to {}", key.address, u32::from(key.address) + u32::from(key.quantity) - 1),
        };
        Claim::new("unexpected_writer", &counts.written, 0.0)
            .of_unit(key.unit)
            .at(key.function, key.address)
            .fact("block", block)
            .fact("period", period)
    });
    claims.collect()
}
