//! When a frame is told: once no rival reading is near, and none that has begun may come near.

use std::ops::Range;

use crate::framer::rtu::announced_length::announced;
use crate::framer::rtu::costs::MAY_HOLD_A_FRAME;
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::join::REACH;
use crate::framer::rtu::model::Setting;
use crate::framer::rtu::pending::Request;
use crate::framer::rtu::search::ahead::Outlook;
use crate::framer::rtu::search::paths::{Node, KEPT};
use crate::framer::rtu::search::{copy, learn, Search, Told};
use crate::framer::Context;
use crate::input::Input;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, Layout, EXCEPTION_BIT};

/// The chance of telling a frame too early is about 2 to the minus this.
const THETA: f32 = 14.0;

/// The same where nobody waits: in a recording.
pub(super) const THETA_AHEAD: f32 = 30.0;

/// The same for frames that have only begun before one that leaves no doubt.
pub(super) const THREAT_AHEAD: f32 = 18.0;

/// The same where it is looked up whether they come: those that do have a right checksum, too.
pub(super) const COMING: f32 = 35.0;

/// Readings that stay equally good for so many bytes will not be told apart: the better one is taken.
const PATIENCE: u64 = 640;
const PATIENCE_AHEAD: u64 = 1280;

/// Without a clock the frame behind tells an echoed answer from a retry; readings the other way round so near wait for it.
const LOOK_ALIKE: f32 = 40.0;

/// What it is worth for a frame that has begun to have begun right behind another one.
pub(super) const DUE: f32 = 14.0;

/// So many frames right behind each other are none by chance.
const CHAIN: u8 = 4;

/// Sums of the same numbers in another order differ by less.
pub(super) const ROUNDING: f32 = 0.01;

/// No header is worth more.
const MOST_HEADER: f32 = 60.0;

/// A frame with this many bits cannot be overtaken by a header alone that begins in it.
pub(super) const SURE: f32 = 34.0;

/// More readings than this at once are no traffic; the best one is taken.
const CROWD: usize = 96;

/// What stands behind a frame costs the same so many bytes behind it and later: only what is found then changes anything.
const STILL: u64 = 3;

/// Unit, function code and two more bytes: whoever holds another frame has more of a head than strays are.
const SHORTEST_HEAD: u64 = 4;

/// Bytes without any frame are given out in such pieces.
const NOISE: u64 = 4096;

/// Some units.
#[derive(Default)]
pub(super) struct Units([u64; 4]);

impl Units {
    fn add(&mut self, unit: u8) {
        self.0[usize::from(unit >> 6)] |= 1 << (unit & 63);
    }

    fn has(&self, unit: u8) -> bool {
        self.0[usize::from(unit >> 6)] >> (unit & 63) & 1 == 1
    }
}

impl Search {
    /// Tells the first frame of the best path, or that there is none, or sets the place before which that need not be
    /// asked again.
    pub(super) fn decide(&mut self, input: &Input, context: &Context<'_>, closed: bool) -> Option<Told> {
        (self.short, self.steady) = (false, false);
        let (best, standing) = self.best();
        let first = self.nodes[best].first;
        // Where nothing was found, nothing changes.
        let moving = self.nodes.len() > 1 && self.next < self.nodes[self.nodes.len() - 1].end + STILL;
        let until = if first == 0 {
            let limit = self.told() + NOISE;
            if closed || self.next > limit + REACH {
                self.doubtful |= !closed;
                let to = if closed { self.next } else { limit };
                let junk = (self.told() - input.offset()) as usize..(to - input.offset()) as usize;
                self.model.learn_noise(&input.bytes()[junk]);
                return Some(self.junk(to));
            }
            if self.nodes.len() >= 2 * KEPT {
                self.thin();
            }
            Some(limit + REACH + 1)
        } else if closed {
            None
        } else {
            self.undecided_until(input, context, best, standing)
        };
        match until {
            Some(until) => {
                self.calm = if moving && !self.steady { 0 } else { until };
                None
            }
            None => Some(self.tell(input, context, first, standing)),
        }
    }

