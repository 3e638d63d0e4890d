//! The registers of a block one by one: what they hold mostly, and how often one of them holds a number that stands for no value.

use std::collections::BTreeMap;

use super::jumps::{JumpKind, Series};
use super::tally::{Place, Tally};

/// Numbers that devices send where they have no value: FFFF, 8000 and 7FFF.
const NO_VALUES: [u16; 3] = [0xFFFF, 0x8000, 0x7FFF];

/// Such numbers of a block that are counted one by one: those of its first registers.
const MOST: usize = 16;

/// The answers to one request.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Registers {
    /// How many answers.
    answers: u64,
    /// By register, the least and the greatest of its other numbers.
    ranges: Vec<(u16, u16)>,
    /// By register and number.
    jumps: BTreeMap<(u16, u16), Jumps>,
    /// By register, how its numbers go on.
    series: Vec<Series>,
    /// By register, the reads in which it jumps and comes back at once.
    sudden: BTreeMap<(u16, JumpKind), Tally>,
    /// The first answer and the last one.
    ends: Option<(Place, Place)>,
}

/// A register that jumps for single reads.
#[derive(Clone, Debug)]
pub struct Sudden {
    /// Its place in the block.
    pub register: u16,
    /// What it jumps to.
    pub kind: JumpKind,
    /// Which answers.
    pub odd: Tally,
}

/// Answers in which a register holds one of these numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Jumps {
    /// Which ones.
    odd: Tally,
    /// In how many runs they stand.
    runs: u64,
    /// The first and the last, by their place among all answers.
    first: u64,
    last: u64,
}

/// A register that holds a number, now and then, that is far from all others.
#[derive(Clone, Debug)]
pub struct Jump {
    /// Its place in the block.
    pub register: u16,
    /// The number.
    pub value: u16,
    /// The least and the greatest of the others.
    pub others: (u16, u16),
    /// Which answers.
    pub odd: Tally,
    /// In how many runs they stand.
    pub runs: u64,
}

impl Registers {
    /// Counts the block of an answer.
    pub(super) fn count(&mut self, block: &[u8], place: Place) {
        if self.ranges.len() < block.len() / 2 {
            self.ranges.resize(block.len() / 2, (u16::MAX, 0));
            self.series.resize(block.len() / 2, Series::default());
        }
        let (_, before) = self.ends.unwrap_or((place, place));
        for (at, (pair, series)) in block.chunks_exact(2).zip(&mut self.series).enumerate() {
            if let Some(kind) = series.count(u16::from_be_bytes([pair[0], pair[1]])) {
                self.sudden.entry((at as u16, kind)).or_default().count(true, before);
            }
        }
        self.ends = Some((self.ends.map_or(place, |(first, _)| first), place));
        for (at, (pair, (least, most))) in block.chunks_exact(2).zip(&mut self.ranges).enumerate() {
            let value = u16::from_be_bytes([pair[0], pair[1]]);
            if NO_VALUES.contains(&value) {
                self.jumps.entry((at as u16, value)).or_default().count(self.answers, place);
            } else {
                (*least, *most) = ((*least).min(value), (*most).max(value));
            }
        }
        self.answers += 1;
        self.prune();
    }

    /// Leaves out what is beyond the bound; of parts and of the whole, the same are kept.
    fn prune(&mut self) {
        while self.jumps.len() > MOST {
            self.jumps.pop_last();
        }
        while self.sudden.len() > MOST {
            self.sudden.pop_last();
        }
    }

    /// Adds those of a later part of the recording.
    pub(super) fn merge(&mut self, later: &Self) {
        if self.ranges.len() < later.ranges.len() {
            self.ranges.resize(later.ranges.len(), (u16::MAX, 0));
            self.series.resize(later.ranges.len(), Series::default());
        }
        let places = [self.ends.map(|(_, last)| last), later.ends.map(|(first, _)| first)];
        for (at, (own, more)) in self.series.iter_mut().zip(&later.series).enumerate() {
            for (kind, place) in own.merge(more).into_iter().zip(places) {
                if let Some((kind, place)) = kind.zip(place) {
                    self.sudden.entry((at as u16, kind)).or_default().count(true, place);
                }
            }
        }
        for (key, more) in &later.sudden {
            self.sudden.entry(*key).or_default().merge(more);
        }
        self.ends = self.ends.map(|(first, last)| (first, later.ends.map_or(last, |(_, last)| last))).or(later.ends);
        for ((least, most), (low, high)) in self.ranges.iter_mut().zip(&later.ranges) {
            (*least, *most) = ((*least).min(*low), (*most).max(*high));
        }
        for (key, more) in &later.jumps {
            self.jumps.entry(*key).or_default().merge(more, self.answers);
        }
        self.answers += later.answers;
        self.prune();
    }

