//! Two masters on one line: two lists of requests, each in its own time, and damage where they meet.

use std::collections::BTreeMap;

use super::answers::{self, slow_answers_once};
use super::damage::NOISE_OF_ONE_BIT;
use super::interleaved::Interleaved;
use crate::claim::{were, Claim, View};
use crate::contrast::tally::Tally;
use crate::contrast::{Pair, UnitCounts};
use crate::observation::{DamagedPart, READ_REQUEST_BYTES};
use crate::statistics::{at_least, at_most, both, Share};
use crate::MAX_CHANCE;
use modlens_protocol::decimal::thousands;
use modlens_protocol::finding::Severity;

/// Requests that were sent while another one was open, and damage where two streams of requests meet.
pub(super) fn two_masters(view: &View<'_>) -> Vec<Claim> {
    let has_times = view.units().any(|(_, counts)| counts.response_times.count > 0);
    if view.bus.facts.is_network || !has_times || super::damage::one_answers_twice(view) {
        return Vec::new();
    }
    let crossings: Tally = view.units().map(|(_, counts)| &counts.crossings).sum();
    // What only a meeting of two frames brings forth, among all that is odd.
    let odd = crossings.failed + view.bus.frames.collisions.failed + mixed(view);
    let failed = view.bus.requests_seen.failed;
    let total = view.bus.requests_seen.total.max(odd + failed);
    // Two frames that meet spoil each other: where no byte is damaged, what fails is silent for another reason.
    if odd + damaged(view) == 0 {
        return Vec::new();
    }
    let late: u64 = view.units().map(|(_, counts)| counts.late.failed).sum();
    let (Some(chance), false) = (view.beyond_accident(Share { failed: odd + failed, total }), late > odd) else {
        return Vec::new();
    };
    let by_noise = |odd: u64| at_least(Share { failed: odd, total: odd + failed }, ODD_BY_NOISE);
    // Another protocol spoils answers, after which the master asks on without having waited.
    let is_foreign = super::foreign::is_surely_foreign(view);
    let met = crossings.failed + if is_foreign { 0 } else { hasty(view) };
    let crossed = at_least(Share { failed: met, total: met + failed }, CROSSED_BY_NOISE);
    let is_hasty = met > 1 && (crossed <= MAX_CHANCE || both(crossed, superimposed(view)) <= MAX_CHANCE);
    let twice = super::interleaved::interleaved(view);
    let drifts = twice.as_ref().is_some_and(|twice| twice.chance() <= DECIDES);
    let is_refuted = !drifts && twice.as_ref().is_some_and(Interleaved::is_refuted);
    let has_one_list = drifts || (!is_refuted && has_one_list_twice(view));
    // Two frames that meet are not cut at the same place each time, as by the driver of one master.
    let is_cut = odd == 0 && view.once("driver_enable", super::damage::driver_enable).iter().any(|claim| claim.unit.is_none());
    if !drifts && (is_cut || is_of_one_slow_master(view)) {
        return Vec::new();
    }
    let is_certain = has_one_list || (crossings.failed > 0 && by_noise(odd) <= MAX_CHANCE) || is_hasty;
    let met = by_noise(crossings.failed + view.bus.frames.collisions.failed);
    // A late answer meets the next request, too: who asks it is one master.
    let is_slow = || !slow_answers_once(view).is_empty();
    if !is_certain
        && (is_refuted || is_foreign || is_slow() || !order(view).is_some_and(|order| order.tells(both(met, superimposed(view)))))
    {
        return Vec::new();
    }
    // What is said has to be countable in the transactions: those that failed, and those that met another one.
    let met = match (crossings.failed, view.bus.frames.collisions.failed) {
        (0, 0) => ", where the requests of the two meet".to_owned(),
        (0, 1) => ", and 1 frame collided with another one".to_owned(),
        (0, count) => format!(", and {} frames collided with others", thousands(count)),
        (count, _) => format!(", and {} sent while another one was open", were(count)),
    };
    let tally = Tally { before: 0, after: 0, ..view.bus.requests_seen.clone() };
    let mut claim = Claim::new("two_masters", &tally, chance).fact("met", met);
    claim.harm = (odd + failed).min(total);
    vec![claim.at_most(Severity::Error)]
}

/// Whether all damage is that of answers later than the master waits: they meet its next request. Where most requests come soon after
/// a failure, that shows nothing.
fn is_of_one_slow_master(view: &View<'_>) -> bool {
    let rest = view.units().fold(Share::default(), |sum, (_, counts)| sum.with(answers::not_of_late_answers(view, counts)));
    let asked: u64 = view.units().map(|(_, counts)| counts.failures.total).sum();
    let damage_is_late = view.units().any(|(_, counts)| answers::damages_late(view, counts));
    damage_is_late && rest.total * 2 > asked && view.beyond_accident(rest).is_none()
}

/// A valid request while another one is open, which is answered after all: noise makes one failure in so many look so.
const CROSSED_BY_NOISE: f64 = 0.01;

