//! What one line has shown so far, counted, and what evidence is worth there.

use crate::damage::kind::DamageKind;
use crate::framer::rtu::bits::log2;
use crate::framer::rtu::costs::{
    function_prior, unit_prior, usual_bits, AFTER_STRAYS, BEFORE_STRAYS, FIRST_COPIES, FIRST_JUNK, FIRST_LATES, FIRST_ORPHANS,
    FIRST_UNANSWERED, FORGET, FORGET_TURNS, INTO_NOISE, MAY_HOLD_A_FRAME, NOISE_FORGET, NOISE_STEP, NOISE_WEIGHT, ORPHAN,
    OUT_OF_NOISE, PRIOR_WEIGHT, REPEATED_AT_MOST, STRAY,
};
use crate::framer::rtu::gain::{REQUEST, RESPONSE};
use crate::framer::rtu::hints::Hints;
use crate::framer::rtu::polls::Polls;
use crate::framer::rtu::shapes::Shapes;
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};

/// So many bytes are counted in another way.
const MANY: usize = 1024;

/// What the line has shown so far.
pub struct Model {
    units: [f32; 256],
    unit_total: f32,
    /// By direction and function code, the exception bit off.
    functions: [[f32; 128]; 2],
    function_totals: [f32; 2],
    /// The requests seen.
    pub polls: Polls,
    frames: f32,
    junk: f32,
    /// Frames behind so few bytes that these were no frame.
    few: f32,
    /// Frames with a pause inside.
    paused: f32,
    /// Damaged frames of which bytes were missing, and those that another sender talked into.
    damage_counts: [f32; 2],
    /// Answers without their end, behind which the master went on, and those that it asked for again.
    ends: [f32; 2],
    requests: f32,
    copies: f32,
    /// Costs of frames that follow each other at once, and of those that do not.
    glued: f32,
    strays: f32,
    bits: [f32; 256],
    /// The shares of all bytes before any noise was seen.
    usual: Box<[f32; 256]>,
    noise: Box<[f32; 256]>,
    noise_total: f32,
    noise_due: f32,
    /// Frames while no request waits, without and with bytes before them: responses, and all.
    orphans: [[f32; 2]; 2],
    /// Frames while a request waits: other requests, and all.
    unanswered: [[f32; 2]; 2],
    /// Retries that were answered: those behind whose answer the old one came, and all.
    lates: [f32; 2],
    shapes: Shapes,
    /// Bounds on what headers may claim.
    pub hints: Hints,
}

/// Where a frame stands among others.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// A request waits.
    pub waiting: bool,
    /// Bytes before it that are no frame.
    pub junk: u64,
}

/// What a request is to the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Copy {
    /// Another one.
    First,
    /// The same again, before any answer.
    Again,
    /// An answer may look the same.
    Unclear,
}

impl Default for Model {
    fn default() -> Self {
        let mut this = Self {
            units: [0.0; 256],
            unit_total: 0.0,
            functions: [[0.0; 128]; 2],
            function_totals: [0.0; 2],
            polls: Polls::default(),
            frames: 0.0,
            junk: 0.0,
            few: 0.0,
            paused: 0.0,
            damage_counts: [0.0; 2],
            ends: [0.0; 2],
            requests: 0.0,
            copies: 0.0,
            glued: 0.0,
            strays: 0.0,
            bits: std::array::from_fn(|byte| usual_bits(byte as u8)),
            usual: Box::new(std::array::from_fn(|byte| (-usual_bits(byte as u8)).exp2())),
            noise: Box::new([0.0; 256]),
            noise_total: 0.0,
            noise_due: NOISE_STEP,
            orphans: [[0.0; 2]; 2],
            unanswered: [[0.0; 2]; 2],
            lates: [0.0; 2],
            shapes: Shapes::default(),
            hints: Hints::default(),
        };
        this.settle();
        this
    }
}

impl Model {
    /// The bits of a byte: fewer for bytes that this line's noise is made of.
    #[inline]
    pub fn bits(&self, byte: u8) -> f32 {
        self.bits[byte as usize]
    }

