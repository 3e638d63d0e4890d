//! The counters of one distinct request: the same unit, function, address and quantity.

use modlens_protocol::Ns;

use super::before::Before;
use super::cycles::Cycles;
use super::followed::FollowedAnswers;
use super::known_requests::PendingExchanges;
use super::registers::Registers;
use super::runs::Runs;
use super::sample::Sample;
use super::tally::{Place, Tally};
use crate::observation::{Data, Observation, Outcome, RequestKey};
use crate::statistics::Share;
use modlens_engine::durations::Durations;

/// Requests that are counted one by one.
pub(super) const MAX_REQUESTS: usize = 1024;

/// Different requests before it that are counted.
const MAX_BEFORE: usize = 16;

/// Two different requests, one right after the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pair {
    /// How often.
    pub total: u64,
    /// How often the first one failed.
    pub first_failed: u64,
    /// How often the second one failed.
    pub second_failed: u64,
    /// How often both did not fail.
    pub clean: u64,
}

impl Pair {
    fn count(&mut self, first_failed: bool, second_failed: bool) {
        self.total += 1;
        self.first_failed += u64::from(first_failed);
        self.second_failed += u64::from(second_failed);
        self.clean += u64::from(!first_failed && !second_failed);
    }

    fn merge(&mut self, later: &Self) {
        self.total += later.total;
        self.first_failed += later.first_failed;
        self.second_failed += later.second_failed;
        self.clean += later.clean;
    }
}

/// What came of one distinct request.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RequestCounts {
    /// Good answers.
    pub good: u64,
    /// Refusals by exception 1, 2 and 3, and others.
    refused: [u64; 4],
    /// Without an answer.
    pub silent: u64,
    /// Exchanges whose answer, or whose request, was damaged.
    pub damaged: u64,
    /// All failures and refusals.
    pub bad: Tally,
    /// Runs of refusals.
    pub refusal_runs: Runs,
    /// Where it would begin if it cut no value of the profile in two; of refusals.
    pub aligned_at: Option<u16>,
    /// It writes.
    pub writes: bool,
    /// Times from the start of one such request to the start of the next.
    pub period: Durations,
    /// The same of those that went well.
    pub cycles: Cycles,
    /// Answers of all FFFF, alone between others.
    pub all_ones: Lonely,
    /// Answers of all 0000, alone between others.
    pub all_zeros: Lonely,
    /// Answers with the data of another request, alone between others.
    pub of_another: Lonely,
    /// What followed some of its answers.
    pub followed: FollowedAnswers,
    /// What its registers hold, where answers have times.
    pub registers: Registers,
    /// Answers that begin or end with FFFF and are not all FFFF.
    pub near_ones: u64,
    /// The same with 0000.
    pub near_zeros: u64,
    /// By the request before.
    pub after: Sample<u64, Pair, MAX_BEFORE>,
    /// How often it came again without another request between, although it had been answered well.
    pub repeated: u64,
    /// The longest time without it: the start of the last request before, and that of the first one after.
    pub longest_pause: Option<(Ns, Ns)>,
    /// How often the clock stood lower than at the one before.
    pub steps_back: u64,
    first_start: Option<Ns>,
    last_start: Option<Ns>,
    /// Writes, retries left out. From here on are the fields that each write changes, kept together for the cache.
    pub written: Tally,
    /// How often what is written differs from the write before.
    pub changes: u64,
    first_written: u64,
    last_written: u64,
}

/// Odd ones in a series, and in how many runs they stand.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lonely {
    /// Odd ones.
    pub odd: Tally,
    /// How often the series turns from odd to usual or back.
    pub turns: u64,
    first: Option<bool>,
    last: Option<bool>,
}

impl Lonely {
    /// Counts some that are not odd.
    fn count_usual(&mut self, usual: u64) {
        if usual > 0 {
            self.odd.count_good(usual);
            self.turns += u64::from(self.last == Some(true));
            self.first.get_or_insert(false);
            self.last = Some(false);
        }
    }

    fn count(&mut self, is_odd: bool, place: Place) {
        self.odd.count(is_odd, place);
        self.turns += u64::from(self.last.is_some_and(|last| last != is_odd));
        self.first.get_or_insert(is_odd);
        self.last = Some(is_odd);
    }

    fn merge(&mut self, later: &Self) {
        self.odd.merge(&later.odd);
        self.turns += later.turns + u64::from(self.last.zip(later.first).is_some_and(|(last, first)| last != first));
        self.first = self.first.or(later.first);
        self.last = later.last.or(self.last);
    }

    /// In how many runs the odd ones stand.
    pub fn runs(&self) -> u64 {
        // Each run but those at the two ends begins and ends with a turn.
        let ends = u64::from(self.first == Some(true)) + u64::from(self.last == Some(true));
        (self.turns + ends).div_ceil(2)
    }
}

impl RequestCounts {
    /// Counts a transaction. What is pending of its request has to be counted.
    pub(super) fn count(&mut self, seen: &Observation, before: Before) {
        self.writes = seen.writes;
        self.aligned_at = self.aligned_at.or(seen.aligned_at);
        self.repeated += u64::from(before.is_repeated && !seen.is_retry);
        if let Some((request, failed)) = before.request {
            if let Some(pair) = self.after.entry(request, request) {
                pair.count(failed, seen.outcome.is_failure());
            }
        }
        match seen.outcome {
            Outcome::Good => self.good += 1,
            Outcome::Refused => self.refused[seen.exception.map_or(3, |code| usize::from(code.wrapping_sub(1)).min(3))] += 1,
            Outcome::Silent => self.silent += 1,
            Outcome::Garbled | Outcome::BadRequest => self.damaged += 1,
            Outcome::Unasked | Outcome::NotSeen | Outcome::Unknown => {}
        }
        if matches!(seen.outcome, Outcome::Good | Outcome::Refused) {
            self.refusal_runs.count(seen.outcome == Outcome::Refused);
        }
        self.bad.count(seen.outcome.is_failure() || seen.outcome == Outcome::Refused, seen.place);
        if seen.outcome == Outcome::Good && seen.data.is_present {
            self.count_data(seen.data, seen.is_of_another, seen.place);
            if !seen.registers.is_empty() {
                self.registers.count(&seen.registers, seen.place);
            }
        }
        if let Some(start) = seen.starts[0] {
            self.cycles.count(start, seen.outcome == Outcome::Good && !seen.is_retry);
        }
        if !seen.is_retry {
            self.count_period(seen.starts[0]);
            self.count_written(seen.written, seen.place);
        }
    }

