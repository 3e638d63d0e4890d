//! The counters of one unit.

use std::collections::BTreeMap;

use modlens_protocol::finding::Finding;
use modlens_protocol::functions::Functions;
use modlens_protocol::mbap::PREFIX_BYTES;
use modlens_protocol::Ns;

use super::before::Before;
use super::clean_units::CleanCounts;
use super::epochs::Epochs;
use super::overtaken::Overtaken;
use super::pauses::Pauses;
use super::runs::Runs;
use super::sample::Sample;
use super::tally::{mix, Place, Tally};
use super::times::ByDuration;
use crate::clean::Clean;
use crate::observation::{answer_length, DamagedPart, Observation, Outcome, RequestKey, DAMAGED_PARTS, MOST_LAG};
use crate::statistics::Share;
use modlens_engine::durations::Durations;

/// Exception codes that are counted one by one; 0 stands for all others.
pub const EXCEPTIONS: usize = 12;

/// What came of the requests to one unit, and under which circumstances.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UnitCounts {
    /// Requests that failed in any way but by a refusal.
    pub failures: Tally,
    /// Requests without any answer, however late.
    pub silent: Tally,
    /// Requests whose answers came damaged.
    pub garbled: Tally,
    /// Requests that were damaged themselves.
    pub bad_requests: Tally,
    /// Answers that came too late.
    pub late: Tally,
    /// Answers that nobody asked for and that are not late.
    pub second_answers: Tally,
    /// Damage right after an answer of this unit that begins as another one.
    pub doubled: Tally,
    /// Answers that came after the next request.
    pub overtaken: Overtaken,
    /// How long after the request the late ones came.
    pub late_after: Durations,
    /// Its answers that came as those of requests after it, to other units or of other functions, and damaged these.
    pub intruding: Tally,
    /// How long after the request those came.
    pub intruding_after: Durations,
    /// Refusals, by exception code, each among all that was asked.
    pub exceptions: [Tally; EXCEPTIONS],
    /// Response times of good answers.
    pub response_times: Durations,
    /// How long the master waited where no answer came.
    pub waited: Durations,
    /// Damaged answers, by the part that is damaged; those of other framings than RTU are not among them.
    pub damaged_parts: [Tally; DAMAGED_PARTS],
    /// Damaged requests, by the part that is damaged.
    pub request_parts: [Tally; DAMAGED_PARTS],
    /// Failures by the silence before the request.
    pub by_gap: ByDuration,
    /// Garbled answers, among those that are good or garbled, by the time from the end of the request to the start of the answer;
    /// from its start where the response time is not known.
    pub garbled_by_response_time: ByDuration,
    /// Failures by the unit asked before, and whether that one had not answered.
    pub by_previous: BTreeMap<(u8, bool), Share>,
    /// Failures by function.
    pub by_function: BTreeMap<u8, Share>,
    /// Failures by whether a write, to any unit, was among the four transactions before.
    pub by_write: [Share; 2],
    /// Failures by the hour of the day (UTC, or of the recording's clock).
    pub by_hour: [Share; 24],
    /// Failures by pauses inside of the request or the answer.
    pub by_pause: [Share; 2],
    /// Runs of failures.
    pub runs: Runs,
    /// Failures that repeat a request.
    pub repeated_failures: u64,
    /// Answers with stray bytes in front of them, and after them.
    pub strays: [Tally; 2],
    /// Answers of other units to requests of this one, by the unit that answered.
    pub answered_by: BTreeMap<u8, Tally>,
    /// Answers to other functions than were asked.
    pub other_functions: Tally,
    /// Transaction identifiers that are not those of the requests.
    pub other_ids: Tally,
    /// Answers that are the request itself.
    pub echoes: Tally,
    /// Answers to requests of other units, by the unit that was asked.
    pub answers_for: BTreeMap<u8, Tally>,
    /// Those of them that have not the length of the answer asked for, by the unit that was asked.
    pub misfits: BTreeMap<u8, u64>,
    /// Pauses inside of requests to it, and of its answers.
    pub pauses: [Pauses; 2],
    /// Requests to it, and its answers, with parity or framing errors of the receiver.
    pub line_errors: [Tally; 2],
    /// Requests whose answers the recording does not show, whether a clock says that the master has waited for them or not.
    pub not_seen: Tally,
    /// Runs of those.
    pub not_seen_runs: Runs,
    /// Garbled answers and damaged requests, by whether one of the few transactions before failed in any way.
    pub damage_after_failure: [Share; 2],
    /// Failures by the silence before the request, where another unit was asked before.
    pub by_gap_after_others: ByDuration,
    /// Garbled answers of another length than that expected.
    pub odd_lengths: Tally,
    /// Answers one step late.
    pub epochs: Epochs,
    /// Runs of bytes of no transaction some time after its answers, as a request leaves that is damaged from the beginning on.
    pub spoiled_after: Tally,
    /// Answers shorter, and longer, than asked for after other requests to the unit: those as long as the last one asks for, the one
    /// before that, and so on.
    pub as_long_as_before: [[Tally; 2]; MOST_LAG],
    /// Reads from unit 0, that is: from all units.
    pub reads_from_unit_0: Tally,
    /// Requests sent while another master's was open.
    pub crossings: Tally,
    /// Values that make sense in another order only.
    pub order_mismatches: Tally,
    /// Answers without a checksum that are taken as they are, while requests have one.
    pub bare: Tally,
    /// How answers begin that are damaged from the first byte on.
    pub wrong_heads: Sample<u16, u64, MAX_HEADS>,
    /// Bytes of garbled answers against those of the answers expected, in per cent: 50 is half as long.
    pub length_ratios: LengthRatios,
}