    /// The bits of some bytes.
    pub fn bits_of(&self, bytes: &[u8]) -> f32 {
        bytes.iter().map(|&byte| self.bits(byte)).sum()
    }

    /// Learns from bytes that are no frame: on a wrong baud rate or a floating line few values make all of the noise.
    pub fn learn_noise(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        if bytes.len() >= MANY {
            // The same byte again would have to wait for the sum before: so four sums are made.
            let mut sums = [[0u32; 256]; 4];
            let quads = bytes.chunks_exact(4);
            rest = quads.remainder();
            for quad in quads {
                for (sums, &byte) in sums.iter_mut().zip(quad) {
                    sums[usize::from(byte)] += 1;
                }
            }
            for (at, count) in self.noise.iter_mut().enumerate() {
                *count += sums.iter().map(|sums| sums[at]).sum::<u32>() as f32;
            }
        }
        for &byte in rest {
            self.noise[byte as usize] += 1.0;
        }
        self.noise_total += bytes.len() as f32;
        if self.noise_total >= self.noise_due {
            self.weigh_noise();
        }
    }

    /// Works out the bits of all bytes. Without branches: then it takes a few operations for many of them at once.
    fn weigh_noise(&mut self) {
        if self.noise_total > NOISE_FORGET {
            self.noise.iter_mut().for_each(|count| *count /= 2.0);
            self.noise_total /= 2.0;
        }
        self.noise_due = self.noise_total + NOISE_STEP;
        let total = self.noise_total;
        let weight = total / (total + NOISE_WEIGHT);
        for ((bits, &seen), &usual) in self.bits.iter_mut().zip(self.noise.iter()).zip(self.usual.iter()) {
            *bits = -log2((1.0 - weight) * usual + weight * (seen / total).max(usual));
        }
    }

    /// Cost of a unit number.
    pub fn unit(&self, unit: u8) -> f32 {
        self.unit_if(unit, self.seen_unit(unit))
    }

    /// The same, if it had been seen so often.
    pub fn unit_if(&self, unit: u8, seen: f32) -> f32 {
        let seen = seen + PRIOR_WEIGHT * unit_prior(unit);
        -log2(seen / (self.unit_total + PRIOR_WEIGHT))
    }

    /// How often a unit was seen lately.
    pub fn seen_unit(&self, unit: u8) -> f32 {
        self.units[usize::from(unit)]
    }

    /// Cost of a function code in a direction (0 request, 1 response).
    pub fn function(&self, functions: &Functions, code: u8, direction: usize) -> f32 {
        self.function_if(functions, code, direction, self.seen_function(code, direction))
    }

    /// The same, if it had been seen so often.
    pub fn function_if(&self, functions: &Functions, code: u8, direction: usize, seen: f32) -> f32 {
        let seen = seen + PRIOR_WEIGHT * function_prior(functions, code & !EXCEPTION_BIT);
        -log2(seen / (self.function_totals[direction] + PRIOR_WEIGHT))
    }

    /// How often a function was seen lately in a direction.
    pub fn seen_function(&self, code: u8, direction: usize) -> f32 {
        self.functions[direction][usize::from(code & !EXCEPTION_BIT)]
    }

    /// Learns the length of a frame whose layout is not public.
    pub fn learn_length(&mut self, code: u8, direction: usize, body: &[u8]) {
        self.shapes.learn(code, direction, body);
    }

    /// Times that unit and function were seen in committed frames.
    pub fn familiar(&self, unit: u8, code: u8, direction: usize) -> bool {
        const OFTEN: f32 = 3.0;
        self.units[unit as usize] >= OFTEN && self.functions[direction][(code & !EXCEPTION_BIT) as usize] >= OFTEN
    }

    /// Whether a unit that has been seen may begin a frame with this function code.
    pub fn has_seen(&self, unit: u8, code: u8) -> bool {
        let function = usize::from(code & !EXCEPTION_BIT);
        self.units[usize::from(unit)] > 0.0 && self.functions.iter().any(|seen| seen[function] > 0.0)
    }