/// Requests that came so soon after another one that no unit could have begun to answer that: a master waits for its timeout.
fn hasty(view: &View<'_>) -> u64 {
    let fastest = view.units().filter_map(|(_, counts)| counts.response_times.percentile(0.05)).min();
    let request = i64::from(READ_REQUEST_BYTES) * view.bus.facts.char_ns.unwrap_or(0);
    fastest.map_or(0, |fastest| view.bus.hasty.below(fastest + request))
}

/// Noise makes one damaged frame in so many look like the meeting of two.
const ODD_BY_NOISE: f64 = 0.05;

/// Damaged answers and requests of all units.
fn damaged(view: &View<'_>) -> u64 {
    view.units().map(|(_, counts)| counts.damaged_frames()).sum()
}

/// Answers that fit no open request of their unit. Those of one unit to the requests of others may be its own fault (`bystander`);
/// where masters meet, it happens to all, so the unit with most of them is left out.
fn mixed(view: &View<'_>) -> u64 {
    let mut by_answering = BTreeMap::<u8, u64>::new();
    let mut own = 0;
    for (unit, counts) in view.units() {
        own += counts.other_functions.failed + counts.second_answers.failed;
        *by_answering.entry(unit).or_default() += counts.answers_for.values().map(|tally| tally.failed).sum::<u64>();
        for (other, tally) in &counts.answered_by {
            *by_answering.entry(*other).or_default() += tally.failed;
        }
    }
    own + by_answering.values().sum::<u64>() - by_answering.values().max().copied().unwrap_or(0)
}

/// Noise changes the length of a damaged frame where it hits a start or stop bit, two of ten, or adds a character to it.
const NOISE_OF_ODD_LENGTH: f64 = 0.3;

/// The chance that noise damages frames so densely and gives so many of them another length. Two frames at once end at different
/// times and differ in half of their bits.
///
/// Of one unit alone, it is that unit's doing; damage that follows a failure may be that of a late answer.
fn superimposed(view: &View<'_>) -> f64 {
    let worst = view.units().map(|(_, counts)| counts.garbled.failed).max().unwrap_or(0);
    let asked: u64 = view.units().map(|(_, counts)| counts.failures.total).sum();
    if view.beyond_accident(Share { failed: damaged(view) - worst, total: asked }).is_none() {
        return 1.0;
    }
    let sum = |value: &dyn Fn(&UnitCounts) -> u64| view.units().map(|(_, counts)| value(counts)).sum::<u64>();
    let single = sum(&|counts| counts.damaged(DamagedPart::Bit));
    let edges = sum(&|counts| counts.damaged(DamagedPart::Start) + counts.damaged(DamagedPart::End));
    let damaged = single + sum(&|counts| counts.damaged(DamagedPart::Inside) + counts.damaged(DamagedPart::Whole));
    let odd: Share = view.units().map(|(_, counts)| counts.odd_lengths.share()).sum();
    if edges * 2 > damaged {
        return 1.0;
    }
    both(at_most(Share { failed: single, total: damaged }, NOISE_OF_ONE_BIT), at_least(odd, NOISE_OF_ODD_LENGTH))
}

/// More often than this, a request that comes right after itself is in the list of one master twice.
const TWICE_IN_LIST: f64 = 0.3;

/// Whether several reads now and then come right after themselves, though they were answered, and frames are damaged: two
/// masters with the same list meet in it as they drift. One master asks for all others before it asks again.
fn has_one_list_twice(view: &View<'_>) -> bool {
    let requests = &view.requests;
    let reads: Vec<Share> = requests
        .iter()
        .filter(|(_, counts)| !counts.writes && counts.sent() >= FEW)
        .map(|(_, counts)| Share { failed: counts.repeated.min(counts.sent()), total: counts.sent() })
        .collect();
    let repeated = reads.iter().filter(|share| share.failed > 0).count();
    let all = reads.iter().copied().sum();
    let asked: u64 = view.units().map(|(_, counts)| counts.failures.total).sum();
    reads.len() > 2
        && repeated * 2 >= reads.len()
        && reads.iter().all(|share| share.rate() < TWICE_IN_LIST)
        && view.beyond_accident(all).is_some()
        && view.beyond_accident(Share { failed: damaged(view).min(asked), total: asked }).is_some()
}

/// The order of requests: that of one master's list, and how often they come in another one.
struct Order {
    /// Requests that failed after, or in front of, one that they do not usually follow: how likely so many are by chance.
    chance: f64,
    /// Whether those out of order are mostly clean.
    varies_by_itself: bool,
    /// Some requests are sent more often than others, and not a whole number of times as often.
    has_two_cycles: bool,
}

/// That frames fail is no accident; between two explanations, one that is wrong so rarely decides.
const DECIDES: f64 = 0.05;

impl Order {
    /// Whether there are two masters; `met` is the chance that noise makes so many frames look like the meeting of two.
    fn tells(&self, met: f64) -> bool {
        // Two cycles in a varying order are two masters, or one with two lists; how frames are damaged, and where, decides.
        let enough = if self.has_two_cycles { DECIDES } else { MAX_CHANCE };
        self.varies_by_itself && both(self.chance, met) < enough
    }
}