/// Different beginnings that are counted.
const MAX_HEADS: usize = 16;

/// A message has so many bytes more in Modbus/TCP than in RTU: the header, and no checksum.
const MBAP_SURPLUS: u32 = PREFIX_BYTES as u32 - 2;

/// Sums over the ratios of lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LengthRatios {
    /// How many.
    pub count: u64,
    /// Bytes that came.
    pub came: u64,
    /// Bytes that were expected.
    pub expected: u64,
}

impl UnitCounts {
    /// Requests that did not fail.
    pub fn answered(&self) -> u64 {
        self.failures.total - self.failures.failed
    }

    /// Requests to which anything came.
    pub fn heard(&self) -> u64 {
        self.failures.total - self.silent.failed
    }

    /// Answers and requests that are damaged.
    pub fn damaged_frames(&self) -> u64 {
        self.garbled.failed + self.bad_requests.failed
    }

    /// Answers that are damaged in this part.
    pub fn damaged(&self, part: DamagedPart) -> u64 {
        self.damaged_parts[part as usize].failed
    }

    /// Counts what the times of an exchange tell that went well, as did the one before, with this unit; the rest is left to
    /// `CleanCounts`.
    pub(super) fn count_clean_times(&mut self, seen: &Clean, unit_before: u8) {
        if let Some(time) = seen.response_time {
            self.response_times.add(time);
        }
        if let Some(gap) = seen.gap {
            self.by_gap.count(gap, false);
            if unit_before != seen.key.unit {
                self.by_gap_after_others.count(gap, false);
            }
        }
        if let [Some(request), Some(answer)] = seen.starts {
            self.garbled_by_response_time.count(seen.response_time.unwrap_or(answer - request), false);
        }
        if let Some(time) = seen.place.time {
            self.by_hour[hour(time)].count(false);
        }
    }

    /// Whether lockstep needs only the number of good exchanges.
    #[inline]
    pub(super) fn takes_clean(&self) -> bool {
        self.epochs.takes_clean()
    }

    /// Counts all that is pending, before it is shown.
    pub(super) fn settle(&mut self, pending: &mut CleanCounts) {
        self.settle_order(pending);
        for (unit, count) in pending.by_previous.take() {
            self.by_previous.entry((unit, false)).or_default().total += count;
        }
        for (function, count) in pending.by_function.take() {
            self.by_function.entry(function).or_default().total += count;
        }
        self.damage_after_failure[0].total += std::mem::take(&mut pending.after_success);
    }