    /// Whether this unit has been seen.
    pub fn has_unit(&self, unit: u8) -> bool {
        self.units[usize::from(unit)] > 0.0
    }

    /// What a request that was seen before is worth.
    pub fn repeated(&self, frame: &[u8]) -> f32 {
        if !self.polls.knows(frame) {
            return 0.0;
        }
        let body = self.bits_of(&frame[2..frame.len() - 2]);
        (body - 3.0).clamp(0.0, REPEATED_AT_MOST)
    }

    /// Costs of a request and of a response that answers nothing, in this setting.
    pub fn turn(&self, setting: Setting) -> (f32, f32) {
        let at = usize::from(setting.junk >= MAY_HOLD_A_FRAME);
        if setting.waiting {
            let share = share(self.unanswered[at], FIRST_UNANSWERED[at]);
            return (-log2(share), ORPHAN);
        }
        let share = share(self.orphans[at], FIRST_ORPHANS[at]);
        (-log2(1.0 - share), -log2(share))
    }

    /// Cost of an answer to the request before the last one.
    pub fn late(&self) -> f32 {
        -log2(share(self.lates, FIRST_LATES))
    }

    /// A retry was answered, or behind such an answer came the old one.
    pub fn learn_late(&mut self, late: bool) {
        self.lates[usize::from(!late)] += 1.0;
        if self.lates[1] > FORGET_TURNS {
            self.lates.iter_mut().for_each(|count| *count /= 2.0);
        }
    }

    /// Cost of the length of a body whose layout is not public.
    pub fn open_length(&self, code: u8, direction: usize, body: &[u8]) -> f32 {
        let count_bits = body.first().map_or(0.0, |&count| self.bits(count));
        self.shapes.cost(code, direction, body, count_bits)
    }

    /// Works out anew what depends on all that was learned. The search calls it whenever it has learned.
    pub fn settle(&mut self) {
        let share = (self.junk + PRIOR_WEIGHT * FIRST_JUNK) / (self.frames + PRIOR_WEIGHT);
        let share = share.clamp(0.002, 0.9);
        (self.glued, self.strays) = (-log2(1.0 - share), -log2(share));
        self.hints.renew(self.frames);
    }

    /// Cost of so many bytes between two frames that are neither.
    pub fn between(&self, length: u64) -> f32 {
        if length == 0 {
            return self.glued;
        }
        let strays = BEFORE_STRAYS + STRAY * (length - 1) as f32 + AFTER_STRAYS;
        self.strays + strays.min(INTO_NOISE + OUT_OF_NOISE)
    }

    /// Cost of being among bytes that are no frame, so many behind the last one, without a way out yet.
    pub fn astray(&self, length: u64) -> f32 {
        if length == 0 {
            0.0
        } else {
            self.strays + (BEFORE_STRAYS + STRAY * (length - 1) as f32).min(INTO_NOISE)
        }
    }

    /// Costs of a request heard twice, and of hearing it once only.
    pub fn copied(&self) -> (f32, f32) {
        let share = (self.copies + PRIOR_WEIGHT * FIRST_COPIES) / (self.requests + PRIOR_WEIGHT);
        let share = share.clamp(0.001, 0.99);
        (-log2(share), -log2(1.0 - share))
    }