    /// The place before which the first frame of the best path cannot be told, unless more frames are found.
    fn undecided_until(&mut self, input: &Input, context: &Context<'_>, best: usize, standing: f32) -> Option<u64> {
        let first = self.nodes[best].first;
        let (start, end, whole) = (self.nodes[first].start, self.nodes[first].end, self.nodes[first].whole);
        let (theta, patience) = if context.ahead { (THETA_AHEAD, PATIENCE_AHEAD) } else { (THETA, PATIENCE) };
        if self.next >= end + patience || self.nodes.len() >= CROWD {
            return None;
        }
        let bar = standing - theta;
        let rivals = self.nodes.iter().filter(|node| node.first != first && self.standing(node) > bar);
        // One that ends no later falls back no more than the best one does.
        if let Some(first_end) = rivals.map(|node| node.end).min() {
            self.steady = first_end <= self.nodes[best].end;
            return Some(end + patience);
        }
        let reach = end + REACH;
        if self.next >= reach {
            return None;
        }
        if let Some(held) = self.held_until(input, context, (start, end)).filter(|&held| self.next < held) {
            return Some(held);
        }
        let clockless = (context.pause)(input.pause_before((start - input.offset()) as usize)) == 0.0;
        let look_alike = clockless && context.speaker.is_none() && first == best && self.turned(first, standing - LOOK_ALIKE);
        // Only what follows shows that a frame was damaged rather than none.
        let doubtful = !whole && first == best;
        if look_alike || doubtful {
            self.steady = true;
            return Some(reach);
        }
        let begun = standing - if context.ahead { COMING } else { THETA };
        // The further it stands back, the less it is worth, as far as that goes.
        let behind = self.next - self.nodes[best].end;
        let least = begun - (self.model.astray(behind.max(STILL)) - self.model.astray(behind)) - ROUNDING;
        self.threatened_until(input, context, first, (begun, least)).map(|until| until.min(reach))
    }

    /// How long it is open whether this frame stands inside one that has begun before it.
    fn held_until(&mut self, input: &Input, context: &Context<'_>, (start, end): (u64, u64)) -> Option<u64> {
        let base = input.offset();
        if start - self.told() < SHORTEST_HEAD || (input.timed && input.starts_read((start - base) as usize)) {
            return None;
        }
        let before = &input.bytes()[(self.told() - base) as usize..];
        if !self.model.has_unit(before[0]) {
            return None;
        }
        let mut until = None;
        for (_, extent) in announced(context, before).into_iter().flatten() {
            let (length, outlook) = match extent {
                Extent::Open(_) if context.ahead => (REACH, self.outlook_of_any_length(input, end)),
                Extent::Open(_) => (REACH, Outlook::Comes),
                Extent::Exactly(_) if !self.may_hold(context, before) => continue,
                Extent::Exactly(length) if context.ahead => (length as u64, self.outlook(input, context, self.told())),
                Extent::Exactly(length) => (length as u64, Outlook::Comes),
                Extent::AtLeast(_) => continue,
            };
            self.short |= outlook == Outlook::Unknown;
            if outlook != Outlook::Never {
                until = until.max(Some(self.told() + length));
            }
        }
        until
    }

    /// Whether a frame that has begun before the end of `first` may still turn out to be worth more: at least up to there.
    ///
    /// It has to come above the first of the bars; that one will not fall below the second as long as the paths stand.
    fn threatened_until(&mut self, input: &Input, context: &Context<'_>, first: usize, (bar, least): (f32, f32)) -> Option<u64> {
        let frame = &self.nodes[first];
        // What begins inside a sure one is no threat to it; but behind strays it may itself stand inside a longer one.
        let sure = frame.gain >= SURE;
        if sure && frame.start == self.told() {
            return None;
        }
        let behind = if sure && context.ahead { frame.start } else { frame.end };
        let within = self.told().max(self.next.saturating_sub(REACH))..behind;
        // What was possible a byte ago mostly still is.
        let known = self.threat.take().and_then(|(node, start)| {
            let behind = &self.nodes[node];
            let counts = within.contains(&start) || (start == behind.end && node != 0 && behind.first != first);
            let until = match counts {
                true if context.ahead => self.comes(input, context, node, start, bar),
                true => self.promises(input, context, behind, start, bar),
                false => None,
            };
            Some((node, start, until?))
        });
        let found = match known {
            None if context.ahead => self.find_coming(input, context, first, within, (bar, least)),
            None => self.find_threat(input, context, first, within, (bar, least)),
            known => known,
        };
        self.threat = found.map(|(node, start, _)| (node, start));
        found.map(|(_, start, until)| until.min(start + REACH + 1))
    }