    /// Counts what is pending where order matters, before anything else than exchanges that went well is counted.
    pub(super) fn settle_order(&mut self, pending: &mut CleanCounts) {
        pending.is_open = false;
        let (good, behind_writes) = (std::mem::take(&mut pending.good), std::mem::take(&mut pending.behind_writes));
        if good == 0 {
            return;
        }
        for tally in [
            &mut self.other_functions,
            &mut self.other_ids,
            &mut self.echoes,
            &mut self.crossings,
            &mut self.order_mismatches,
            &mut self.not_seen,
            &mut self.failures,
            &mut self.silent,
            &mut self.garbled,
            &mut self.bad_requests,
        ] {
            tally.count_good(good);
        }
        self.exceptions.iter_mut().for_each(|tally| tally.count_good(good));
        pending.after_success += good;
        self.not_seen_runs.count_good(good);
        self.runs.count_good(good);
        self.epochs.count_clean(good);
        self.by_write[1].total += behind_writes;
        self.by_write[0].total += good - behind_writes;
        self.by_pause[0].total += good;
    }

    /// Counts a transaction. Call `settle_order` first: runs depend on the order.
    pub(super) fn count(&mut self, seen: &Observation, before: Before) {
        self.count_oddities(seen);
        if let Some(after) = seen.belated {
            self.late.count(true, seen.place);
            self.late_after.add(after);
        }
        if seen.outcome == Outcome::Unasked {
            self.count_unasked(seen, before);
            return;
        }
        self.count_not_seen(seen);
        if seen.outcome == Outcome::NotSeen {
            self.epochs.count(seen.outcome, None, seen.place);
        }
        if !seen.outcome.counts() {
            self.reads_from_unit_0.count(seen.is_read_of_all(), seen.place);
            return;
        }
        if seen.is_read_of_all() {
            self.reads_from_unit_0.count(true, seen.place);
        }
        self.epochs.count(seen.outcome, seen.shift, seen.place);
        let (place, failed) = (seen.place, seen.outcome.is_failure());
        self.failures.count(failed, place);
        self.silent.count(seen.outcome == Outcome::Silent, place);
        self.garbled.count(seen.outcome == Outcome::Garbled, place);
        self.bad_requests.count(seen.outcome == Outcome::BadRequest, place);
        self.runs.count(failed);
        self.repeated_failures += u64::from(failed && seen.is_retry);
        self.count_length(seen);
        self.count_exception(seen);
        self.count_times(seen);
        self.count_damage(seen);
        self.count_circumstances(seen, before, failed);
    }

    fn count_not_seen(&mut self, seen: &Observation) {
        let not_seen = matches!(seen.outcome, Outcome::NotSeen | Outcome::Silent);
        if not_seen || seen.outcome.counts() {
            self.not_seen.count(not_seen, seen.place);
            self.not_seen_runs.count(not_seen);
        }
    }

    fn count_oddities(&mut self, seen: &Observation) {
        let place = seen.place;
        let has = |finding| seen.findings.has(finding);
        self.other_functions.count(has(Finding::WrongFunction), place);
        self.other_ids.count(has(Finding::TransactionId), place);
        self.echoes.count(seen.is_own_echo, place);
        self.crossings.count(has(Finding::TwoMasters), place);
        self.order_mismatches.count(has(Finding::OrderMismatch), place);
        if let Some(unit) = seen.answered_by {
            self.answered_by.entry(unit).or_default().count(true, place);
        }
    }

    fn count_unasked(&mut self, seen: &Observation, before: Before) {
        let Some(request) = seen.late_response_to else {
            if seen.belated.is_some() {
                return;
            }
            match before.previous.filter(|(unit, _)| *unit != seen.unit) {
                Some((asked, _)) => {
                    self.answers_for.entry(asked).or_default().count(true, seen.place);
                    let request = before.asked.filter(|key| key.unit == asked && seen.exception.is_none());
                    let fits = request.is_none_or(|key| Some(seen.lengths[1]) == answer_length(key.function, key.quantity));
                    *self.misfits.entry(asked).or_default() += u64::from(!fits);
                }
                // Who sends a function that is not known, nothing says.
                None if Functions::embedded().name(seen.function).is_none() => {}
                None => self.second_answers.count(true, seen.place),
            }
            return;
        };
        self.late.count(true, Place { number: request, ..seen.place });
        if let Some(after) = seen.late {
            self.late_after.add(after);
        }
    }

