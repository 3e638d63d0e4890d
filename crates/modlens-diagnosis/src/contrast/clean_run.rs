//! Exchanges that went well, one behind the other: what is noted of each.

use modlens_engine::records::{ExchangeRun, Transaction};

use super::bus::{BusContrast, WINDOW};
use super::context::PreviousAnswer;
use super::recent::Remembered;
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
        let mut at = from;
        while at < run.exchanges.length as usize {
            let index = run.exchanges.start as usize + at;
            let Some(seen) = exchanges.clean(index, run.number + at as u64) else { break };
            if !self.take_clean(exchanges, &seen, Remembered::Exchange(index as u32), before) {
                break;
            }
            before = seen.key;
            at += 1;
        }
        self.pass_clean((at - from) as u64, before);
        at - from
    }

    /// Takes the transaction of a row.
    pub(super) fn row(&mut self, exchanges: &Exchanges<'_>, row: &Transaction) {
        let (batch, functions) = (exchanges.batch, exchanges.functions);
        if let (Some(before), Some(seen)) = (self.before_clean(), Clean::of(batch, functions, row)) {
            let remembered = Remembered::Answer((seen.data.length > 0).then_some((seen.key, seen.data)));
            if self.take_clean(exchanges, &seen, remembered, before) {
                self.pass_clean(1, seen.key);
                return;
            }
        }
        let seen = Observation::of(batch, functions, row);
        if seen.data.length > 0 {
            // It is compared with what was read before.
            self.context.recent.look_up(exchanges);
        }
        self.transaction(seen);
    }

    /// The request before the next one, if the next one may be counted in bulk.
    #[inline]
    fn before_clean(&self) -> Option<RequestKey> {
        self.context.request_before().filter(|_| self.transactions_seen >= WINDOW as u64)
    }

    /// Leaves behind exchanges that went well, the last of which asked this.
    #[inline]
    fn pass_clean(&mut self, count: u64, last: RequestKey) {
        if count > 0 {
            (self.transactions_seen, self.is_pending) = (self.transactions_seen + count, true);
            self.requests_seen.count_good(count);
            self.context.follow_clean(last);
        }
    }

    /// Notes an exchange that went well, behind another one; false, and nothing is done, where more is to be noted of it.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Its argument is large, and would be written and read again for each exchange.
    fn take_clean(
        &mut self,
        exchanges: &Exchanges<'_>,
        seen: &Clean<'_>,
        remembered: Remembered,
        before: RequestKey,
    ) -> bool {
        let index = match self.known.find(seen.key) {
            Some(index) => index,
            None => self.meet(exchanges, seen.key),
        };
        let (number, is_read) = (self.context.recent.next_number(), seen.data.length > 0);
        let known = self.known.at(index);
        if is_read && number <= known.recent_until {
            let own = known.head;
            if self.context.may_be_odd(seen.data, own) && self.is_odd(exchanges, seen, own, before) {
                return false;
            }
        }
        if !self.takes_clean(seen.key.unit) {
            return false;
        }
        let unit = self.clean_units.of(seen.key.unit);
        unit.good += 1;
        unit.behind_writes += u64::from(self.context.is_behind_write());
        let known = self.known.at(index);
        if is_read {
            known.note(number, seen.data.head);
        }
        let is_plain = seen.data.is_plain();
        let pending = &mut known.pending;
        pending.good += 1;
        pending.writes = seen.writes;
        pending.usual += u32::from(seen.data.is_present && !is_plain);
        pending.near[0] += u32::from(seen.data.touches[0] && !is_plain);
        pending.near[1] += u32::from(seen.data.touches[1] && !is_plain);
        if !pending.is_behind(before) {
            self.count_other_pair(index, seen.key, before);
        }
        self.context.recent.remember(remembered);
        if is_plain || seen.writes {
            self.note_contents(index, seen);
        }
        if seen.starts[0].is_some() || seen.starts[1].is_some() || seen.gap.is_some() || seen.response_time.is_some() {
            self.note_times(index, seen, before.unit);
        } else {
            self.context.previous_answer = None;
        }
        true
    }

    /// Makes a request known, and gives its index.
    #[inline(never)]
    fn meet(&mut self, exchanges: &Exchanges<'_>, key: RequestKey) -> usize {
        if self.known.is_full() {
            (0..self.known.len()).for_each(|index| self.settle_request(index));
            self.known.clear(self.context.recent.count());
        }
        let index = self.known.add(key, self.requests.slot(key.hash(), key));
        let number = self.context.recent.next_number();
        if self.known.has_forgotten(number) {
            self.context.recent.look_up(exchanges);
            if let Some((last, data)) = self.context.recent.last_of(key) {
                self.known.at(index).note(last, data.head);
            }
        }
        index
    }

    /// Whether the data of an exchange may be those of another request, or go on with its values.
    #[inline(never)]
    fn is_odd(&mut self, exchanges: &Exchanges<'_>, seen: &Clean<'_>, own: [u16; 2], before: RequestKey) -> bool {
        self.context.recent.look_up(exchanges);
        self.context.is_odd(seen.key, seen.data, own, before)
    }

    /// Whether nothing but their number is to be noted of exchanges with a unit that went well.
    #[inline]
    fn takes_clean(&mut self, unit: u8) -> bool {
        let pending = self.clean_units.of(unit);
        if !pending.is_open {
            pending.is_open = self.units.entry(unit).or_default().takes_clean();
        }
        pending.is_open
    }

    /// Notes that an exchange came right behind another request than it mostly does.
    #[inline(never)]
    fn count_other_pair(&mut self, index: usize, key: RequestKey, before: RequestKey) {
        let known = self.known.at(index);
        let slot = known.slot;
        if let Some((before, pairs)) = known.pending.come_behind(before) {
            self.count_pairs(key, slot, before, pairs);
        }
    }

    /// Notes what an exchange has written, and values that are all FFFF or all 0000.
    #[inline(never)]
    fn note_contents(&mut self, index: usize, seen: &Clean<'_>) {
        if seen.writes {
            self.context.note_write();
        }
        if seen.data.is_plain() {
            self.settle_request(index);
        }
        let slot = self.known.at(index).slot;
        let Some(counts) = slot.and_then(|slot| self.requests.at(slot.into(), &seen.key)) else { return };
        if seen.data.is_plain() {
            counts.count_data(seen.data, false, seen.place);
        }
        if seen.writes {
            counts.count_written(fingerprint(seen.request), seen.place);
        }
    }

    /// Notes what the times of an exchange tell.
    #[inline(never)]
    fn note_times(&mut self, index: usize, seen: &Clean<'_>, unit_before: u8) {
        self.units.entry(seen.key.unit).or_default().count_clean_times(seen, unit_before);
        let slot = self.known.at(index).slot;
        if let Some(counts) = slot.and_then(|slot| self.requests.at(slot.into(), &seen.key)) {
            counts.count_period(seen.starts[0]);
        }
        if let Some((unit, place, waited, needed)) = self.context.overtaken(seen.starts[0]) {
            self.units.entry(unit).or_default().overtaken.count(place, waited, needed);
        }
        self.context.previous_answer = match seen.starts {
            [Some(requested), Some(came)] => Some(PreviousAnswer { unit: seen.key.unit, place: seen.place, requested, came }),
            _ => None,
        };
    }
}
