//! In a recording, what is still to come can be looked at: whether a frame that has begun will be one.
//!
//! So nothing has to be waited for that does not come, and no readings pile up meanwhile. What does come is waited for
//! as on a live line, and weighed.

use std::ops::Range;

use crate::framer::rtu::announced_length::{announced, LONGEST};
use crate::framer::rtu::certain::{Certain, Length};
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::search::decide::{COMING, DUE, ROUNDING, SURE, THETA_AHEAD, THREAT_AHEAD};
use crate::framer::rtu::search::paths::Node;
use crate::framer::rtu::search::Search;
use crate::framer::Context;
use crate::input::Input;
use modlens_protocol::checksum::{crc_valid_at, first_right};
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};

/// What the bytes that are still to come say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outlook {
    /// It comes.
    Comes,
    /// It does not.
    Never,
    /// More bytes have to be there to tell.
    Unknown,
}

impl Search {
    /// A frame that has begun before the end of `first`, comes, and may be worth more: behind which node, where it begins
    /// and until when it may. See `find_threat`, which can only guess.
    pub(super) fn find_coming(
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
            let bytes = &input.bytes()[(start - input.offset()) as usize..];
            let little = self.claims_too_little(context, bytes, start, least - top, &asked);
            if !little {
                let never = self.outlook(input, context, start) == Outlook::Never;
                for node in 0..self.nodes.len() {
                    if never && self.nodes[node].end != start {
                        continue;
                    }
                    quiet = false;
                    if let Some(until) = self.comes(input, context, node, start, bar) {
                        return Some((node, start, until));
                    }
                }
            }
            if quiet {
                self.cleared = start + 1;
            }
        }
        // The rival path may be in the middle of its next frame.
        (1..self.nodes.len()).find_map(|node| {
            let Node { end, first: of, .. } = self.nodes[node];
            let until = if of == first { None } else { self.comes(input, context, node, end, bar) };
            Some((node, end, until?))
        })
    }

    /// Until when a frame that begins at `start`, behind this node, may come out above the bar, if it comes.
    pub(super) fn comes(&mut self, input: &Input, context: &Context<'_>, node: usize, start: u64, bar: f32) -> Option<u64> {
        let behind = &self.nodes[node];
        let until = self.promises(input, context, behind, start, bar)?;
        // With a wrong checksum it would be a rival once it is there.
        let rival = bar + COMING - THETA_AHEAD;
        let outlook = match self.outlook(input, context, start) {
            Outlook::Never if start == behind.end => self.outlook_of_spoilt(input, context, behind, rival),
            outlook => outlook,
        };
        self.short |= outlook == Outlook::Unknown;
        (outlook != Outlook::Never).then_some(until)
    }

    /// Whether a frame of a length that its header admits begins at `start`, ends later than now and has a right checksum.
    pub(super) fn outlook(&self, input: &Input, context: &Context<'_>, start: u64) -> Outlook {
        let at = (start - input.offset()) as usize;
        let bytes = &input.bytes()[at..];
        let seen = (self.next - start) as usize;
        let reach = reach(input, at);
        let mut outlook = Outlook::Never;
        if bytes.len() < 2 {
            return if input.closed { Outlook::Never } else { Outlook::Unknown };
        }
        for (way, extent) in announced(context, bytes).into_iter().flatten() {
            let (needed, found) = match extent {
                Extent::Exactly(length) if length > reach || length <= seen => continue,
                Extent::Exactly(length) => (length, crc_valid_at(bytes, length)),
                Extent::AtLeast(length) if length > reach => continue,
                Extent::AtLeast(_) => (reach, false),
                Extent::Open(_) if !self.model.familiar(bytes[0], bytes[1], index(way)) => continue,
                Extent::Open(_) => (reach, first_right(&bytes[..reach.min(bytes.len())], seen + 1).is_some()),
            };
            match found {
                true => return Outlook::Comes,
                false if needed > bytes.len() && !input.closed => outlook = Outlook::Unknown,
                false => {}
            }
        }
        outlook
    }

    /// Whether right behind this node a frame comes whose checksum is wrong, and is worth more than the bar all the same.
    fn outlook_of_spoilt(&self, input: &Input, context: &Context<'_>, node: &Node, bar: f32) -> Outlook {
        let at = (node.end - input.offset()) as usize;
        let bytes = &input.bytes()[at..];
        if bytes.get(1).is_none_or(|code| code & EXCEPTION_BIT != 0) {
            return Outlook::Never;
        }
        let (seen, reach) = ((self.next - node.end) as usize, reach(input, at));
        let asked = node.pending.asked.map(|slot| self.requests.get(slot));
        let comes = |(way, extent): (Direction, Extent)| match extent {
            Extent::Exactly(length) if length > seen && length <= reach.min(bytes.len()) => {
                let gain = gain::damaged(&self.model, context, asked, &bytes[..length], index(way));
                gain.is_some_and(|gain| node.score + gain > bar)
            }
            _ => false,
        };
        if announced(context, bytes).into_iter().flatten().any(comes) {
            Outlook::Comes
        } else {
            Outlook::Never
        }
    }

    /// Whether any bytes that begin behind what was told and end behind this place have a right checksum. Asked once: what has
    /// come is still to be weighed.
    pub(super) fn outlook_of_any_length(&mut self, input: &Input, end: u64) -> Outlook {
        if let Some((_, comes)) = self.any_length.filter(|(told, _)| *told == self.told()) {
            return if comes { Outlook::Comes } else { Outlook::Never };
        }
        let at = (self.told() - input.offset()) as usize;
        let bytes = &input.bytes()[at..];
        let reach = reach(input, at);
        let comes = first_right(&bytes[..reach.min(bytes.len())], (end - self.told()) as usize + 1).is_some();
        if !comes && reach > bytes.len() && !input.closed {
            return Outlook::Unknown;
        }
        self.any_length = Some((self.told(), comes));
        if comes {
            Outlook::Comes
        } else {
            Outlook::Never
        }
    }

    /// A frame that has begun with one of some strays and would outweigh the sure one behind them, if there is one.
    pub fn begins_before(&self, input: &Input, context: &Context<'_>, strays: usize, length: usize) -> Certain {
        let root = &self.nodes[0];
        let asked = root.pending.asked.map(|slot| self.requests.get(slot));
        for at in 0..strays {
            let seen = &input.bytes()[at..strays + length];
            // What a function of any length holds may look like a frame, where it is new to this line as well.
            let any_length = |of: Option<(Direction, Extent)>| of.is_some_and(|(_, extent)| matches!(extent, Extent::Open(_)));
            let holds = || context.known_units[usize::from(seen[0])] && announced(context, seen).into_iter().any(any_length);
            // Nearly always nothing comes.
            let found = whole_at(input, context, at, strays + length);
            if matches!(found, Certain::No) {
                continue;
            }
            let way = if at == 0 { DUE } else { 0.0 } - self.model.between(at as u64);
            let header = || gain::header(&self.model, context, asked, seen);
            if holds() || header().is_some_and(|header| way + header.gain > SURE - THREAT_AHEAD) {
                return found;
            }
        }
        Certain::No
    }
}