    fn count_length(&mut self, seen: &Observation) {
        let due = |key: Option<RequestKey>| key.and_then(|key| answer_length(key.function, key.quantity));
        let Some(own) = due(seen.key()) else { return };
        for (sides, earlier) in self.as_long_as_before.iter_mut().zip(seen.asked_before) {
            if let Some(other) = due(earlier) {
                let length = seen.lengths[1] - if seen.id.is_some() { MBAP_SURPLUS.min(seen.lengths[1]) } else { 0 };
                sides[usize::from(length > own)].count(length == other, seen.place);
            }
        }
    }

    fn count_exception(&mut self, seen: &Observation) {
        let own = seen.exception.map(|code| if usize::from(code) < EXCEPTIONS { usize::from(code) } else { 0 });
        for (code, tally) in self.exceptions.iter_mut().enumerate() {
            tally.count(own == Some(code), seen.place);
        }
    }

    fn count_times(&mut self, seen: &Observation) {
        if let (Outcome::Good | Outcome::Refused, Some(time)) = (seen.outcome, seen.response_time) {
            self.response_times.add(time);
        }
        if let (Outcome::Silent, Some(waited)) = (seen.outcome, seen.waited) {
            self.waited.add(waited);
        }
    }

    fn count_damage(&mut self, seen: &Observation) {
        let Some(part) = seen.damage else { return };
        if let (DamagedPart::Whole, [one, two, ..]) = (part, seen.answer_head.as_slice()) {
            let head = u16::from_be_bytes([*one, *two]);
            if let Some(count) = self.wrong_heads.entry(mix(head.into()), head) {
                *count += 1;
            }
        }
        let parts = if seen.outcome == Outcome::BadRequest { &mut self.request_parts } else { &mut self.damaged_parts };
        for (index, tally) in parts.iter_mut().enumerate() {
            tally.count(index == part as usize, seen.place);
        }
        if let (Outcome::Garbled, 1.., Some((_, quantity))) = (seen.outcome, seen.lengths[1], seen.range) {
            let expected = u64::from(answer_length(seen.function, quantity).unwrap_or(seen.lengths[1]));
            self.odd_lengths.count(u64::from(seen.lengths[1]) != expected, seen.place);
            if part == DamagedPart::Whole {
                self.length_ratios.count += 1;
                self.length_ratios.came += u64::from(seen.lengths[1]);
                self.length_ratios.expected += expected;
            }
        }
    }

    fn count_circumstances(&mut self, seen: &Observation, before: Before, failed: bool) {
        if let Some(gap) = seen.gap {
            self.by_gap.count(gap, failed);
        }
        // What comes right after a silence may be the answer that was missing there.
        let is_own = seen.outcome == Outcome::Good || !before.previous.is_some_and(|(_, was_silent)| was_silent);
        if let ([Some(request), Some(answer)], Outcome::Good | Outcome::Garbled, true) = (seen.starts, seen.outcome, is_own) {
            self.garbled_by_response_time.count(seen.response_time.unwrap_or(answer - request), seen.outcome == Outcome::Garbled);
        }
        if let Some((unit, was_silent)) = before.previous {
            let is_damaged = matches!(seen.outcome, Outcome::Garbled | Outcome::BadRequest);
            self.damage_after_failure[usize::from(before.failed || (is_damaged && before.may_meet_late))].count(is_damaged);
            if let (Some(gap), true) = (seen.gap, unit != seen.unit) {
                self.by_gap_after_others.count(gap, failed);
            }
            self.by_previous.entry((unit, was_silent)).or_default().count(failed);
        }
        self.by_function.entry(seen.function).or_default().count(failed);
        self.by_write[usize::from(before.written)].count(failed);
        if let Some(time) = seen.place.time {
            self.by_hour[hour(time)].count(failed);
        }
        self.by_pause[usize::from(seen.findings.has(Finding::GapInFrame))].count(failed);
    }