    fn find_threat(
        &mut self,
        input: &Input,
        context: &Context<'_>,
        first: usize,
        within: Range<u64>,
        (bar, least): (f32, f32),
    ) -> Option<(usize, u64, u64)> {
        let asked = self.units_asked();
        let mut quiet = true;
        let top = self.nodes.iter().map(|node| node.score).fold(f32::MIN, f32::max) + ROUNDING;
        for start in within.start.max(self.cleared)..within.end {
            let seen = &input.bytes()[(start - input.offset()) as usize..(self.next - input.offset()) as usize];
            let nodes = if self.claims_too_little(context, seen, start, least - top, &asked) { 0 } else { self.nodes.len() };
            for node in 0..nodes {
                if self.promises(input, context, &self.nodes[node], start, least).is_none() {
                    continue;
                }
                if let Some(until) = self.promises(input, context, &self.nodes[node], start, bar) {
                    return Some((node, start, until));
                }
                quiet = false;
            }
            // With so many bytes of a header seen, it is worth no more later.
            quiet &= nodes == 0
                || start + gain::most_of_a_header(context, &input.bytes()[(start - input.offset()) as usize..]) <= self.next;
            if quiet {
                self.cleared = start + 1;
            }
        }
        // The rival path may be in the middle of its next frame.
        let rivals = (1..self.nodes.len()).filter(|&i| self.nodes[i].first != first);
        let mut rivals = rivals.map(|i| (i, self.nodes[i].end));
        rivals.find_map(|(i, end)| Some((i, end, self.promises(input, context, &self.nodes[i], end, bar)?)))
    }

    /// Whether no frame that begins at this place may claim so many bits, whatever stands in it, unless it is an answer.
    ///
    /// `seen` ends where the bytes end that may be looked at; `asked`: the units that are asked on any of the paths.
    pub(super) fn claims_too_little(&mut self, context: &Context<'_>, seen: &[u8], start: u64, bits: f32, asked: &Units) -> bool {
        let &[unit, code, ..] = seen else { return false };
        let claims = self.model.claims_at_most(context.functions, unit, code);
        let due = || self.nodes.iter().any(|node| node.end == start);
        let little = claims + DUE <= bits || (claims - self.model.between(1) <= bits && !due());
        let asks =
            |node: &Node| node.pending.asked.is_some_and(|slot| self.requests.get(slot).is_of(unit, code & !EXCEPTION_BIT));
        little && !(asked.has(unit) && self.nodes.iter().any(asks))
    }

    /// The units that are asked on any of the paths.
    pub(super) fn units_asked(&self) -> Units {
        let mut units = Units::default();
        let asked = self.nodes.iter().filter_map(|node| node.pending.asked);
        asked.for_each(|slot| units.add(self.requests.get(slot).unit));
        units
    }

    /// Whether a frame that has begun at `start`, behind this node, may come out above the bar: at least up to there.
    pub(super) fn promises(&self, input: &Input, context: &Context<'_>, node: &Node, start: u64, bar: f32) -> Option<u64> {
        if node.end > start || start >= self.next {
            return None;
        }
        // A frame that begins where one is due may well contain another one: its end is waited for.
        let due = if start == node.end { DUE } else { 0.0 };
        let way = node.score - self.model.between(start - node.end) + due;
        if way <= bar - MOST_HEADER {
            return None;
        }
        let base = input.offset();
        let seen = &input.bytes()[(start - base) as usize..(self.next - base) as usize];
        let asked = node.pending.asked.map(|slot| self.requests.get(slot));
        let header = gain::header(&self.model, context, asked, seen).filter(|header| way + header.gain > bar)?;
        Some(start + header.until)
    }