    /// Learns from a frame that is certain.
    #[inline]
    pub fn learn(&mut self, frame: &[u8], direction: usize, setting: Setting, copy: Copy) {
        let at = usize::from(setting.junk >= MAY_HOLD_A_FRAME);
        let (counts, seldom) = if setting.waiting { (&mut self.unanswered[at], 0) } else { (&mut self.orphans[at], 1) };
        counts[0] += f32::from(u8::from(direction == seldom));
        counts[1] += 1.0;
        if counts[1] > FORGET_TURNS {
            for count in counts.iter_mut() {
                *count /= 2.0;
            }
        }
        match copy {
            Copy::First if direction == 0 => self.requests += 1.0,
            Copy::Again => self.copies += 1.0,
            _ => {}
        }
        self.units[frame[0] as usize] += 1.0;
        self.unit_total += 1.0;
        self.functions[direction][(frame[1] & !EXCEPTION_BIT) as usize] += 1.0;
        self.function_totals[direction] += 1.0;
        self.frames += 1.0;
        self.junk += f32::from(u8::from(setting.junk > 0));
        self.learn_strays(setting.junk);
        if direction == 0 {
            self.polls.remember(frame);
        }
        if self.unit_total > FORGET {
            self.forget();
        }
    }

    /// So many bytes stood before a frame.
    pub fn learn_strays(&mut self, junk: u64) {
        self.few += f32::from(u8::from((1..MAY_HOLD_A_FRAME).contains(&junk)));
    }

    /// Learns from a request that leaves no doubt and from its answer, right behind another frame.
    #[inline]
    pub fn learn_exchange(&mut self, request: &[u8], response: &[u8], copy: Copy) {
        self.learn(request, REQUEST, Setting { waiting: false, junk: 0 }, copy);
        self.learn(response, RESPONSE, Setting { waiting: true, junk: 0 }, Copy::Unclear);
    }

    /// What happened to a damaged frame, where its bytes told.
    pub fn learn_damage(&mut self, damage: Option<DamageKind>) {
        match damage {
            Some(DamageKind::LostBytes { count: 1.., .. }) => self.damage_counts[0] += 1.0,
            Some(DamageKind::Collision { .. }) => self.damage_counts[1] += 1.0,
            _ => {}
        }
    }

    /// Whether bytes of this line go missing, and nearly nobody talks into others' frames.
    pub fn loses_bytes(&self) -> bool {
        const SOME: f32 = 3.0;
        const FOR_EACH_COLLISION: f32 = 4.0;
        self.damage_counts[0] >= SOME && self.damage_counts[0] >= FOR_EACH_COLLISION * self.damage_counts[1]
    }

    /// Behind an answer without its end, the master asked for it again, or went on.
    pub fn learn_end(&mut self, again: bool) {
        self.ends[usize::from(again)] += 1.0;
    }

    /// Whether it is the tap that has lost the end of an answer, and not the sender that stopped: masters went on.
    pub fn loses_ends(&self) -> bool {
        const SOME: f32 = 2.0;
        const FOR_EACH_STOP: f32 = 4.0;
        self.ends[0] >= SOME && self.ends[0] >= FOR_EACH_STOP * self.ends[1]
    }

    /// A good frame had a pause inside.
    pub fn learn_pause_inside(&mut self) {
        self.paused += 1.0;
    }

    /// Whether a pause inside a frame is nothing special here: one frame in a hundred has one.
    pub fn pauses_inside(&self) -> bool {
        self.paused * 100.0 > self.frames + 100.0
    }

    /// How many strays usually stand in one place on this line.
    pub fn strays_at_most(&self) -> usize {
        // Four random bytes in a silence are common on a noisy line; on a quiet one, two are too many.
        if self.few * 50.0 > self.frames {
            7
        } else {
            2
        }
    }

    fn forget(&mut self) {
        self.hints.clear();
        for value in self.units.iter_mut().chain(self.functions.iter_mut().flatten()).chain(&mut self.function_totals) {
            *value /= 2.0;
        }
        self.unit_total /= 2.0;
        self.damage_counts.iter_mut().for_each(|count| *count /= 2.0);
        for value in [&mut self.frames, &mut self.junk, &mut self.few, &mut self.paused, &mut self.requests, &mut self.copies] {
            *value /= 2.0;
        }
    }
}

/// A learned share: of counts (those, all), with a prior.
fn share(counts: [f32; 2], prior: f32) -> f32 {
    ((counts[0] + PRIOR_WEIGHT * prior) / (counts[1] + PRIOR_WEIGHT)).clamp(0.004, 0.9)
}
