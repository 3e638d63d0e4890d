//! Damage to single frames, between their sender and the recording.

use crate::model::Framing;
use crate::rng::Rng;
use crate::sim::scenario::Scenario;

/// The damage that was done to a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// Bits were inverted.
    pub flip: bool,
    /// Bytes were lost in the tap.
    pub lost: bool,
    /// A byte was delivered twice.
    pub dup: bool,
    /// The sender stopped too early.
    pub trunc: bool,
    /// Another sender transmitted at the same time.
    pub collide: bool,
    /// The capture begins inside the frame.
    pub midstart: bool,
    /// The colon of an ASCII frame was damaged or lost.
    pub colon: bool,
    /// CR, LF or both of an ASCII frame were not sent.
    pub no_end: bool,
}

impl Damage {
    /// The kinds of damage by name, each after a space.
    pub fn text(&self) -> String {
        let all = [
            (self.flip, " flip"),
            (self.lost, " lost"),
            (self.dup, " dup"),
            (self.trunc, " trunc"),
            (self.collide, " collide"),
            (self.midstart, " midstart"),
            (self.colon, " colon"),
            (self.no_end, " no_end"),
        ];
        all.iter().filter(|(done, _)| *done).map(|(_, word)| *word).collect()
    }
}

/// One character on its way to the tap.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slot {
    pub(crate) value: u8,
    /// Which byte of the frame it is; `None` for stray bytes.
    pub(crate) index: Option<u16>,
    /// Silence before it, in characters.
    pub(crate) gap: f64,
    /// The tap does not deliver it.
    pub(crate) lost: bool,
}

impl Slot {
    pub(crate) fn stray(value: u8) -> Self {
        Self { value, index: None, gap: 0.0, lost: false }
    }
}

/// The characters of a frame, after the damage.
#[derive(Debug)]
pub(crate) struct DamagedTransmission {
    pub(crate) slots: Vec<Slot>,
    pub(crate) damage: Damage,
    /// It was damaged on the line already, so its receiver drops it as well.
    pub(crate) is_damaged_on_line: bool,
}

impl DamagedTransmission {
    /// The frame with the random damage of a scenario.
    pub(crate) fn new(frame: &[u8], scenario: &Scenario, rng: &mut Rng) -> Self {
        let slots = frame.iter().enumerate().map(|(index, &value)| Slot { index: Some(index as u16), ..Slot::stray(value) });
        let mut this = Self { slots: slots.collect(), damage: Damage::default(), is_damaged_on_line: false };
        let mask = if scenario.framing == Framing::Ascii { 0x7F } else { 0xFF };
        if rng.chance(scenario.no_crlf) {
            this.unfinish(rng);
        }
        if rng.chance(scenario.trunc) {
            this.truncate(rng);
        }
        if rng.chance(scenario.collide) {
            this.collide(mask, rng);
        }
        if rng.chance(scenario.flip) {
            this.flip(mask.count_ones() as usize, rng);
        }
        if rng.chance(scenario.bad_colon) {
            this.damage_colon(rng);
        }
        if rng.chance(scenario.drop) {
            this.drop(rng);
        }
        if rng.chance(scenario.dup) {
            this.duplicate(rng);
        }
        this.slow(scenario, rng);
        if rng.chance(scenario.turn_lead) {
            let strays = glitch(mask, rng);
            this.slots.splice(0..0, strays);
        }
        if rng.chance(scenario.turn_trail) {
            this.slots.extend(glitch(mask, rng));
        }
        this
    }

    /// Removes CR, LF or both.
    fn unfinish(&mut self, rng: &mut Rng) {
        self.damage.no_end = true;
        let end = self.slots.len();
        match rng.below(3) {
            0 => self.slots.truncate(end - 2),
            1 => self.slots.truncate(end - 1),
            _ => {
                self.slots.remove(end - 2);
            }
        }
    }

    fn truncate(&mut self, rng: &mut Rng) {
        self.slots.truncate(rng.range(1, self.slots.len() - 1));
        self.damage.trunc = true;
        self.is_damaged_on_line = true;
    }

    /// Another sender transmits at the same time. A driver that pulls to 0 wins, so bytes are combined by AND; if the other
    /// frame is longer, its rest follows.
    fn collide(&mut self, mask: u8, rng: &mut Rng) {
        let from = rng.below(self.slots.len());
        for at in from..from + rng.range(3, 40) {
            let intruder = rng.byte() & mask;
            match self.slots.get_mut(at) {
                Some(slot) => {
                    slot.value &= intruder;
                    if rng.chance(0.3) {
                        slot.value ^= (1 << rng.below(8)) & mask;
                    }
                }
                None => self.slots.push(Slot::stray(intruder)),
            }
        }
        self.damage.collide = true;
        self.is_damaged_on_line = true;
    }

    fn flip(&mut self, bits: usize, rng: &mut Rng) {
        let mut places: Vec<(usize, usize)> = Vec::new();
        let count = rng.range(1, 3);
        while places.len() < count {
            let place = (rng.below(self.slots.len()), rng.below(bits));
            if !places.contains(&place) {
                places.push(place);
                self.slots[place.0].value ^= 1 << place.1;
            }
        }
        self.damage.flip = true;
        self.is_damaged_on_line |= rng.chance(0.5);
    }

    fn damage_colon(&mut self, rng: &mut Rng) {
        self.damage.colon = true;
        if rng.chance(0.5) {
            self.slots[0].lost = true;
            self.damage.lost = true;
        } else {
            self.slots[0].value ^= 1 << rng.below(7);
        }
    }

    fn drop(&mut self, rng: &mut Rng) {
        let count = rng.range(1, 3).min(self.slots.len());
        let at = rng.range(0, self.slots.len() - count);
        self.slots[at..at + count].iter_mut().for_each(|slot| slot.lost = true);
        self.damage.lost = true;
    }

    /// Delivers one byte twice. In a run of equal bytes at either end of the frame the copy cannot be distinguished from a
    /// stray byte outside the frame, so it is put there.
    fn duplicate(&mut self, rng: &mut Rng) {
        let at = rng.below(self.slots.len());
        let value = self.slots[at].value;
        let copy = Slot::stray(value);
        self.damage.dup = true;
        if self.slots[..at].iter().all(|slot| slot.value == value) {
            self.slots.insert(0, copy);
        } else if self.slots[at..].iter().all(|slot| slot.value == value) {
            self.slots.push(copy);
        } else {
            self.slots.insert(at, copy);
        }
    }

    fn slow(&mut self, scenario: &Scenario, rng: &mut Rng) {
        let mut gaps: Vec<f64> = Vec::new();
        if rng.chance(scenario.slow15) {
            gaps.extend((0..rng.range(1, 4)).map(|_| rng.uniform(1.5, 3.4)));
        }
        if rng.chance(scenario.slow35) {
            gaps.extend((0..rng.range(1, 2)).map(|_| rng.uniform(3.6, 25.0)));
        }
        if self.slots.len() > 1 {
            for gap in gaps {
                let at = rng.range(1, self.slots.len() - 1);
                self.slots[at].gap = gap;
            }
        }
    }
}

/// The stray bytes that a line driver causes when it is switched on or off.
fn glitch(mask: u8, rng: &mut Rng) -> Vec<Slot> {
    let count = 1 + rng.weighted(&[3, 1, 1]);
    let value = match rng.weighted(&[6, 3, 1]) {
        0 => 0x00,
        1 => 0xFF,
        _ => rng.pick(&[0xF0, 0xFE, 0xC0, 0x80]),
    };
    vec![Slot::stray(value & mask); count]
}