    /// Tells a frame: it becomes the root of all that is left.
    fn tell(&mut self, input: &Input, context: &Context<'_>, first: usize, standing: f32) -> Told {
        let rival = (0..self.nodes.len()).filter(|&i| self.nodes[i].first != first).map(|i| self.standing(&self.nodes[i]));
        let lead = standing - rival.fold(f32::MIN, f32::max);
        let frame = &self.nodes[first];
        if !frame.whole {
            let told = Told::Damaged { start: frame.start, end: frame.end, direction: gain::direction(frame.direction) };
            self.reroot(first);
            return told;
        }
        let bytes = &input.bytes()[(frame.start - input.offset()) as usize..(frame.end - input.offset()) as usize];
        if frame.direction == RESPONSE {
            let answers = frame.answers;
            self.learn_late(context, bytes, answers);
        }
        let frame = &self.nodes[first];
        let junk = frame.start - self.told();
        let strays = junk > 0;
        let vouched = frame.answers && self.asked().is_none_or(|asked| vouches(context, asked, bytes));
        // Drivers that are switched leave a stray or two in front of every frame.
        let near = vouched && junk < MAY_HOLD_A_FRAME;
        let asked_for = frame.answers && self.asked().is_some_and(|asked| !asked.tentative || near);
        // Right behind a frame that is one by chance perhaps, another one may be so, too; not its answer, nor one of many.
        self.glued = if strays { 0 } else { self.glued.saturating_add(1) };
        let alone = strays || (self.doubtful && !vouched && self.glued < CHAIN);
        let tentative = alone && !asked_for && !context.paired_units[bytes[0] as usize];
        // Noise must not teach units; that strays stand before frames, it may.
        if tentative {
            self.model.learn_strays(junk);
        } else {
            let again = frame.pending.asked.is_some_and(|slot| self.requests.get(slot).copied);
            let setting = Setting { waiting: self.nodes[0].pending.asked.is_some(), junk };
            let (direction, copy) = (frame.direction, copy(context, bytes, again && frame.direction == REQUEST));
            // A response to nobody may be a request that looks like one.
            let sure = direction == REQUEST || frame.answers;
            learn(&mut self.model, context, bytes, direction, setting, copy, sure);
            self.model.settle();
        }
        let told = Told::Frame {
            start: frame.start,
            end: frame.end,
            direction: if lead < 1.0 { self.undecided(first) } else { gain::direction(frame.direction) },
            confidence: lead.clamp(0.0, 60.0) as u8,
            tentative,
        };
        self.doubtful = tentative;
        if strays {
            let junk = &input.bytes()[(self.told() - input.offset()) as usize..(frame.start - input.offset()) as usize];
            self.model.learn_noise(junk);
        }
        self.reroot(first);
        if let Some(asked) = self.nodes[0].pending.asked.filter(|_| tentative) {
            self.make_room();
            self.nodes[0].pending.asked = Some(self.requests.keep_doubted(asked));
        }
        told
    }

    /// The direction of a frame whose rival is nearly as good: unknown, if the rival is the same bytes the other way round.
    fn undecided(&self, first: usize) -> Direction {
        if self.turned(first, f32::MIN) {
            Direction::Unknown
        } else {
            gain::direction(self.nodes[first].direction)
        }
    }

    /// Whether the same bytes are also read the other way round, by a path above the bar.
    fn turned(&self, first: usize, bar: f32) -> bool {
        let frame = &self.nodes[first];
        let same = |node: &Node| (node.start, node.end) == (frame.start, frame.end) && node.direction != frame.direction;
        self.nodes.iter().any(|node| same(node) && self.standing(node) > bar)
    }
}

/// Whether an answer says that its request is one. Wrong bytes come again as they were, and where any length may be, any
/// place may.
fn vouches(context: &Context<'_>, asked: &Request, frame: &[u8]) -> bool {
    let (&code, body) = asked.pdu.split_first().unwrap_or((&0, &[]));
    let known = context.functions.row(code, body).is_some_and(|row| matches!(row.response, Layout::Body(_)));
    known && asked.pdu[..] != frame[1..frame.len() - 2]
}