    /// Counts exchanges that went well, whose data are not of another request.
    pub(super) fn count_clean(&mut self, pending: &PendingExchanges) {
        let (good, usual, near) = (u64::from(pending.good), u64::from(pending.usual), pending.near.map(u64::from));
        self.writes = pending.writes;
        self.good += good;
        self.bad.count_good(good);
        if good > 0 {
            self.refusal_runs.count_good(good);
        }
        for series in [&mut self.all_ones, &mut self.all_zeros, &mut self.of_another] {
            series.count_usual(usual);
        }
        self.near_ones += near[0];
        self.near_zeros += near[1];
    }

    /// Counts how often this request and another one right before it went well.
    pub(super) fn count_pairs(&mut self, before: RequestKey, pairs: u32) {
        let hash = before.hash();
        if let Some(pair) = self.after.entry(hash, hash) {
            pair.total += u64::from(pairs);
            pair.clean += u64::from(pairs);
        }
    }

    /// Counts the data of an answer.
    pub(super) fn count_data(&mut self, data: Data, is_of_another: bool, place: Place) {
        let [touches_ones, touches_zeros] = data.touches;
        self.near_ones += u64::from(touches_ones && !data.all_ones);
        self.near_zeros += u64::from(touches_zeros && !data.all_zeros);
        self.all_ones.count(data.all_ones, place);
        self.all_zeros.count(data.all_zeros, place);
        self.of_another.count(is_of_another, place);
    }

    /// Counts when a request was sent that went well.
    pub(super) fn count_clean_start(&mut self, start: Option<Ns>) {
        self.count_period(start);
        if let Some(start) = start {
            self.cycles.count(start, true);
        }
    }

    fn count_period(&mut self, start: Option<Ns>) {
        let Some(start) = start else { return };
        self.count_pause(self.last_start, start);
        self.first_start.get_or_insert(start);
        self.last_start = Some(start);
    }

    /// Counts the time from one to the next.
    #[inline]
    fn count_pause(&mut self, last: Option<Ns>, start: Ns) {
        match last {
            Some(last) if last < start => {
                // The longest one so far makes the greatest period: most are not compared twice.
                if start - last > self.period.most {
                    self.longest_pause = Some((last, start));
                }
                self.period.add(start - last);
            }
            Some(last) => self.steps_back += u64::from(last > start),
            None => {}
        }
    }

    pub(super) fn count_written(&mut self, written: u64, place: Place) {
        if written != 0 {
            self.written.count(true, place);
            self.changes += u64::from(self.last_written != 0 && self.last_written != written);
            if self.first_written == 0 {
                self.first_written = written;
            }
            self.last_written = written;
        }
    }

    /// Adds the counts of a later part of the recording; pending exchanges of both have to be counted before.
    pub(super) fn merge(&mut self, later: &Self) {
        self.writes |= later.writes;
        self.aligned_at = self.aligned_at.or(later.aligned_at);
        self.good += later.good;
        self.refused.iter_mut().zip(later.refused).for_each(|(own, more)| *own += more);
        self.silent += later.silent;
        self.damaged += later.damaged;
        self.bad.merge(&later.bad);
        self.refusal_runs.merge(&later.refusal_runs);
        self.all_ones.merge(&later.all_ones);
        self.all_zeros.merge(&later.all_zeros);
        self.of_another.merge(&later.of_another);
        self.near_ones += later.near_ones;
        self.near_zeros += later.near_zeros;
        self.repeated += later.repeated;
        self.after.merge(later.after.clone(), Pair::merge);
        self.written.merge(&later.written);
        let is_change = self.last_written != 0 && later.first_written != 0 && self.last_written != later.first_written;
        self.changes += later.changes + u64::from(is_change);
        self.steps_back += later.steps_back;
        if let Some(first) = later.first_start {
            self.count_pause(self.last_start, first);
        }
        if later.period.most > self.period.most {
            self.longest_pause = later.longest_pause;
        }
        self.period.merge(&later.period);
        self.cycles.merge(&later.cycles);
        self.registers.merge(&later.registers);
        self.followed.merge(&later.followed);
        self.first_start = self.first_start.or(later.first_start);
        self.last_start = later.last_start.or(self.last_start);
        if self.first_written == 0 {
            self.first_written = later.first_written;
        }
        if later.last_written != 0 {
            self.last_written = later.last_written;
        }
    }

    /// How often it failed in any way but by a refusal.
    pub fn failures(&self) -> Share {
        Share { failed: self.silent + self.damaged, total: self.sent() }
    }

    /// How often it was sent, with a known end.
    pub fn sent(&self) -> u64 {
        self.bad.total
    }

    /// How often it was refused with this exception: 1, 2 or 3.
    pub fn refused_with(&self, exception: u8) -> u64 {
        self.refused[usize::from(exception) - 1]
    }

    /// How often it was refused.
    pub fn refusals(&self) -> u64 {
        self.refused.iter().sum()
    }
}