/// Fewer requests of a kind say nothing about their cycle.
const FEW: u64 = 10;

/// One master asks in one order, and a request follows the same one or two others each time: what it follows more rarely than
/// one time in so many is out of order.
const USUAL: u64 = 4;

/// Failures of one request, in an unusual place and in all.
#[derive(Clone, Copy, Default)]
struct Stratum {
    unusual: Share,
    all: Share,
}

/// What the order of requests shows, if there is one. Noise makes requests unreadable and so changes the order, too, but then
/// most of those out of order have failed themselves.
fn order(view: &View<'_>) -> Option<Order> {
    let requests = &view.requests;
    let mut pairs: Vec<(u64, u64, Pair)> = Vec::new();
    for (key, counts) in requests {
        pairs.extend(counts.after.sorted().into_iter().map(|(before, pair)| (*before, key.hash(), *pair)));
    }
    let (mut of_first, mut of_second) = (BTreeMap::<u64, u64>::new(), BTreeMap::<u64, u64>::new());
    for (first, second, pair) in &pairs {
        *of_first.entry(*first).or_default() += pair.total;
        *of_second.entry(*second).or_default() += pair.total;
    }
    let (mut behind, mut in_front) = (BTreeMap::<u64, Stratum>::new(), BTreeMap::<u64, Stratum>::new());
    let (mut clean, mut failed) = (0, 0);
    for (first, second, pair) in &pairs {
        // A request that is sent every tenth time has a place of its own: it always follows, or precedes, the same one.
        let usual = pair.total * USUAL >= of_second[second] || pair.total * USUAL >= of_first[first];
        // Failures come in bursts, whoever asks: so one counts if the other request of the pair went well.
        let share = Share { failed: pair.total - pair.first_failed - pair.clean, total: pair.total - pair.first_failed };
        behind.entry(*second).or_default().add(share, usual);
        if !usual {
            (clean, failed) = (clean + pair.clean, failed + pair.total - pair.clean);
        }
        let share = Share { failed: pair.total - pair.second_failed - pair.clean, total: pair.total - pair.second_failed };
        in_front.entry(*first).or_default().add(share, usual);
    }
    let chance = (2.0 * by_accident(behind.values()).min(by_accident(in_front.values()))).min(1.0);
    let varies_by_itself = clean >= FEW && clean * 5 >= failed * 4;
    Some(Order { chance, varies_by_itself, has_two_cycles: has_two_cycles(view) }).filter(|_| !pairs.is_empty())
}

impl Stratum {
    fn add(&mut self, share: Share, usual: bool) {
        self.all = self.all.with(share);
        if !usual {
            self.unusual = self.unusual.with(share);
        }
    }
}

/// The chance that so many failures fall into unusual places if those of each request are spread over all its places: a request
/// that often fails, and now and then has another neighbour, says nothing.
///
/// The number of failures in unusual places is a sum of independent trials with different probabilities, and at its upper end that
/// is never likelier than with the mean probability for all (Hoeffding 1956).
fn by_accident<'a>(strata: impl Iterator<Item = &'a Stratum>) -> f64 {
    let (mut unusual, mut expected) = (Share::default(), 0.0);
    for stratum in strata.filter(|stratum| stratum.unusual.total > 0) {
        unusual = unusual.with(stratum.unusual);
        expected += stratum.unusual.total as f64 * stratum.all.rate();
    }
    if (unusual.failed as f64) < expected + 1.0 {
        return 1.0;
    }
    at_least(unusual, expected / unusual.total as f64)
}

/// The requests of one master are sent equally often, or one of them a whole number of times as often as another one; a share of
/// them is lost.
fn has_two_cycles(view: &View<'_>) -> bool {
    let lost = view.bus.requests_seen.share().rate();
    let often: Vec<u64> = view.requests.iter().map(|(_, counts)| counts.period.count).filter(|count| *count >= FEW).collect();
    let Some(most) = often.iter().max() else { return false };
    let is_apart = |count: &u64| {
        let ratio = *most as f64 / *count as f64;
        (ratio - ratio.round()).abs() > 0.08 + lost * ratio / 2.0
    };
    often.iter().filter(|count| is_apart(count)).count() > 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stratum(unusual: (u64, u64), all: (u64, u64)) -> Stratum {
        let share = |(failed, total)| Share { failed, total };
        Stratum { unusual: share(unusual), all: share(all) }
    }

    #[test]
    fn a_request_that_fails_everywhere_says_nothing_of_its_places() {
        // 7 of 37 in unusual places and 53 of 250 in usual ones; all other requests are good everywhere.
        assert!(by_accident([stratum((7, 37), (60, 287)), stratum((0, 37), (0, 290))].iter()) > 0.5);
        // 5 of 10 against 5 of 200, by hand: at least 5 of 10 at 1 in 21 is 252 * 21^-5 * (20/21)^5 and less: about 5e-5.
        let chance = by_accident([stratum((5, 10), (10, 210))].iter());
        assert!(chance > 4e-5 && chance < 7e-5, "{chance}");
    }
}