/// The index of learned counts.
fn index(way: Direction) -> usize {
    if way == Direction::Response {
        RESPONSE
    } else {
        REQUEST
    }
}

/// No frame that begins here has more bytes.
fn reach(input: &Input, at: usize) -> usize {
    let rest = input.bytes().len() - at;
    input.edge_after(at, at + rest.min(LONGEST) - 1, input.break_ns).map_or(LONGEST, |edge| edge - at)
}

/// The frame with a right checksum that begins at this place and reaches beyond `to`, of a length that its header admits.
fn whole_at(input: &Input, context: &Context<'_>, at: usize, to: usize) -> Certain {
    let bytes = &input.bytes()[at..];
    let reach = reach(input, at);
    for (_, extent) in announced(context, bytes).into_iter().flatten() {
        let (Extent::Exactly(length) | Extent::AtLeast(length) | Extent::Open(length)) = extent;
        let open = matches!(extent, Extent::Open(_));
        let needed = if open { reach } else { length };
        if length > reach || (open && !context.known_units[usize::from(bytes[0])]) {
            continue;
        }
        let found = match extent {
            Extent::Exactly(_) => crc_valid_at(bytes, length).then_some(length),
            Extent::AtLeast(_) => None,
            Extent::Open(_) => first_right(&bytes[..reach.min(bytes.len())], to - at),
        };
        match found {
            Some(length) => return Certain::Frame(Length::exactly(length)),
            None if needed > bytes.len() && !input.closed => return Certain::Wait,
            None => {}
        }
    }
    Certain::No
}
