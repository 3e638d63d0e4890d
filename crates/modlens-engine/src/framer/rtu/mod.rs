//! RTU by joint evidence: checksum, layout, the pending request, what the line has shown, and pauses, weighed in bits.
//!
//! `join` lists every substring with a right checksum, `gain` and `costs` say what each is worth as a request or a
//! response, `search` finds the best way through all of them. Traffic that leaves no doubt goes past the search.
//! Bytes between frames are named here: a damaged frame where header or silences say so, noise elsewhere.

pub(crate) mod announced_length;
pub(crate) mod bits;
pub(crate) mod certain;
pub(crate) mod costs;
pub(crate) mod gain;
pub(crate) mod hints;
pub(crate) mod index;
pub(crate) mod join;
pub(crate) mod model;
pub(crate) mod pending;
pub(crate) mod polls;
pub(crate) mod routine;
pub(crate) mod search;
pub(crate) mod shapes;
pub(crate) mod sift;

use crate::damage::recovery::{damaged_hypothesis, DamageRecovery, Surroundings};
use crate::framer::{Context, Cut, Framer, NOISE_LIMIT};
use crate::input::Input;
use modlens_protocol::direction::{judge, Direction};
use modlens_protocol::framing::{CutBy, Mode, Verdict};
use modlens_protocol::functions::Extent;
use modlens_protocol::line::Line;
use modlens_protocol::Ns;

use announced_length::announced;
use certain::{Certain, Length};
use pending::set_first;
use search::{Search, Told};

/// Without line settings or with reads of several bytes, shorter pauses say nothing.
const COARSE_SILENCE: Ns = 5_000_000;

/// In a recording, so many bytes are held back until the frame behind them is known.
const AHEAD: u64 = NOISE_LIMIT as u64;

/// The longest pause that may stand inside a frame: USB adapters and schedulers hold bytes back that long.
const BREAK: Ns = 90_000_000;

/// The most that `Cut::confidence` says.
pub const SURE: u8 = 60;

/// The framer of an RTU line.
pub struct Rtu {
    pub(crate) search: Search,
    /// What the search decided and is not given out yet.
    told: Option<Told>,
    /// Where a frame begins that was not certain.
    doubted: Option<u64>,
    /// The same of one behind a few strays, by the offset of the first of them.
    doubted_behind: Option<u64>,
    /// What was found in the unframed bytes in front of it.
    recovery: DamageRecovery,
    /// The last frame given out was damaged.
    pub(crate) after_damage: bool,
    /// Shortest pause between frames.
    silence: Ns,
}

impl Rtu {
    /// A framer for a line with these settings.
    pub fn new(line: Option<&Line>) -> Self {
        Self {
            search: Search::default(),
            told: None,
            doubted: None,
            doubted_behind: None,
            recovery: DamageRecovery::default(),
            after_damage: false,
            silence: line.map_or(COARSE_SILENCE, Line::t35_ns),
        }
    }

    fn silence(&self, input: &Input) -> Ns {
        if input.coarse {
            self.silence.max(COARSE_SILENCE)
        } else {
            self.silence
        }
    }

    /// Learns whether this line's frames have pauses inside.
    fn hear(&mut self, input: &Input, length: usize) {
        if input.timed && !input.coarse && input.edge_after(0, length - 1, self.silence(input)).is_some() {
            self.search.model.learn_pause_inside();
        }
    }

    fn cut(
        &self,
        input: &Input,
        context: &Context<'_>,
        length: usize,
        direction: Direction,
        confidence: u8,
        adu: &mut Vec<u8>,
    ) -> Cut {
        let frame = &input.bytes()[..length];
        adu.clear();
        adu.extend_from_slice(&frame[..length - 2]);
        let by_length = announced(context, frame).iter().flatten().any(|(_, extent)| *extent == Extent::Exactly(length));
        let silent = || input.closed || input.pause_before(length).is_some_and(|pause| pause >= self.silence(input));
        let cut_by = match by_length {
            true => CutBy::Length,
            false if silent() => CutBy::Silence,
            false => CutBy::Checksum,
        };
        Cut { verdict: Verdict::Ok, direction, confidence, ..Cut::noise(length, cut_by) }
    }

