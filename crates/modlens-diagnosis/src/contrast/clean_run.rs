//! Exchanges that went well, one after the other: what is noted of each.

use modlens_engine::records::{ExchangeRun, Transaction};

use super::bus::{BusContrast, WINDOW};
use super::context::PreviousAnswer;
use super::recent::Answer;
use super::tally::fingerprint;
use crate::clean::{Clean, Exchanges};
use crate::observation::{Observation, RequestKey};

impl BusContrast {
    /// Takes the transactions of a run of compact exchanges.
    pub(super) fn compact_transactions(&mut self, exchanges: &Exchanges<'_>, run: &ExchangeRun) {
        let count = run.exchanges.length as usize;
        let mut at = 0;
        while at < count {
            if run.packets.is_none() {
                at += self.clean_exchanges(exchanges, run, at);
            }
            if at < count {
                self.row(exchanges, &exchanges.batch.compact_row(run, at));
                at += 1;
            }
        }
    }

    /// Takes exchanges of a run without times, from this place on, while nothing more is to be noted than that they went well;
    /// gives how many.
    fn clean_exchanges(&mut self, exchanges: &Exchanges<'_>, run: &ExchangeRun, from: usize) -> usize {
        let Some(mut before) = self.before_clean() else { return 0 };
        let mut count = 0;
        for exchange in &run.exchanges.of(&exchanges.batch.exchanges)[from..] {
            let Some(seen) = exchanges.clean(exchange, run.number + (from + count) as u64) else { break };
            let request = seen.key.number();
            if !self.take_clean(exchanges, seen, request, before) {
                break;
            }
            before = request;
            count += 1;
        }
        self.pass_clean(count, before);
        if count > 0 {
            self.context.pass_frames(run.frame + 2 * (from + count) as u64 - 1, None);
            self.step_runs.count_good(count as u64);
        }
        count
    }

    /// Takes the transaction of a row.
    pub(super) fn row(&mut self, exchanges: &Exchanges<'_>, row: &Transaction) {
        let (batch, functions) = (exchanges.batch, exchanges.functions);
        if let (Some(before), Some(seen)) = (self.before_clean(), Clean::of(batch, functions, row)) {
            let request = seen.key.number();
            // On a network, the engine looks at the order of packets itself.
            let is_overtaken = self.context.is_overtaken_by(row.request.frame) && !self.facts.is_network;
            if !is_overtaken && self.take_clean(exchanges, seen, request, before) {
                self.context.pass_frames(row.response.frame, row.mbap_id);
                self.step_runs.count_good(1);
                self.pass_clean(1, request);
                return;
            }
        }
        self.transaction(Observation::of(batch, functions, row));
    }

    /// The request before the next one, as a number, if the next one may be counted in bulk.
    #[inline]
    fn before_clean(&self) -> Option<u64> {
        let before = self.context.request_before().filter(|_| self.transactions_seen >= WINDOW as u64)?;
        Some(before.number())
    }

    /// Remains after exchanges that went well, the last of which asked this.
    #[inline]
    fn pass_clean(&mut self, count: usize, last: u64) {
        if count > 0 {
            self.transactions_seen += count as u64;
            self.pending += count as u64;
            self.requests_seen.count_good(count as u64);
            self.context.follow_clean(RequestKey::of_number(last));
        }
    }

    /// Notes an exchange that went well, after another one, whose requests have these numbers; false, and nothing is done, where
    /// more is to be noted of it.
    #[inline(always)]
    // What an exchange shows is large; by value, and inlined, no more of it is made than is asked for.
    #[allow(clippy::inline_always)]
    fn take_clean(&mut self, exchanges: &Exchanges<'_>, seen: Clean, request: u64, before: u64) -> bool {
        if !self.clean_units.is_open(seen.key.unit) && !self.open_unit(seen.key.unit) {
            return false;
        }
        let found = self.known.find(request).or_else(|| self.meet(seen.key, seen.data.length > 0));
        match found {
            Some(index) => {
                let known = self.known.at(index);
                let is_compared = seen.data.length > 0 && self.context.recent.next_number() <= known.recent_until;
                if is_compared && self.context.may_be_odd(seen.key, seen.data, known.head, before) {
                    return false;
                }
                self.note_request(index, seen, request, before);
                if seen.writes || seen.data.is_plain() {
                    self.note_contents(exchanges, index, seen);
                }
            }
            None => self.count_one(seen.key, before),
        }
        let unit = self.clean_units.of(seen.key.unit);
        unit.good += 1;
        unit.behind_writes += u64::from(self.context.is_behind_write());
        self.context.recent.push(Answer::new(request, seen.data));
        if seen.writes {
            self.context.note_write();
        }
        if seen.starts[0].is_some() || seen.starts[1].is_some() || seen.gap.is_some() || seen.response_time.is_some() {
            self.note_times(exchanges, found, seen, RequestKey::of_number(before).unit);
        } else {
            self.context.previous_answer = None;
        }
        true
    }