    /// Adds what came later.
    pub(super) fn merge(&mut self, later: &Self) {
        let pairs = [
            (&mut self.failures, &later.failures),
            (&mut self.silent, &later.silent),
            (&mut self.garbled, &later.garbled),
            (&mut self.bad_requests, &later.bad_requests),
            (&mut self.late, &later.late),
            (&mut self.intruding, &later.intruding),
            (&mut self.second_answers, &later.second_answers),
            (&mut self.doubled, &later.doubled),
            (&mut self.other_functions, &later.other_functions),
            (&mut self.other_ids, &later.other_ids),
            (&mut self.echoes, &later.echoes),
            (&mut self.crossings, &later.crossings),
            (&mut self.order_mismatches, &later.order_mismatches),
            (&mut self.not_seen, &later.not_seen),
            (&mut self.odd_lengths, &later.odd_lengths),
            (&mut self.bare, &later.bare),
            (&mut self.reads_from_unit_0, &later.reads_from_unit_0),
        ];
        for (own, more) in pairs {
            own.merge(more);
        }
        merge_each(&mut self.exceptions, &later.exceptions);
        merge_each(&mut self.damaged_parts, &later.damaged_parts);
        merge_each(&mut self.request_parts, &later.request_parts);
        merge_each(&mut self.strays, &later.strays);
        merge_each(&mut self.line_errors, &later.line_errors);
        self.late_after.merge(&later.late_after);
        self.intruding_after.merge(&later.intruding_after);
        self.response_times.merge(&later.response_times);
        self.waited.merge(&later.waited);
        self.by_gap.merge(&later.by_gap);
        self.garbled_by_response_time.merge(&later.garbled_by_response_time);
        merge_shares(&mut self.by_previous, &later.by_previous);
        merge_shares(&mut self.by_function, &later.by_function);
        for (own, more) in [
            (&mut self.by_write[..], &later.by_write[..]),
            (&mut self.by_hour[..], &later.by_hour[..]),
            (&mut self.by_pause[..], &later.by_pause[..]),
            (&mut self.damage_after_failure[..], &later.damage_after_failure[..]),
        ] {
            own.iter_mut().zip(more).for_each(|(own, more)| *own = own.with(*more));
        }
        self.runs.merge(&later.runs);
        self.repeated_failures += later.repeated_failures;
        self.not_seen_runs.merge(&later.not_seen_runs);
        self.by_gap_after_others.merge(&later.by_gap_after_others);
        self.epochs.merge(&later.epochs);
        self.spoiled_after.merge(&later.spoiled_after);
        self.as_long_as_before.iter_mut().zip(&later.as_long_as_before).for_each(|(own, more)| merge_each(own, more));
        self.overtaken.merge(&later.overtaken);
        self.pauses.iter_mut().zip(&later.pauses).for_each(|(own, more)| own.merge(more));
        for (own, more) in [(&mut self.answered_by, &later.answered_by), (&mut self.answers_for, &later.answers_for)] {
            for (unit, more) in more {
                own.entry(*unit).or_default().merge(more);
            }
        }
        for (unit, more) in &later.misfits {
            *self.misfits.entry(*unit).or_default() += more;
        }
        self.wrong_heads.merge(later.wrong_heads.clone(), |own, more| *own += more);
        self.length_ratios.count += later.length_ratios.count;
        self.length_ratios.came += later.length_ratios.came;
        self.length_ratios.expected += later.length_ratios.expected;
    }
}

const HOUR_NS: Ns = 3600 * 1_000_000_000;

/// The hour of the day.
fn hour(time: Ns) -> usize {
    time.div_euclid(HOUR_NS).rem_euclid(24) as usize
}

fn merge_each(own: &mut [Tally], later: &[Tally]) {
    own.iter_mut().zip(later).for_each(|(own, more)| own.merge(more));
}

fn merge_shares<K: Ord + Copy>(own: &mut BTreeMap<K, Share>, later: &BTreeMap<K, Share>) {
    for (key, share) in later {
        let sum = own.entry(*key).or_default();
        *sum = sum.with(*share);
    }
}
