//! Registers that jump for a single read and come back: to 0, to ten times or a tenth of their value, or to its negative.

use crate::observation::apart;

/// What a register jumps to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum JumpKind {
    /// 0.
    Zero,
    /// Ten times its value.
    TenTimes,
    /// A tenth of its value.
    Tenth,
    /// Its negative.
    Negative,
}

impl JumpKind {
    /// The words of a sentence.
    pub fn words(self) -> &'static str {
        match self {
            Self::Zero => "0",
            Self::TenTimes => "ten times",
            Self::Tenth => "a tenth of",
            Self::Negative => "the negative of",
        }
    }

    /// What a value is between two others that are nearly alike.
    fn of(before: u16, value: u16) -> Option<Self> {
        let is_near = |one: u32, other: u32| one.abs_diff(other) * 20 <= other;
        let (own, other) = (u32::from(value), u32::from(before));
        match value {
            0 => Some(Self::Zero),
            _ if is_near(own, 10 * other) => Some(Self::TenTimes),
            _ if is_near(10 * own, other) => Some(Self::Tenth),
            _ if apart(value, before.wrapping_neg()) * 20 <= other.min(0x1_0000 - other) => Some(Self::Negative),
            _ => None,
        }
    }
}

/// A jump is so many times as far as the value goes from one read to the next otherwise.
const TIMES_A_STEP: u32 = 8;

/// Nearer values may be the next ones.
const LEAST_JUMP: u32 = 64;

/// Values that are looked at together: a jump, the one before and the one after it, and one beside them.
const WINDOW: usize = 4;

/// The values of one register, and its jumps.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Series {
    /// The first values, and the last ones, as many as there are.
    first: Few,
    last: Few,
    /// The greatest step that belongs to no jump.
    step: u16,
    /// The least jump; 0 without any.
    least: u16,
}

/// Up to three values in order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Few {
    values: [u16; WINDOW - 1],
    count: u8,
}

impl Few {
    fn values(&self) -> &[u16] {
        &self.values[..usize::from(self.count)]
    }

    /// Adds a value if there is room.
    fn add(&mut self, value: u16) {
        if usize::from(self.count) < self.values.len() {
            self.values[usize::from(self.count)] = value;
            self.count += 1;
        }
    }

    /// Adds a value in the place of the oldest one.
    fn push(&mut self, value: u16) {
        if usize::from(self.count) == self.values.len() {
            self.values.rotate_left(1);
            self.count -= 1;
        }
        self.add(value);
    }
}

/// How far a value is from both its neighbours, if these are much nearer to each other.
fn jump([before, value, after]: [u16; 3]) -> Option<u32> {
    let far = apart(before, value).min(apart(value, after));
    (far >= LEAST_JUMP && apart(before, after) * TIMES_A_STEP <= far).then_some(far)
}

impl Series {
    /// Counts a value; what the value before it jumped to, if it did.
    #[inline]
    pub fn count(&mut self, value: u16) -> Option<JumpKind> {
        let found = self.look(value);
        self.first.add(value);
        self.last.push(value);
        found
    }

    /// Looks at the last values together with the next one.
    #[inline]
    fn look(&mut self, value: u16) -> Option<JumpKind> {
        let values = self.last.values;
        if self.last.count == 3 && values[1] == values[2] && values[2] == value && values[0] == value {
            return None;
        }
        let mut found = None;
        if let [.., before, middle] = *self.last.values() {
            if let Some(far) = jump([before, middle, value]) {
                found = JumpKind::of(before, middle);
                let far = u16::try_from(far).unwrap_or(u16::MAX);
                self.least = if self.least == 0 { far } else { self.least.min(far) };
            }
        }
        if let [first, one, other] = *self.last.values() {
            // The step between the two in the middle, unless one of them is a jump.
            if jump([first, one, other]).is_none() && jump([one, other, value]).is_none() {
                self.step = self.step.max(u16::try_from(apart(one, other)).unwrap_or(u16::MAX));
            }
        }
        found
    }

    /// Whether its jumps are much farther than its steps.
    pub fn is_told_from_steps(&self) -> bool {
        u32::from(self.least) >= TIMES_A_STEP * u32::from(self.step)
    }

    /// Adds the values of a later part; gives the jumps of the values at the seam: that of the last own one, and that of the first
    /// later one.
    pub fn merge(&mut self, later: &Self) -> [Option<JumpKind>; 2] {
        let mut at_seam = [None; 2];
        for (at, value) in later.first.values().iter().enumerate() {
            let found = self.look(*value);
            if let Some(seam) = at_seam.get_mut(at) {
                *seam = found;
            }
            self.first.add(*value);
            self.last.push(*value);
        }
        self.step = self.step.max(later.step);
        self.least = if self.least == 0 || later.least == 0 { self.least.max(later.least) } else { self.least.min(later.least) };
        if usize::from(later.last.count) == WINDOW - 1 {
            self.last = later.last;
        }
        at_seam
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(values: &[u16]) -> Vec<JumpKind> {
        let mut series = Series::default();
        values.iter().filter_map(|value| series.count(*value)).collect()
    }

    #[test]
    fn a_single_read_of_another_size_is_a_jump() {
        let steady = |odd: u16| [500, 501, 502, odd, 503, 503, 504];
        assert_eq!(kinds(&steady(0)), [JumpKind::Zero]);
        assert_eq!(kinds(&steady(5020)), [JumpKind::TenTimes]);
        assert_eq!(kinds(&steady(50)), [JumpKind::Tenth]);
        assert_eq!(kinds(&steady(502u16.wrapping_neg())), [JumpKind::Negative]);
        // Three times its value, a new level, and a value around 0.
        assert!(kinds(&steady(1506)).is_empty());
        assert!(kinds(&[500, 501, 0, 0, 0, 500, 501]).is_empty());
        assert!(kinds(&[1, 0, 1, 0xFFFF, 1]).is_empty());
    }

    #[test]
    fn a_register_that_is_switched_has_steps_as_great_as_its_jumps() {
        let mut series = Series::default();
        for value in [500, 500, 0, 500, 500, 0, 0, 500, 500] {
            series.count(value);
        }
        assert!(!series.is_told_from_steps());
    }

    #[test]
    fn parts_merge_to_the_whole() {
        let values: Vec<u16> = (0..40u16).map(|at| if at % 13 == 5 { 0 } else { 900 + at % 3 }).collect();
        let count = |values: &[u16]| {
            let mut series = Series::default();
            let found = values.iter().filter(|value| series.count(**value).is_some()).count();
            (series, found)
        };
        let (whole, jumps) = count(&values);
        assert_eq!(jumps, 3);
        for cut in 0..=values.len() {
            let ((mut merged, before), (later, after)) = (count(&values[..cut]), count(&values[cut..]));
            let at_seam = merged.merge(&later).iter().flatten().count();
            assert_eq!((merged, before + at_seam + after), (whole.clone(), jumps), "cut at {cut}");
        }
    }
}