    /// Whether the first bytes are a frame without doubt. Asked once for each place: what the search has seen since must
    /// not depend on how the bytes came.
    #[inline]
    fn look(&mut self, input: &Input, context: &Context<'_>) -> Certain {
        let idle = !context.shared || self.search.idle();
        if self.doubted == Some(input.offset()) || !idle || self.search.told() > input.offset() {
            return Certain::No;
        }
        match certain::certain(&self.search, input, context) {
            Certain::Frame(length) if self.search.admits(0, length) => Certain::Frame(length),
            Certain::Wait => Certain::Wait,
            _ => {
                self.doubted = Some(input.offset());
                Certain::No
            }
        }
    }

    /// Looks behind a few strays, in a recording: for the next frame, without doubt. Once for each place, as `look` does.
    fn look_behind_strays(&mut self, input: &Input, context: &Context<'_>) -> Certain {
        let silent = context.speaker.is_none() && context.certain.is_none() && !context.shared;
        let plain = input.first_read().is_some_and(|read| read.side.is_none() && !read.record);
        let once = self.doubted_behind != Some(input.offset()) && self.search.told() == input.offset();
        if !(context.ahead && silent && plain && once && self.search.is_plain()) {
            return Certain::No;
        }
        let (strays, certain) = certain::behind_strays(&self.search, input, context);
        if matches!(certain, Certain::No) {
            self.doubted_behind = Some(input.offset());
        }
        if let Certain::Frame(length) = certain {
            let unit = input.bytes()[strays];
            let known = self.search.asked().is_some() || context.paired_units[usize::from(unit)];
            if !(known && self.search.admits(strays, length)) {
                self.doubted_behind = Some(input.offset());
                return Certain::No;
            }
            let start = input.offset() + strays as u64;
            self.search.pass(context, input.bytes(), strays, length);
            let (end, direction) = (self.search.told(), self.search.direction());
            self.told = Some(Told::Frame { start, end, direction, confidence: SURE, tentative: false });
        }
        certain
    }

    /// Gives out a frame that left no doubt.
    #[inline]
    fn pass(&mut self, input: &Input, context: &Context<'_>, length: Length, adu: &mut Vec<u8>) -> Cut {
        let bytes = input.bytes();
        self.after_damage = false;
        self.hear(input, length.bytes());
        self.search.pass(context, bytes, 0, length);
        let direction = self.search.direction();
        self.recovery.learn_reaction(&mut self.search.model, context, &bytes[..length.bytes()], direction);
        if !length.exact() {
            return self.cut(input, context, length.bytes(), direction, SURE, adu);
        }
        set_first(adu, bytes, length.bytes() - 2);
        Cut { verdict: Verdict::Ok, direction, confidence: SURE, ..Cut::noise(length.bytes(), CutBy::Length) }
    }

    /// The first frame or noise row, by search where that is necessary.
    ///
    /// Apart from `next`, which has to be short: nearly all frames leave no doubt.
    #[inline(never)]
    fn weigh(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        if let Some(cut) = self.without_checksum(input, context, adu) {
            return Some(cut);
        }
        loop {
            match self.told {
                // What follows tells what it was.
                Some(Told::Junk(to))
                    if context.ahead && !input.closed && to < input.offset() + AHEAD && !in_records(input, to) =>
                {
                    self.told = None;
                }
                Some(Told::Junk(to) | Told::Frame { start: to, .. } | Told::Damaged { start: to, .. }) if input.offset() < to => {
                    return Some(self.next_unframed(input, context, to, adu));
                }
                Some(Told::Frame { start, end, direction, confidence, tentative }) => {
                    (self.told, self.after_damage) = (None, false);
                    let length = (end - start) as usize;
                    self.hear(input, length);
                    self.recovery.learn_reaction(&mut self.search.model, context, &input.bytes()[..length], direction);
                    let cut = self.cut(input, context, length, direction, confidence, adu);
                    return Some(Cut { tentative, ..cut });
                }
                Some(Told::Damaged { start, end, direction }) => {
                    (self.told, self.after_damage) = (None, true);
                    return Some(self.damaged_hypothesis(input, context, (end - start) as usize, direction, adu));
                }
                _ => self.told = None,
            }
            if context.shared && self.search.idle() {
                self.search.set_asked(context.asked);
            }
            match self.look(input, context) {
                Certain::Frame(length) => return Some(self.pass(input, context, length, adu)),
                Certain::Wait => return None,
                Certain::No => {}
            }
            match self.look_behind_strays(input, context) {
                Certain::Frame(_) => continue,
                Certain::Wait => return None,
                Certain::No => {}
            }
            let held_back = self.search.told();
            self.told = match self.search.advance(input, context, self.silence(input)) {
                None if input.closed && held_back > input.offset() => Some(Told::Junk(held_back)),
                None => return None,
                told => told,
            };
        }
    }

