//! What stood in bytes that begin no frame: damaged frames where the traffic around them says so, noise elsewhere.
//!
//! Before a gap stands perhaps a request that waits, behind it perhaps the same request again, or an answer to nobody;
//! the poll cycle is known, and so are units and functions. Each of these is a template, and a damaged frame is
//! reported where one of them fits with enough bits to spare. Bytes that fit nothing are noise.

mod align;
mod mend;
mod template;

use crate::checksum::mending_bit;
use crate::direction::{Asked, Direction};
use crate::framer::harm::Harm;
use crate::framer::rtu::costs::{self, Model};
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::index::{may_be, possible, Set, Values};
use crate::framer::rtu::AROUND;
use crate::framer::{Context, RTU_LIMIT};
use crate::functions::{Extent, EXCEPTION_BIT};
use crate::input::Input;
use crate::Ns;

use align::{align, Fit};
use template::Template;

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

struct Candidate {
    start: usize,
    /// The next one may begin here.
    core: usize,
    /// Where it should end.
    end: Option<usize>,
    score: f32,
    direction: usize,
    /// Unit and function code.
    header: [u8; 2],
    /// What unit and function cost: nothing where the request before says them.
    novelty: f32,
    head: Vec<u8>,
    harm: Option<Harm>,
    /// With what is known of it, the checksum is right.
    mended: bool,
    /// What is known of it agrees, but the checksum is wrong.
    exact: bool,
    /// All of it is known, and it agrees up to here.
    open_at: Option<usize>,
}

impl Scene<'_, '_> {
    fn bytes(&self) -> &[u8] {
        &self.input.bytes()[..self.length]
    }