    /// Makes a request known, and gives its index. One that reads nothing and for whose counters there is no room stays unknown:
    /// there is nothing to be known of it.
    #[inline(never)]
    fn meet(&mut self, key: RequestKey, is_read: bool) -> Option<usize> {
        let slot = self.requests.slot(key.hash(), key);
        if slot.is_none() && !is_read {
            return None;
        }
        if self.known.is_full() {
            self.settle_requests();
            self.forget();
        }
        let index = self.known.add(key, slot);
        if self.known.has_forgotten(self.context.recent.next_number()) {
            if let Some((last, answer)) = self.context.recent.last_of(key) {
                self.known.at(index).note(last, answer.head);
            }
        }
        Some(index)
    }

    /// Whether from here on nothing but their number is to be noted of the exchanges with a unit.
    #[cold]
    fn open_unit(&mut self, unit: u8) -> bool {
        let is_open = self.units.entry(unit).or_default().takes_clean();
        self.clean_units.of(unit).is_open = is_open;
        is_open
    }

    /// Notes an exchange with its request.
    #[inline(always)]
    #[allow(clippy::inline_always)] // As above.
    fn note_request(&mut self, index: usize, seen: Clean, request: u64, before: u64) {
        let transaction = self.context.recent.next_number();
        let known = self.known.at(index);
        if seen.data.length > 0 {
            known.note(transaction, seen.data.head);
        }
        let pending = &mut known.pending;
        pending.good += 1;
        pending.writes = seen.writes;
        if seen.data.is_present && !seen.data.is_plain() {
            pending.usual += 1;
            pending.near[0] += u32::from(seen.data.touches[0]);
            pending.near[1] += u32::from(seen.data.touches[1]);
        }
        if !pending.is_behind(before) {
            self.count_other_pair(index, request, before);
        }
    }

    /// Notes that an exchange came right after another request than it mostly does.
    #[inline(never)]
    fn count_other_pair(&mut self, index: usize, request: u64, before: u64) {
        let known = self.known.at(index);
        let slot = known.slot;
        if let Some((before, pairs)) = known.pending.come_behind(before) {
            self.count_pairs(RequestKey::of_number(request), slot, before, pairs);
        }
    }

    /// Notes an exchange with a request that has no counters, after another one.
    fn count_one(&mut self, key: RequestKey, before: u64) {
        let unit = self.clean_units.of(key.unit);
        unit.by_function.add(key.function, 1);
        unit.by_previous.add(RequestKey::of_number(before).unit, 1);
    }

    /// Notes what an exchange has written, and values that are all FFFF or all 0000.
    #[inline(never)]
    fn note_contents(&mut self, exchanges: &Exchanges<'_>, index: usize, seen: Clean) {
        if seen.data.is_plain() {
            self.settle_request(index);
        }
        let slot = self.known.at(index).slot;
        let Some(counts) = slot.and_then(|slot| self.requests.at(slot.into(), &seen.key)) else { return };
        if seen.data.is_plain() {
            counts.count_data(seen.data, false, seen.place);
        }
        if seen.writes {
            counts.count_written(fingerprint(seen.request.of(&exchanges.batch.arena)), seen.place);
        }
    }

    /// Notes what the times of an exchange tell.
    #[inline(never)]
    fn note_times(&mut self, exchanges: &Exchanges<'_>, found: Option<usize>, seen: Clean, unit_before: u8) {
        self.units.entry(seen.key.unit).or_default().count_clean_times(&seen, unit_before);
        let slot = found.and_then(|index| self.known.at(index).slot);
        if let Some(counts) = slot.and_then(|slot| self.requests.at(slot.into(), &seen.key)) {
            counts.count_clean_start(seen.starts[0]);
            if seen.registers.length > 0 {
                counts.registers.count(seen.registers.of(&exchanges.batch.arena), seen.place);
            }
        }
        if let Some((unit, place, waited, needed)) = self.context.overtaken(seen.bus, seen.starts[0]) {
            self.units.entry(unit).or_default().overtaken.count(place, waited, needed);
        }
        if let Some((asked, number, followed)) = self.context.followed(seen.bus, Some(seen.key), seen.starts[0], seen.gap) {
            self.count_followed(asked, number, followed);
        }
        self.context.previous_answer = match seen.starts {
            [Some(requested), Some(came)] => Some(PreviousAnswer {
                bus: seen.bus,
                unit: seen.key.unit,
                place: seen.place,
                requested,
                came,
                key: Some(seen.key),
                response: seen.response_time,
            }),
            _ => None,
        };
    }
}