    /// Returns the registers that jump for single reads, farther than they go from one read to the next otherwise.
    pub fn sudden(&self) -> impl Iterator<Item = Sudden> + '_ {
        let is_told = |register: u16| self.series.get(usize::from(register)).is_some_and(Series::is_told_from_steps);
        self.sudden.iter().filter(move |((register, _), _)| is_told(*register)).map(|((register, kind), odd)| Sudden {
            register: *register,
            kind: *kind,
            odd: Tally { total: self.answers, ..odd.clone() },
        })
    }

    /// The registers that jump away from all that they hold otherwise, and back.
    pub fn jumps(&self) -> impl Iterator<Item = Jump> + '_ {
        self.jumps.iter().filter_map(|((register, value), jumps)| {
            let others @ (least, most) = *self.ranges.get(usize::from(*register))?;
            let odd = Tally { total: self.answers, ..jumps.odd.clone() };
            (least <= most && is_far(*value, others)).then_some(Jump {
                register: *register,
                value: *value,
                others,
                odd,
                runs: jumps.runs,
            })
        })
    }
}

/// Whether a number is farther from others than they are from each other. They may be signed.
fn is_far(value: u16, (least, most): (u16, u16)) -> bool {
    let apart = |other: u16| value.wrapping_sub(other).min(other.wrapping_sub(value));
    let is_inside = (least..=most).contains(&value);
    !is_inside && apart(least).min(apart(most)) > (most - least).max(LEAST_APART)
}

/// Numbers that are as near as this to others may be the next ones.
const LEAST_APART: u16 = 256;

impl Jumps {
    fn count(&mut self, at: u64, place: Place) {
        if self.odd.failed == 0 {
            self.first = at;
        }
        self.runs += u64::from(self.odd.failed == 0 || self.last + 1 != at);
        self.last = at;
        self.odd.count(true, place);
    }

    fn merge(&mut self, later: &Self, answers: u64) {
        let goes_on = self.odd.failed > 0 && self.last + 1 == later.first + answers;
        self.runs += later.runs - u64::from(goes_on);
        if self.odd.failed == 0 {
            self.first = later.first + answers;
        }
        self.last = later.last + answers;
        self.odd.merge(&later.odd);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn registers(values: &[[u16; 2]], from: usize) -> Registers {
        let mut all = Registers::default();
        for (at, [one, other]) in values.iter().enumerate() {
            let place = Place { number: (from + at + 1) as u64, elapsed: None, time: None };
            all.count(&[one.to_be_bytes(), other.to_be_bytes()].concat(), place);
        }
        all
    }

    #[test]
    fn one_register_jumps_beside_its_neighbour() {
        let mut values: Vec<[u16; 2]> = (0..40).map(|number| [2000 + number, 65_530 + number % 5]).collect();
        for at in [7, 8, 30] {
            values[at] = [0xFFFF; 2];
        }
        let whole = registers(&values, 0);
        let jumps: Vec<Jump> = whole.jumps().collect();
        // The second register goes up to 65534, next to FFFF.
        assert_eq!(jumps.len(), 1);
        assert_eq!((jumps[0].register, jumps[0].others, jumps[0].odd.failed, jumps[0].runs), (0, (2000, 2039), 3, 2));
        for cut in 0..=values.len() {
            let mut merged = registers(&values[..cut], 0);
            merged.merge(&registers(&values[cut..], cut));
            assert_eq!(merged, whole, "cut at {cut}");
        }
    }

    #[test]
    fn a_number_has_to_be_far_from_all_others() {
        assert!(is_far(0xFFFF, (2000, 2100)) && is_far(0x8000, (0, 900)));
        // A signed value around 0, a counter that runs over, a level that moves in all its range.
        assert!(!is_far(0xFFFF, (0, 1)) && !is_far(0xFFFF, (0xFF00, 0xFFFE)) && !is_far(0x7FFF, (0, 60_000)));
        assert!(!is_far(0xFFFF, (100, 50_000)));
    }
}
