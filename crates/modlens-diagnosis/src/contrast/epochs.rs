//! Whether a unit's answers are one step late, or a few, from a silence on. A silence ends an epoch; what the first answers after it
//! show (`Observation::shift`) reports about the whole epoch.

use super::tally::{Examples, Place, Tally};
use crate::observation::{Outcome, Shift, MOST_LAG};

/// Fewer answers than these that continue another series are an accident of two alike.
const LEAST_SHIFTED: u64 = 3;

/// Their chance is less than one in 2 to the power of this.
const LEAST_BITS: u64 = 40;

/// The transactions of a unit from one silence to the next.
#[derive(Clone, Debug, Default, PartialEq)]
struct Epoch {
    before: u64,
    /// From the first answer on that continues another series.
    from_onset: u64,
    onset: Option<Place>,
    last: Option<Place>,
    /// Answers that continue another series, and the bits of their evidence, by how many steps they are late, from 1 on.
    shifted: [u64; MOST_LAG],
    bits: [u64; MOST_LAG],
    elsewhere: u64,
    examples: Examples,
}

/// The epochs of a unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Epochs {
    /// Answers one step late, among all of the epochs that have ended.
    ended: Tally,
    /// Bits of the evidence of those that were, by how many steps they are late.
    bits: [u64; MOST_LAG],
    first: Epoch,
    current: Option<Epoch>,
}

impl Epochs {
    pub(super) fn count(&mut self, outcome: Outcome, shift: Option<Shift>, place: Place) {
        if matches!(outcome, Outcome::Silent | Outcome::NotSeen) {
            let open = self.current.replace(Epoch::default());
            if let Some(open) = open {
                self.end(&open);
            }
            return;
        }
        self.current.as_mut().unwrap_or(&mut self.first).count(shift, place);
    }

    /// Whether of an answer that shows no shift only the number is counted.
    #[inline]
    pub(super) fn takes_clean(&self) -> bool {
        self.current.as_ref().unwrap_or(&self.first).onset.is_none()
    }

    /// Counts answers that show no shift, while `takes_clean`.
    pub(super) fn count_clean(&mut self, answers: u64) {
        self.current.as_mut().unwrap_or(&mut self.first).before += answers;
    }

    fn end(&mut self, epoch: &Epoch) {
        epoch.add_bits(&mut self.bits);
        self.ended.merge(&epoch.tally());
    }

    /// Adds what came later.
    pub(super) fn merge(&mut self, later: &Self) {
        self.current.as_mut().unwrap_or(&mut self.first).merge(&later.first);
        let Some(current) = &later.current else { return };
        if let Some(open) = self.current.replace(current.clone()) {
            self.end(&open);
        }
        self.bits.iter_mut().zip(later.bits).for_each(|(own, more)| *own += more);
        self.ended.merge(&later.ended);
    }

    /// Answers that come late by steps, among all answers, the bits of evidence for them, and by how many steps most of them are.
    pub fn behind(&self) -> (Tally, u64, usize) {
        let mut all = self.first.tally();
        all.merge(&self.ended);
        let open = self.current.clone().unwrap_or_default();
        all.merge(&open.tally());
        let mut bits = self.bits;
        for epoch in [&self.first, &open] {
            epoch.add_bits(&mut bits);
        }
        let (lag, _) = (1..).zip(bits).max_by_key(|(lag, bits)| (*bits, std::cmp::Reverse(*lag))).unwrap_or((1, 0));
        (all, bits.iter().sum(), lag)
    }
}

impl Epoch {
    fn count(&mut self, shift: Option<Shift>, place: Place) {
        match shift {
            Some(Shift::ToEarlier { lag, bits }) => {
                self.onset.get_or_insert(place);
                self.shifted[lag - 1] += 1;
                self.bits[lag - 1] += u64::from(bits);
                self.examples.add(place.number);
            }
            Some(Shift::Elsewhere) => self.elsewhere += 1,
            None => {}
        }
        if self.onset.is_some() {
            self.from_onset += 1;
            self.last = Some(place);
        } else {
            self.before += 1;
        }
    }

    fn merge(&mut self, later: &Self) {
        if self.onset.is_some() {
            self.from_onset += later.before + later.from_onset;
        } else {
            self.before += later.before;
            self.from_onset = later.from_onset;
        }
        self.onset = self.onset.or(later.onset);
        self.last = later.last.or(self.last);
        self.shifted.iter_mut().zip(later.shifted).for_each(|(own, more)| *own += more);
        self.bits.iter_mut().zip(later.bits).for_each(|(own, more)| *own += more);
        self.elsewhere += later.elsewhere;
        self.examples.merge(&later.examples);
    }

    /// Which of the steps most of the answers are late by, from 0 on, if that is so of nearly all.
    fn lag(&self) -> Option<usize> {
        let (at, most) = self.shifted.iter().copied().enumerate().max_by_key(|(at, count)| (*count, std::cmp::Reverse(*at)))?;
        let others = self.shifted.iter().sum::<u64>() - most + self.elsewhere;
        (most >= LEAST_SHIFTED && self.bits[at] >= LEAST_BITS && others * 3 < most).then_some(at)
    }

    /// Adds the bits of its evidence, if it is late.
    fn add_bits(&self, bits: &mut [u64; MOST_LAG]) {
        if let Some(at) = self.lag() {
            bits[at] += self.bits[at];
        }
    }

    fn tally(&self) -> Tally {
        let total = self.before + self.from_onset;
        if self.lag().is_none() {
            return Tally { total, before: total, ..Tally::default() };
        }
        Tally {
            failed: self.from_onset,
            total,
            first: self.onset,
            last: self.last,
            before: self.before,
            after: 0,
            examples: self.examples.clone(),
            ..Tally::default()
        }
    }
}