    /// The first frame of the bytes up to stream offset `to`, which no valid frame claims: a damaged frame, or noise.
    fn next_unframed(&mut self, input: &Input, context: &Context<'_>, to: u64, adu: &mut Vec<u8>) -> Cut {
        let next_frame = match self.told {
            Some(Told::Frame { start, end, direction, .. } | Told::Damaged { start, end, direction }) => {
                let from = (start - input.offset()) as usize;
                Some((&input.bytes()[from..from + (end - start) as usize], direction))
            }
            _ => None,
        };
        let follows_damaged_frame = self.after_damage;
        let at = Surroundings { context, input, next_frame, follows_damaged_frame, frame_gap_ns: self.silence(input) };
        self.recovery.next_frame(&mut self.search.model, &at, to, adu)
    }

    /// A frame with a wrong CRC that the search found by its announced length.
    fn damaged_hypothesis(
        &mut self,
        input: &Input,
        context: &Context<'_>,
        length: usize,
        direction: Direction,
        adu: &mut Vec<u8>,
    ) -> Cut {
        let frame_gap_ns = self.silence(input);
        let at = Surroundings { context, input, next_frame: None, follows_damaged_frame: true, frame_gap_ns };
        let cut = damaged_hypothesis(&mut self.search.model, &at, length, direction, adu);
        if cut.length < length {
            // Stray bytes stand in the place of what the frame has lost.
            self.told = Some(Told::Junk(input.offset() + length as u64));
        }
        cut
    }

    /// A record of a recording that prints no checksums is one frame.
    fn without_checksum(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        let read = input.first_read().filter(|read| read.no_checksum)?;
        let length = (read.end - input.offset()) as usize;
        let bytes = &input.bytes()[..length];
        adu.clear();
        adu.extend_from_slice(bytes);
        self.search.jump(input.offset() + length as u64);
        if length < 2 {
            return Some(Cut::noise(length, CutBy::Record));
        }
        let pause = (context.pause)(input.pause_before(0));
        let direction = judge(context.functions, context.asked, bytes[0], &bytes[1..], context.said_at(input, 0), pause);
        Some(Cut { verdict: Verdict::NoChecksum, direction, ..Cut::noise(length, CutBy::Record) })
    }
}

impl Framer for Rtu {
    fn next(&mut self, input: &Input, context: &Context<'_>, adu: &mut Vec<u8>) -> Option<Cut> {
        let plain = self.told.is_none() && !context.shared && input.first_read().is_some_and(|read| !read.no_checksum);
        if plain {
            match self.look(input, context) {
                Certain::Frame(length) => return Some(self.pass(input, context, length, adu)),
                Certain::Wait => return None,
                Certain::No => {}
            }
        }
        self.weigh(input, context, adu)
    }

    fn mode(&self) -> Mode {
        Mode::Rtu
    }

    fn jump(&mut self, offset: u64) {
        self.told = None;
        self.search.jump(offset);
    }

    fn settled(&self, offset: u64) -> bool {
        self.told.is_none() && self.doubted != Some(offset) && self.search.settled(offset)
    }

    fn routine(&mut self) -> Option<&mut Rtu> {
        Some(self)
    }

    fn break_ns(&self, line: Option<&Line>) -> Ns {
        line.map_or(BREAK, |line| BREAK.max(10 * line.char_ns()))
    }
}

/// Whether the first bytes come in records, or end where one begins: there each is looked at by itself.
fn in_records(input: &Input, to: u64) -> bool {
    let begins = |index: usize| input.starts_read(index) && input.read(index).is_some_and(|read| read.record);
    input.first_read().is_some_and(|read| read.record) || begins((to - input.offset()) as usize)
}