    /// The damaged frames of this gap, in order.
    pub fn pieces(&self) -> Vec<Piece> {
        let mut pieces = if self.is_nothing() { Vec::new() } else { self.pick(&self.all_candidates()) };
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
            _ => pieces.extend(self.tail(&pieces)),
        }
        pieces
    }

    /// Whether the bytes are too few to be worth enough, whatever they agree with.
    ///
    /// Fewer than a frame has cannot have a right checksum, nor end where one should without bytes missing, which costs more
    /// than that is worth; to be chosen among all templates costs more than a pause in front is worth.
    fn is_nothing(&self) -> bool {
        self.length <= MOST_GLITCH && self.model.bits_of(self.bytes()) + costs::PAUSE_BEFORE - STRAY < ENOUGH
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

    /// Whether the bytes behind a piece came in one go.
    fn ends_in_one(&self, piece: &Piece) -> bool {
        let (start, end) = (piece.end, self.length);
        start < end && self.stops(start) && !(start + 1..end).any(|at| self.stops(at))
    }

    /// What stands behind a frame that lost its end, between two pauses: the rest of a frame that lost its beginning.
    fn tail(&self, pieces: &[Piece]) -> Option<Piece> {
        let last = pieces.last().filter(|last| matches!(last.harm, Some(Harm::Lost { .. })))?;
        let (_, after) = self.after?;
        let (start, end) = (last.end, self.length);
        if !self.ends_in_one(last) || end - start <= self.model.strays_at_most() || end - start > RTU_LIMIT {
            return None;
        }
        let direction = if after == Direction::Request { Direction::Response } else { Direction::Request };
        let harm = Some(Harm::Lost { at: 0, count: 0 });
        Some(Piece { start, end, direction, head: Vec::new(), short: true, harm, unknown: true, wrong: 0 })
    }

    /// What stands before all that was recognised: the rest of a frame, where one must have been.
    ///
    /// A recording begins in the middle of a frame more often than not. Elsewhere, a request or its answer is missing,
    /// and more bytes than strays would be stand in the place.
    fn remains(&self, to: usize, alone: bool) -> Option<Piece> {
        let begins = self.input.offset() == 0 && self.after.is_some();
        let after = self.after.map(|(_, direction)| direction);
        let (due, asked) = match (after, self.context.asked) {
            // A line that one side has for itself.
            _ if self.context.speaker.is_some() && self.quiet(to) => (self.context.speaker.unwrap_or(Direction::Unknown), None),
            _ if self.context.speaker.is_some() && !begins => return None,
            (Some(Direction::Request), Some(asked)) => (Direction::Response, Some(asked)),
            (Some(Direction::Response), None) => (Direction::Request, None),
            _ if begins => (Direction::Unknown, None),
            _ => return None,
        };
        if !(alone || begins) || self.behind_damage || to > RTU_LIMIT {
            return None;
        }
        let bytes = &self.bytes()[..to];
        // On a line with few strays, zeros are data.
        let clean = begins || (self.context.speaker.is_some() && self.model.strays_at_most() < AROUND);
        let strays = if clean { 0 } else { bytes.iter().take(MOST_GLITCH).take_while(|&&byte| glitch(byte)).count() };
        let least = if begins { 2 } else { self.model.strays_at_most() + 1 };
        if to - strays < least {
            return None;
        }
        let expected = asked.and_then(|asked| template::answer_length(self, asked));
        let length = to - strays;
        let again = self.repeats(asked);
        let harm = match expected {
            Some(expected) if expected > length && expected - length <= length && !again => {
                Some(Harm::Lost { at: 0, count: expected - length })
            }
            Some(expected) if expected < length => return None,
            // Who is heard here begins with unit and function, unless those were lost.
            None if self.context.speaker.is_some() && !begins && self.lacks_its_head(&bytes[strays..]) => {
                Some(Harm::Lost { at: 0, count: 0 })
            }
            _ => None,
        };
        Some(Piece { start: strays, end: to, direction: due, head: Vec::new(), short: true, harm, unknown: true, wrong: 0 })
    }

    /// Whether the bytes up to here are nothing but a piece of a frame: in one go, by the clock, on a line with few strays.
    fn quiet(&self, to: usize) -> bool {
        let strays = self.model.strays_at_most();
        self.input.timed && strays < AROUND && strays < to && !(1..to).any(|at| self.stops(at))
    }

    /// Whether the line is silent behind the strays that begin here, as behind those of a driver; who collides goes on.
    fn over_behind(&self, strays: usize) -> bool {
        let bytes = self.input.bytes();
        let end = strays + bytes[strays..].iter().take(MOST_GLITCH).take_while(|&&byte| byte == bytes[strays]).count();
        let behind = if self.announced { bytes.len() } else { self.length };
        if end >= behind {
            return true;
        }
        if self.input.timed {
            self.input.pause_before(end).is_some_and(|pause| pause >= self.silence)
        } else {
            self.model.has_unit(bytes[end])
        }
    }

    /// Whether no unit of this line begins these bytes, and no function code that announces just so many.
    fn lacks_its_head(&self, bytes: &[u8]) -> bool {
        let &[unit, code, ref body @ ..] = bytes else { return true };
        let row = self.context.functions.row(code & !EXCEPTION_BIT, body);
        let announced = row.is_some_and(|row| {
            [&row.request, &row.response].into_iter().any(|layout| match layout.extent(body) {
                Extent::Exactly(length) => (length + AROUND..=length + AROUND + MOST_GLITCH).contains(&bytes.len()),
                _ => false,
            })
        });
        !self.model.has_unit(unit) && !announced
    }

    /// Whether the bytes behind a frame that lost its end are its own last ones: the silence before them is as long as
    /// what is missing between.
    fn goes_on(&self, piece: &Piece) -> bool {
        let (Some(Harm::Lost { count, .. }), Some(char_ns)) = (piece.harm, self.input.char_ns) else { return false };
        let Some(missing) = count.checked_sub(self.length - piece.end).filter(|&missing| missing > 0) else { return false };
        let expected = missing as Ns * char_ns;
        let late = if self.input.coarse { COARSE_STOP / 2 } else { 2 * char_ns };
        let pause = self.input.pause_before(piece.end);
        pause.is_some_and(|pause| (pause - expected).abs() <= late.max(expected / 8))
    }

    /// What the frames around let one expect.
    fn expected(&self, around: &[Template<'_>], start: usize, candidates: &mut Vec<Candidate>) {
        let bytes = &self.bytes()[start..];
        let has = |place: usize, byte: u8| {
            let of = around.iter().enumerate();
            of.fold(0, |set: Set, (at, template)| set | Set::from(may_be(&template.bytes, place, byte)) << at)
        };
        for at in members(possible(bytes, has)) {
            candidates.extend(self.candidate(&around[at], start));
        }
    }

    /// What the poll cycle, and the units and functions of the line let one expect.
    fn candidates(&self, start: usize, candidates: &mut Vec<Candidate>) {
        let bytes = &self.bytes()[start..];
        let polls = &self.model.polls;
        let mut likely = if polls.is_empty() { 0 } else { polls.possible(bytes) };
        if likely != 0 {
            let need = ENOUGH + self.place(start) - ENDS_WELL + template::POLL;
            likely = polls.likely(likely, bytes, |byte| self.model.bits(byte), need, &align::COSTS);
        }
        for at in members(likely) {
            candidates.extend(self.candidate(&template::poll(polls.get(at)), start));
        }
        if self.context.known_units[usize::from(bytes[0])] || self.input.offset() == 0 {
            candidates.extend([REQUEST, RESPONSE].into_iter().filter_map(|direction| self.stranger(start, direction)));
        }
    }

    /// The frame of this template that may begin here.
    fn candidate(&self, template: &Template<'_>, start: usize) -> Option<Candidate> {
        let place = self.place(start);
        let least = enough(template.direction, 0.0);
        let fit = align(self.model, template, &self.bytes()[start..], least + place - ENDS_WELL - ROUNDING)?;
        let end = fit.length.map(|length| start + length);
        let score = fit.score - place + self.ends_well(end);
        (score > 0.0 && score >= least).then(|| Candidate::new(template, &fit, start, end, score))
    }

    /// A frame that nothing lets one expect, from a unit and with a function that the line has shown.
    fn stranger(&self, start: usize, direction: usize) -> Option<Candidate> {
        let &[unit, code, ref body @ ..] = &self.bytes()[start..] else { return None };
        let function = code & !EXCEPTION_BIT;
        if function == 0 || (code != function && direction == REQUEST) {
            return None;
        }
        let novelty = self.model.unit(unit) + self.model.function(self.context.functions, code, direction);
        let mut score = self.model.bits(unit) + self.model.bits(code) - novelty - self.place(start);
        if direction == RESPONSE {
            score -= costs::ORPHAN;
        }
        let row = self.context.functions.row(function, body);
        let length = if code == function {
            let extent = row.map(|row| if direction == REQUEST { row.request.extent(body) } else { row.response.extent(body) });
            match extent {
                Some(Extent::Exactly(length)) => Some(length + AROUND),
                _ => None,
            }
        } else {
            score -= costs::EXCEPTION;
            Some(5)
        };
        if let Some(row) = row.filter(|_| code == function) {
            score += row.permits[direction].iter().map(|permit| gain::permitted(self.model, permit, body)).sum::<f32>();
        }
        let end = length.filter(|&length| length <= RTU_LIMIT).map(|length| start + length);
        score += self.ends_well(end);
        let header = [unit, code];
        (score > 0.0 && score >= enough(direction, novelty)).then_some(Candidate {
            start,
            core: (start + 3).min(self.length),
            end,
            score,
            direction,
            header,
            novelty,
            head: Vec::new(),
            harm: None,
            mended: false,
            exact: true,
            open_at: None,
        })
    }

    /// What it costs to begin here.
    fn place(&self, start: usize) -> f32 {
        if start == 0 {
            let alone = self.context.speaker.is_some() && self.stops(0);
            return if alone { -costs::PAUSE_BEFORE } else { 0.0 };
        }
        let strays = (STRAY * start as f32).min(MOST_STRAYS);
        let paused = self.input.pause_before(start).is_some_and(|pause| pause >= self.silence);
        if paused {
            strays - costs::PAUSE_BEFORE
        } else {
            strays
        }
    }

    fn ends_well(&self, end: Option<usize>) -> f32 {
        let well = end.is_some_and(|end| {
            (end == self.length && !self.announced)
                || (end <= self.length && self.input.pause_before(end).is_some_and(|pause| pause >= self.silence))
        });
        if well {
            ENDS_WELL
        } else {
            0.0
        }
    }

    /// The best chain of candidates.
    fn pick(&self, candidates: &[Candidate]) -> Vec<Piece> {
        let mut chains: Vec<(f32, Option<usize>)> = Vec::with_capacity(candidates.len());
        for candidate in candidates {
            let mut best = (candidate.score, None);
            for (at, before) in candidates.iter().enumerate().take(chains.len()) {
                if before.core > candidate.start || before.start == candidate.start || before.score < ENOUGH {
                    continue;
                }
                let over = before.end.is_some_and(|end| end > candidate.start);
                let answers = before.direction == REQUEST && candidate.direction == RESPONSE;
                let ours = answers && before.header[0] == candidate.header[0] && before.header[1] == candidate.header[1] & 0x7F;
                let own = candidate.score - if over { CUT_OFF } else { 0.0 }
                    + if ours { candidate.novelty + costs::ORPHAN } else { 0.0 };
                if own >= ENOUGH && chains[at].0 + own - SELDOM > best.0 {
                    best = (chains[at].0 + own - SELDOM, Some(at));
                }
            }
            chains.push(best);
        }
        let ends = (0..candidates.len()).filter(|&at| chains[at].1.is_some() || candidates[at].score >= ENOUGH);
        let mut at = ends.max_by(|&a, &b| chains[a].0.total_cmp(&chains[b].0));
        let mut pieces: Vec<Piece> = Vec::new();
        while let Some(here) = at {
            let next = pieces.last().map_or(self.length, |piece| piece.start);
            let piece = self.piece(&candidates[here], next);
            at = chains[here].1;
            let before = at.map_or(0, |at| candidates[at].end.unwrap_or(candidates[at].core));
            pieces.push(self.begun(piece, before));
        }
        pieces.reverse();
        pieces
    }

    /// Where just so many bytes stand before a piece as seem to be missing from it, they are its own, and wrong.
    fn begun(&self, piece: Piece, before: usize) -> Piece {
        let count = piece.head.len();
        let Some(start) = piece.start.checked_sub(count).filter(|&start| count > 0 && start >= before) else { return piece };
        let has_checksum = piece.end - piece.start >= 2;
        if !has_checksum || (start != before && !self.stops(start)) || (start + 1..=piece.start).any(|at| self.stops(at)) {
            return piece;
        }
        Piece { start, short: false, harm: None, wrong: count, ..piece }
    }

    fn piece(&self, candidate: &Candidate, next: usize) -> Piece {
        let room = next - candidate.start;
        let said = candidate.end.map(|end| end - candidate.start).or_else(|| self.announced(candidate, next));
        let mut should = said.unwrap_or(room);
        let mut length = should.min(room).min(RTU_LIMIT);
        let mut harm = candidate.harm;
        if harm.is_none() && candidate.exact && room > should && should < RTU_LIMIT {
            let longer = &self.bytes()[candidate.start..=candidate.start + should];
            harm = mend::doubled_byte(longer).map(|at| Harm::Doubled { at });
            length += usize::from(harm.is_some());
        }
        if let Some(pause) = self.stops_at(candidate, candidate.start + length) {
            length = pause - candidate.start;
            should = said.unwrap_or(length);
        }
        let bytes = &self.bytes()[candidate.start..candidate.start + length];
        // A flipped bit may be in the byte that announces the length.
        let flipped = length < should && mending_bit(bytes).is_some();
        if flipped {
            should = length;
        } else if harm.is_none() && length < should {
            let count = should - length;
            harm = Some(if self.asked_again(candidate) { Harm::Truncated { count } } else { Harm::Lost { at: length, count } });
        } else if harm.is_none() && candidate.end.is_some() && (candidate.exact || candidate.open_at.is_some()) {
            harm = match candidate.open_at {
                Some(at) => strays_instead(bytes, at),
                None => fewer(bytes, self.ends_well(candidate.end) > 0.0),
            };
            harm = harm.filter(|harm| match harm {
                Harm::Lost { count, .. } => self.over_behind(candidate.start + length - count),
                _ => true,
            });
            length -= match harm {
                Some(Harm::Lost { count, .. }) => count,
                _ => 0,
            };
        }
        let short = length < should || matches!(harm, Some(Harm::Lost { .. }));
        let direction = gain::direction(candidate.direction);
        let (start, end) = (candidate.start, candidate.start + length);
        Piece { start, end, direction, head: candidate.head.clone(), short, harm, unknown: false, wrong: 0 }
    }

    /// The length that the header of a piece announces, where its template says none.
    fn announced(&self, candidate: &Candidate, next: usize) -> Option<usize> {
        let bytes = &self.bytes()[candidate.start..next];
        if candidate.header[..] != bytes[..2.min(bytes.len())] || candidate.header[1] & EXCEPTION_BIT != 0 {
            return None;
        }
        let row = self.context.functions.row(bytes[1], &bytes[2..])?;
        let layout = if candidate.direction == REQUEST { &row.request } else { &row.response };
        match layout.extent(&bytes[2..]) {
            Extent::Exactly(length) if length + AROUND <= RTU_LIMIT => Some(length + AROUND),
            _ => None,
        }
    }

    /// Where the line falls silent inside a frame whose checksum nothing mends: there it was over.
    fn stops_at(&self, candidate: &Candidate, end: usize) -> Option<usize> {
        let usual = !self.input.coarse && self.model.pauses_inside();
        if candidate.mended || usual || self.ends_well(candidate.end) > 0.0 {
            return None;
        }
        (candidate.core.max(candidate.start + 1)..end).find(|&at| self.stops(at))
    }

    /// Whether a pause before this byte ends a frame, as far as the clock can tell.
    fn stops(&self, at: usize) -> bool {
        let least = if self.input.coarse { self.silence.max(COARSE_STOP) } else { self.silence };
        self.input.pause_before(at).is_some_and(|pause| pause >= least)
    }

    /// Whether the same request follows: then nobody received this.
    fn asked_again(&self, candidate: &Candidate) -> bool {
        let Some((frame, Direction::Request)) = self.after else { return false };
        if candidate.direction == REQUEST {
            return frame[..2] == candidate.header;
        }
        self.repeats(self.context.asked)
    }

    /// Whether the frame behind the gap is this request once more.
    fn repeats(&self, asked: Option<Asked<'_>>) -> bool {
        let frame = self.after.map_or(&[][..], |(frame, _)| frame);
        asked.is_some_and(|asked| frame.len() > 2 && asked.unit == frame[0] && asked.pdu == &frame[1..frame.len() - 2])
    }
}

/// What is wrong with a frame of the right length whose checksum no flipped bit mends: perhaps it is a shorter one, and
/// its last bytes are strays behind it.
fn fewer(bytes: &[u8], ends_well: bool) -> Option<Harm> {
    let length = bytes.len();
    let last = *bytes.last().filter(|&&last| length > 5 && glitch(last))?;
    let count = bytes.iter().rev().take_while(|&&byte| byte == last).count();
    match count {
        // One byte of that kind may as well belong to the frame; then no byte put in mends the rest.
        1 if !ends_well && length <= SHORT => {
            let at = mend::missing_byte(&bytes[..length - 1]).filter(|_| mending_bit(bytes).is_none())?;
            Some(Harm::Lost { at, count })
        }
        2..=MOST_GLITCH if mending_bit(bytes).is_none() => Some(Harm::Lost { at: length - count, count }),
        _ => None,
    }
}

/// Whether the last bytes of a frame that is known are strays in the place of what was lost; here it agrees up to `at`.
fn strays_instead(bytes: &[u8], at: usize) -> Option<Harm> {
    let rest = bytes.get(at..).filter(|rest| (1..=MOST_GLITCH).contains(&rest.len()))?;
    let strays = rest.iter().all(|&byte| byte == rest[0]) && glitch(rest[0]) && mending_bit(bytes).is_none();
    strays.then_some(Harm::Lost { at, count: rest.len() })
}

/// A driver that is switched holds the line for some bits: the byte begins or ends in ones, or is all of one kind.
fn glitch(byte: u8) -> bool {
    byte.leading_ones() + byte.trailing_zeros() >= 8
}

/// Whether these strays are what a driver leaves when it is switched: few, of one such value.
pub fn is_glitch(strays: &[u8]) -> bool {
    strays.len() <= MOST_GLITCH && strays.iter().all(|&byte| glitch(byte) && byte == strays[0])
}

/// What a candidate has to be worth to change anything. An answer counts for more behind its request.
fn enough(direction: usize, novelty: f32) -> f32 {
    if direction == RESPONSE {
        ENOUGH - novelty - costs::ORPHAN - ROUNDING
    } else {
        ENOUGH
    }
}

/// The numbers in a set, the lowest first.
fn members(mut set: Set) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let at = (set != 0).then(|| set.trailing_zeros() as usize);
        set &= set.wrapping_sub(1);
        at
    })
}

impl Candidate {
    fn new(template: &Template<'_>, fit: &Fit, start: usize, end: Option<usize>, score: f32) -> Self {
        Self {
            start,
            core: start + fit.core,
            end,
            score,
            direction: template.direction,
            header: [template.bytes[0], template.bytes[1]],
            novelty: 0.0,
            head: template.bytes[..fit.head].to_vec(),
            harm: fit.harm,
            mended: fit.mended,
            exact: fit.exact,
            open_at: fit.length.filter(|&length| fit.head == 0 && length == template.bytes.len()).map(|_| fit.same),
        }
    }
}
