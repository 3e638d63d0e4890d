//! Who speaks on the line: a second master, an echo, a unit that answers for others, a writer.

use crate::claim::{duration, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::UnitCounts;
use crate::statistics::{at_least, fisher, Share};
use crate::MAX_CHANCE;

/// Requests that were sent while another one was open, and both were answered.
pub(super) fn two_masters(view: &View<'_>) -> Vec<Claim> {
    if view.bus.facts.is_network {
        return Vec::new();
    }
    let mut crossings = Tally::default();
    view.units().for_each(|(_, counts)| crossings.merge(&counts.crossings));
    if crossings.failed == 0 {
        return Vec::new();
    }
    // What only a meeting of two frames brings forth, among all that is odd.
    let odd = crossings.failed + view.bus.frames.collisions.failed + view.units().map(|(_, counts)| mixed(counts)).sum::<u64>();
    let failed = view.bus.requests_seen.failed;
    let total = view.bus.requests_seen.total.max(odd + failed);
    let Some(chance) = view.beyond_accident(Share { failed: odd + failed, total }) else { return Vec::new() };
    let is_noise = at_least(Share { failed: odd, total: odd + failed }, ODD_BY_NOISE) > MAX_CHANCE;
    let late: u64 = view.units().map(|(_, counts)| counts.late.failed).sum();
    if is_noise || late > odd {
        return Vec::new();
    }
    let share = Share { failed: odd, total };
    (crossings.total, crossings.before, crossings.after) = (share.total, 0, 0);
    let claim = Claim::new("two_masters", &crossings, chance).with_share(share);
    vec![claim.at_most(modlens_protocol::finding::Severity::Error)]
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
        for (asked, tally) in &counts.answers_for {
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

/// A unit that fails after one other unit was asked, whether that one has answered or not.
fn upset(view: &View<'_>, unit: u8, counts: &UnitCounts) -> Option<Claim> {
    let all = counts.failures.share();
    let mut by_unit: Vec<(u8, Share)> = Vec::new();
    for ((other, _), share) in &counts.by_previous {
        match by_unit.last_mut().filter(|(last, _)| last == other) {
            Some((_, sum)) => *sum = sum.with(*share),
            None => by_unit.push((*other, *share)),
        }
    }
    let several = by_unit.len() as f64;
    let others = by_unit.into_iter().filter(|(other, _)| *other != unit);
    let worst = others.map(|(other, inside)| (fisher(inside, all.without(inside)) * several, other, inside));
    let (chance, other, inside) = worst.min_by(|one, other| one.0.total_cmp(&other.0))?;
    let outside = all.without(inside);
    let chance = view.significant(chance)?;
    // A dead unit before it is another story: there the time after its silence counts.
    let answers = view.bus.units.get(&other).is_some_and(|counts| counts.failures.failed < counts.failures.total);
    (answers && inside.rate() > 3.0 * outside.rate()).then(|| {
        Claim::new("bystander", &counts.failures, chance)
            .of_unit(unit)
            .with_share(inside)
            .fact("what", format!("fails after the traffic of unit {other}"))
            .fact("contrast", format!(" there, {} of {} otherwise", outside.failed, outside.total))
    })
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
