//! What stood in bytes that begin no frame: damaged frames where the traffic around them says so, noise elsewhere.
//!
//! Before a gap stands perhaps a request that waits, behind it perhaps the same request again, or an answer to nobody;
//! the poll cycle is known, and so are units and functions. Each of these is a template, and a damaged frame is
//! reported where one of them fits with enough bits to spare. Bytes that fit nothing are noise.

mod align;
mod candidate;
mod mend;
mod pick;
mod rest;
mod template;

use crate::framer::harm::Harm;
use crate::framer::rtu::costs;
use crate::framer::rtu::index::Values;
use crate::framer::rtu::model::Model;
use crate::framer::rtu::AROUND;
use crate::framer::Context;
use crate::input::Input;
use modlens_protocol::direction::Direction;
use modlens_protocol::Ns;

use candidate::Candidate;
pub use pick::is_glitch;

/// Bits that a damaged frame must be worth to be reported: the chance that noise looks so is about 2 to the minus this.
const ENOUGH: f32 = 10.0;

/// Sums of the same numbers in another order differ by less.
const ROUNDING: f32 = 0.01;

/// Damaged frames are seldom: two of them need more than one.
const SELDOM: f32 = 8.0;

/// Longer gaps are noise: frames are looked for near their ends only, in so many bytes.
const NEAR: usize = 320;

/// A frame that ends just where a pause, a frame or the recording's end is.
const ENDS_WELL: f32 = 4.0;

/// Strays before a frame cost so much each, and so much at most.
const STRAY: f32 = 1.2;
const MOST_STRAYS: f32 = 6.8;

/// In longer frames, too many places admit one byte more by chance.
const SHORT: usize = 40;

/// So many strays of one value a driver leaves behind a frame, at most.
const MOST_GLITCH: usize = 3;

/// Adapters and schedulers seldom hold the rest of a frame back for longer.
const COARSE_STOP: Ns = 45_000_000;

/// One frame that begins inside the length that another one announces.
const CUT_OFF: f32 = 3.0;

/// A place where it is unknown what stood there, and what is known of it.
pub struct Scene<'a, 'c> {
    /// What the line has shown.
    pub model: &'a Model,
    /// What the session knows: the request before the gap.
    pub context: &'a Context<'c>,
    /// The bytes.
    pub input: &'a Input,
    /// How many of them are in the gap.
    pub length: usize,
    /// The frame behind the gap.
    pub after: Option<(&'a [u8], Direction)>,
    /// A damaged frame stands before the gap.
    pub behind_damage: bool,
    /// The shortest pause between frames.
    pub silence: Ns,
    /// It ends where a header announces an end, not where anything else begins.
    pub announced: bool,
}

/// A damaged frame in the gap.
#[derive(Clone, Debug)]
pub struct Piece {
    /// Index of its first byte.
    pub start: usize,
    /// Index behind its last byte.
    pub end: usize,
    /// Who sent it.
    pub direction: Direction,
    /// Its first bytes, if they are missing.
    pub head: Vec<u8>,
    /// It is shorter than it should be.
    pub short: bool,
    /// What happened to it.
    pub harm: Option<Harm>,
    /// Unit and function are not there.
    pub unknown: bool,
    /// So many of its first bytes are others than those sent, which `head` holds.
    pub wrong: usize,
}

impl Scene<'_, '_> {
    fn bytes(&self) -> &[u8] {
        &self.input.bytes()[..self.length]
    }

    /// The damaged frames of this gap, in order.
    pub fn pieces(&self) -> Vec<Piece> {
        let mut pieces = if self.is_nothing() { Vec::new() } else { self.pick(&self.all_candidates()) };
        // What somebody shows by itself begins where it begins.
        if self.is_alone() && pieces.first().is_some_and(|piece| !is_glitch(&self.bytes()[..piece.start])) {
            pieces.clear();
        }
        let first = pieces.first().map_or(self.length, |piece| piece.start);
        pieces.splice(0..0, self.remains(first, pieces.is_empty()));
        match pieces.last_mut() {
            Some(last) if self.ends_in_one(last) && self.goes_on(last) => {
                let at = last.end - last.start;
                let count = match last.harm {
                    Some(Harm::Lost { count, .. }) => count + last.end - self.length,
                    _ => 0,
                };
                (last.end, last.harm) = (self.length, Some(Harm::Lost { at, count }));
            }
            Some(last) if self.runs_on(last) => {
                let at = last.end - last.start;
                (last.short, last.harm) = (true, Some(Harm::Lost { at, count: 0 }));
            }
            _ => pieces.extend(self.tail(&pieces)),
        }
        pieces
    }

    /// Whether this line is framed by itself, as those of a two-line tap without a clock are: which requests wait is not
    /// known, and an answer needs none.
    fn is_by_itself(&self) -> bool {
        self.context.speaker.is_some() && self.context.asked.is_none() && !self.input.timed
    }

    /// Whether there is nothing else in the recording.
    fn is_alone(&self) -> bool {
        self.input.offset() == 0 && self.after.is_none() && self.input.ended && self.length == self.input.bytes().len()
    }

    /// Whether more than a few strays are no frame on this line.
    fn is_clean(&self) -> bool {
        self.model.strays_at_most() < AROUND
    }

    /// Whether the bytes are too few to be worth enough, whatever they agree with.
    ///
    /// Fewer than a frame has cannot have a right checksum, nor end where one should without bytes missing, which costs more
    /// than that is worth; to be chosen among all templates costs more than a pause in front is worth. No unit sends what
    /// drivers leave as its number and its function.
    fn is_nothing(&self) -> bool {
        let worthless = || self.model.bits_of(self.bytes()) + costs::PAUSE_BEFORE - STRAY < ENOUGH;
        self.length <= MOST_GLITCH && (is_glitch(self.bytes()) || worthless())
    }

    fn all_candidates(&self) -> Vec<Candidate> {
        let around = template::around(self);
        let mut values = Values::default();
        for template in &around {
            values.add(&template.bytes);
        }
        let mut candidates = Vec::new();
        let near_the_end = NEAR.max(self.length.saturating_sub(NEAR));
        for start in (0..NEAR.min(self.length)).chain(near_the_end..self.length) {
            let bytes = &self.bytes()[start..];
            if !around.is_empty() && values.admit(bytes) {
                self.expected(&around, start, &mut candidates);
            }
            self.candidates(start, &mut candidates);
        }
        candidates
    }
}
